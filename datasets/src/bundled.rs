//! The dataset bundled with the program: one Middlebury scene, in Middlebury's own layout.

use std::path::{Path, PathBuf};

use crate::{DatasetError, files};

struct BundledFile {
    name: &'static str,
    sha256: &'static str,
    bytes: &'static [u8],
}

const FOLDER: &str = "Motorcycle-quarter";

const FILES: [BundledFile; 4] = [
    BundledFile {
        name: "calib.txt",
        sha256: "2d9aa2ee440583e3dee4cd2d12e801b704c5ed17c523cb249884eb95989d4095",
        bytes: include_bytes!("../bundled/middlebury/Motorcycle-quarter/calib.txt"),
    },
    BundledFile {
        name: "disp0.pfm",
        sha256: "07186c3826f118c68e08158b2ba4d14615a566c4276567a5b58d83d4031a9bcf",
        bytes: include_bytes!("../bundled/middlebury/Motorcycle-quarter/disp0.pfm"),
    },
    BundledFile {
        name: "im0.png",
        sha256: "4120da4f47283248a876e6abc88668c0c34679df9d315170e5eb31bb152131bd",
        bytes: include_bytes!("../bundled/middlebury/Motorcycle-quarter/im0.png"),
    },
    BundledFile {
        name: "im1.png",
        sha256: "8077e7771731d7326294e9a189101771f47653bfd7dee2b626be794d275355e8",
        bytes: include_bytes!("../bundled/middlebury/Motorcycle-quarter/im1.png"),
    },
];

/// Writes the bundled scene to `folder` and returns the path for the `middlebury` reader. Intact existing files are
/// kept, others are replaced; each is written to a temporary file and then renamed, so that no file is ever incomplete.
///
/// # Errors
/// [`DatasetError::Io`]; [`DatasetError::Malformed`] if a written file does not have the published SHA-256.
pub fn extract(folder: &Path) -> Result<PathBuf, DatasetError> {
    let dataset = folder.join("middlebury");
    let scene = dataset.join(FOLDER);
    std::fs::create_dir_all(&scene).map_err(|e| DatasetError::io(&scene, e))?;
    for file in &FILES {
        let path = scene.join(file.name);
        if path.is_file() && files::sha256(&path)? == file.sha256 {
            continue;
        }
        let partial = scene.join(format!("{}.{}.part", file.name, std::process::id()));
        std::fs::write(&partial, file.bytes).map_err(|e| DatasetError::io(&partial, e))?;
        std::fs::rename(&partial, &path).map_err(|e| DatasetError::io(&path, e))?;
        let found = files::sha256(&path)?;
        if found != file.sha256 {
            return Err(DatasetError::malformed(
                path,
                format!("has sha256 {found}, expected {}", file.sha256),
            ));
        }
    }
    Ok(dataset)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extraction_is_whole_and_mends_what_is_broken() {
        let folder = tempfile::tempdir().unwrap();
        let dataset = extract(folder.path()).unwrap();
        let image = dataset.join(FOLDER).join("im0.png");
        let whole = std::fs::read(&image).unwrap();
        std::fs::write(&image, &whole[..100]).unwrap();
        assert_eq!(extract(folder.path()).unwrap(), dataset);
        assert_eq!(std::fs::read(&image).unwrap(), whole);
        assert_eq!(
            files::list(&dataset.join(FOLDER)).unwrap().len(),
            FILES.len()
        );
    }
}
