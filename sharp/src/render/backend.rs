//! Choice of a rendering backend, as written on command lines and in records.

use super::{CpuRenderer, RenderError, Renderer};
use std::fmt;
use std::str::FromStr;

/// Rendering backend. Written `cpu`, `wgpu`, `wgpu:NAME` or `auto`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Backend {
    /// [`CpuRenderer`]. The default, also for scoring.
    #[default]
    Cpu,
    /// `GpuRenderer` on the first hardware adapter, or on the first adapter whose description contains the name
    /// (case-insensitive). Software adapters are only selected by name.
    Wgpu(Option<String>),
    /// The first hardware adapter if one opens, else the CPU.
    Auto,
}

impl Backend {
    /// Opens the backend.
    ///
    /// # Errors
    /// [`RenderError::NoAdapter`] if no adapter matches or the build has no GPU backend; [`RenderError::Device`] if the
    /// adapter does not open. `cpu` and `auto` never fail.
    pub fn open(&self) -> Result<Box<dyn Renderer>, RenderError> {
        match self {
            Self::Cpu => Ok(Box::new(CpuRenderer::new())),
            Self::Wgpu(name) => open_gpu(name.as_deref()),
            Self::Auto => open_gpu(None).or_else(|_| Self::Cpu.open()),
        }
    }
}

#[cfg(feature = "gpu")]
fn open_gpu(name: Option<&str>) -> Result<Box<dyn Renderer>, RenderError> {
    use super::{GpuAdapter, GpuRenderer};
    let adapter = match name {
        Some(name) => GpuAdapter::find(name),
        None => GpuAdapter::best(),
    };
    let Some(adapter) = adapter else {
        let found: Vec<String> = GpuAdapter::all().iter().map(ToString::to_string).collect();
        let found = match found.len() {
            0 => "none".to_owned(),
            _ => found.join("; "),
        };
        return Err(RenderError::NoAdapter(match name {
            Some(name) => format!("no adapter's description contains \"{name}\"; found: {found}"),
            None => format!(
                "no hardware adapter (a software adapter must be named explicitly, such as \
                 wgpu:llvmpipe); found: {found}"
            ),
        }));
    };
    Ok(Box::new(GpuRenderer::new(&adapter)?))
}

#[cfg(not(feature = "gpu"))]
fn open_gpu(_name: Option<&str>) -> Result<Box<dyn Renderer>, RenderError> {
    Err(RenderError::NoAdapter(
        "this build has no GPU backend (feature gpu)".to_owned(),
    ))
}

impl fmt::Display for Backend {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu => f.write_str("cpu"),
            Self::Wgpu(None) => f.write_str("wgpu"),
            Self::Wgpu(Some(name)) => write!(f, "wgpu:{name}"),
            Self::Auto => f.write_str("auto"),
        }
    }
}

#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "unknown backend \"{0}\"; expected cpu, wgpu, wgpu:NAME (part of an adapter's name) or auto"
)]
pub struct UnknownBackend(String);

impl FromStr for Backend {
    type Err = UnknownBackend;

    fn from_str(text: &str) -> Result<Self, UnknownBackend> {
        match text.split_once(':') {
            None if text == "cpu" => Ok(Self::Cpu),
            None if text == "auto" => Ok(Self::Auto),
            None if text == "wgpu" => Ok(Self::Wgpu(None)),
            Some(("wgpu", name)) if !name.trim().is_empty() => {
                Ok(Self::Wgpu(Some(name.trim().to_owned())))
            }
            _ => Err(UnknownBackend(text.to_owned())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn backends_are_read_as_they_are_written() {
        for text in ["cpu", "wgpu", "auto", "wgpu:llvmpipe", "wgpu:A: b"] {
            assert_eq!(text.parse::<Backend>().unwrap().to_string(), text);
        }
        assert_eq!(Backend::default(), Backend::Cpu);
        for text in ["", "gpu", "CPU", "wgpu:", "wgpu: ", "cpu:0", "auto:x"] {
            assert!(text.parse::<Backend>().is_err(), "{text}");
        }
    }

    #[test]
    fn the_cpu_opens_everywhere_and_auto_always_finds_something() {
        assert!(Backend::Cpu.open().unwrap().name().starts_with("cpu-"));
        let name = Backend::Auto.open().unwrap().name();
        assert!(!name.contains("[software]"), "{name}");
    }

    #[test]
    fn an_unknown_adapter_is_named() {
        let wanted = Backend::Wgpu(Some("no such adapter".to_owned()));
        let Err(error) = wanted.open() else {
            panic!("opened");
        };
        assert!(matches!(error, RenderError::NoAdapter(_)));
        assert!(!error.is_device_fault());
    }
}
