//! Downloads published networks.

use std::path::{Path, PathBuf};

use sharp_checkpoint::download::{Download, DownloadError, Progress, remove};

use super::record::{RecordError, Standing, compare_or_record};
use super::release::Release;
use crate::io::atomic_files::FileError;
use crate::io::hash::file_sha256;

#[derive(Debug, thiserror::Error)]
pub enum CheckpointFetchError {
    #[error(transparent)]
    Download(#[from] DownloadError),
    #[error("the file downloaded from {address} was deleted as unusable: {reason}")]
    NotTheNetwork { address: String, reason: String },
    #[error(transparent)]
    Record(#[from] RecordError),
    #[error(transparent)]
    File(#[from] FileError),
}

/// Downloads a release into a cache folder. If the licence requires the user's acceptance, the
/// caller must first obtain it.
///
/// Resumes an interrupted transfer, even one of an earlier call. The file gets its final name only if its size is
/// plausible, it contains all of the network's tensors, and it matches the record of an earlier download, if any.
pub fn fetch(
    release: &Release,
    cache: &Path,
    progress: impl FnMut(Progress),
) -> Result<(PathBuf, Standing), CheckpointFetchError> {
    std::fs::create_dir_all(cache).map_err(FileError::new(cache, "create"))?;
    let part = cache.join(format!("{}.part", release.file));
    let (least, most) = (release.sizes.start(), release.sizes.end());
    let download = Download {
        address: release.address.clone(),
        sizes: release.sizes.clone(),
        size_text: format!("{least} to {most} bytes, by the network's number of parameters"),
    };
    download.fetch(&part, progress)?;
    if let Err(reason) = release.check(&part) {
        remove(&part)?;
        return Err(CheckpointFetchError::NotTheNetwork {
            address: release.address.clone(),
            reason,
        });
    }
    let sha256 = file_sha256(&part)?;
    let record = cache.join(format!("{}.json", release.file));
    let standing = compare_or_record(&part, release.published, &sha256, &record)?;
    let kept = cache.join(release.file);
    std::fs::rename(&part, &kept).map_err(FileError::new(&kept, "write"))?;
    Ok((kept, standing))
}

#[cfg(test)]
mod tests {
    use super::*;
    use sharp::model::ModelConfig;

    use super::super::release::{RELEASE_FILE, ReleasedNetwork};
    use sharp_tests::unreliable_server::{Answer, Server};
    use tempfile::TempDir;

    fn golden(file: &str) -> String {
        format!(
            "{}/../tests/golden/model/{file}",
            env!("CARGO_MANIFEST_DIR")
        )
    }

    /// Serves the tiny network's checkpoint like the release's.
    fn attempt(
        answers: Vec<Answer>,
        cache: &Path,
    ) -> (
        Result<(PathBuf, Standing), CheckpointFetchError>,
        Vec<usize>,
    ) {
        let bytes = std::fs::read(golden("tiny_model.pt")).unwrap();
        let config = ModelConfig::load(&golden("tiny_config.json#tiny")).unwrap();
        let size = bytes.len() as u64;
        let server = Server::start(bytes, "v1", answers);
        let release = Release {
            address: server.address(),
            network: ReleasedNetwork::Sharp(Box::new(config)),
            sizes: size - 1000..=size + 1000,
            ..Release::official()
        };
        (fetch(&release, cache, |_| {}), server.starts())
    }

    fn names(cache: &TempDir) -> Vec<String> {
        let entries = std::fs::read_dir(cache.path()).unwrap();
        let mut names: Vec<String> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn a_broken_transfer_ends_in_a_checkpoint_with_a_record() {
        let cache = tempfile::tempdir().unwrap();
        let answers = vec![Answer::Break(900_000), Answer::Status(502), Answer::Rest];
        let (result, starts) = attempt(answers, cache.path());
        let (kept, standing) = result.unwrap();
        assert_eq!(starts, [0, 900_000, 900_000]);
        assert!(matches!(standing, Standing::Unverified(_)));
        assert_eq!(
            std::fs::read(&kept).unwrap(),
            std::fs::read(golden("tiny_model.pt")).unwrap()
        );
        let both = [RELEASE_FILE.to_owned(), format!("{RELEASE_FILE}.json")];
        assert_eq!(names(&cache), both);
        // After a second download of the same file, it is no longer unverified.
        std::fs::remove_file(&kept).unwrap();
        let (_, standing) = attempt(vec![Answer::Whole], cache.path()).0.unwrap();
        assert!(matches!(standing, Standing::Matches(_)));
    }

    #[test]
    fn what_an_earlier_call_left_is_resumed() {
        let cache = tempfile::tempdir().unwrap();
        let bytes = std::fs::read(golden("tiny_model.pt")).unwrap();
        let part = cache.path().join(format!("{RELEASE_FILE}.part"));
        std::fs::write(part, &bytes[..5000]).unwrap();
        let (result, starts) = attempt(vec![Answer::Rest], cache.path());
        assert_eq!(starts, [5000]);
        result.unwrap();
    }

    #[test]
    fn lies_pages_and_other_bytes_are_errors_and_leave_nothing() {
        let bytes = std::fs::metadata(golden("tiny_model.pt")).unwrap().len() as usize;
        for (answer, reason) in [
            (Answer::Length(1000), "announced 1000 bytes"),
            (Answer::Length(bytes + 5000), "announced"),
            (Answer::Page, "text instead of the file"),
            (Answer::Status(404), "status 404"),
            (Answer::Length(bytes), "not SHARP's checkpoint"),
        ] {
            let cache = tempfile::tempdir().unwrap();
            let error = attempt(vec![answer], cache.path()).0.unwrap_err();
            let error = error.to_string();
            assert!(
                error.contains(reason) && error.contains("127.0.0.1"),
                "{error}"
            );
            assert!(names(&cache).is_empty(), "{:?}", names(&cache));
        }
    }

    #[test]
    fn the_encoder_of_the_perceptual_loss_is_checked_by_its_tensors() {
        let cache = tempfile::tempdir().unwrap();
        let bytes = std::fs::read(golden("tiny_model.pt")).unwrap();
        let size = bytes.len() as u64;
        let server = Server::start(bytes, "v1", vec![Answer::Whole]);
        let release = Release {
            address: server.address(),
            sizes: size..=size,
            ..Release::resnet50dilated()
        };
        let error = fetch(&release, cache.path(), |_| {})
            .unwrap_err()
            .to_string();
        assert!(error.contains("not the encoder resnet50dilated"), "{error}");
        assert!(names(&cache).is_empty());
    }

    #[test]
    fn another_file_than_the_recorded_one_does_not_get_the_name() {
        let cache = tempfile::tempdir().unwrap();
        attempt(vec![Answer::Whole], cache.path()).0.unwrap();
        std::fs::remove_file(cache.path().join(RELEASE_FILE)).unwrap();
        let file = cache.path().join(format!("{RELEASE_FILE}.json"));
        let text = std::fs::read_to_string(&file).unwrap();
        let hash = text.split('"').find(|part| part.len() == 64).unwrap();
        std::fs::write(&file, text.replace(hash, &"0".repeat(64))).unwrap();
        let error = attempt(vec![Answer::Whole], cache.path()).0.unwrap_err();
        assert!(error.to_string().contains("recorded on"), "{error}");
        assert!(!names(&cache).contains(&RELEASE_FILE.to_owned()));
    }
}
