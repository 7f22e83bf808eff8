//! `--backend` and `--adapter`.

use anyhow::bail;
use sharp::render::Backend;

/// What both options together ask for. Naming an adapter asks for wgpu.
pub(super) fn chosen(backend: &Backend, adapter: Option<&str>) -> anyhow::Result<Backend> {
    match (backend, adapter) {
        (backend, None) => Ok(backend.clone()),
        (Backend::Auto | Backend::Wgpu(None), Some(name)) => {
            Ok(Backend::Wgpu(Some(name.to_owned())))
        }
        (Backend::Cpu, Some(_)) => {
            bail!("--adapter names a GPU, --backend cpu wants none: use --backend wgpu")
        }
        (Backend::Wgpu(Some(_)), Some(_)) => bail!("--backend {backend} names an adapter already"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_adapter_asks_for_wgpu() {
        let named = Backend::Wgpu(Some("A".to_owned()));
        for backend in [Backend::Auto, Backend::Wgpu(None)] {
            assert_eq!(chosen(&backend, Some("A")).unwrap(), named);
            assert_eq!(chosen(&backend, None).unwrap(), backend);
        }
        assert!(chosen(&Backend::Cpu, Some("A")).is_err());
        assert!(chosen(&named, Some("B")).is_err());
    }
}
