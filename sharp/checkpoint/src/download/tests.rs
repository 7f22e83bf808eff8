//! Downloads from a misbehaving server.

use sharp_tests::unreliable_server::{Answer, Server};
use tempfile::TempDir;

use super::*;

const SIZE: usize = 300_000;

fn content() -> Vec<u8> {
    (0..SIZE).map(|i| (i * 31 % 251) as u8).collect()
}

struct Attempt {
    server: Server,
    folder: TempDir,
}

impl Attempt {
    fn with(answers: Vec<Answer>) -> Self {
        Self {
            server: Server::start(content(), "v1", answers),
            folder: tempfile::tempdir().unwrap(),
        }
    }

    fn part(&self) -> PathBuf {
        self.folder.path().join("file.part")
    }

    fn fetch(&self) -> Result<(), DownloadError> {
        let download = Download {
            address: self.server.address(),
            sizes: SIZE as u64 - 10..=SIZE as u64 + 10,
            size_text: "0.3 MB".to_owned(),
        };
        download.fetch(&self.part(), |at| assert!(at.done <= at.total))
    }

    fn left(&self) -> usize {
        fs::read_dir(self.folder.path()).unwrap().count()
    }
}

#[test]
fn a_whole_file_arrives_and_nothing_else_is_left() {
    let attempt = Attempt::with(vec![Answer::Whole]);
    attempt.fetch().unwrap();
    assert_eq!(fs::read(attempt.part()).unwrap(), content());
    assert_eq!(attempt.left(), 1);
}

#[test]
fn a_broken_transfer_is_resumed() {
    let answers = vec![
        Answer::Break(100_000),
        Answer::Break(50_000),
        Answer::Status(503),
        Answer::Rest,
    ];
    let attempt = Attempt::with(answers);
    attempt.fetch().unwrap();
    assert_eq!(fs::read(attempt.part()).unwrap(), content());
    assert_eq!(attempt.server.starts(), [0, 100_000, 150_000, 150_000]);
    // The request states the version of the partial file, so that only the same version is resumed.
    assert!(attempt.server.requests()[1].contains("if-range: \"v1\""));
}

#[test]
fn an_earlier_calls_part_is_resumed_also_when_it_is_whole() {
    let attempt = Attempt::with(vec![Answer::Rest]);
    fs::write(attempt.part(), &content()[..1000]).unwrap();
    attempt.fetch().unwrap();
    attempt.fetch().unwrap();
    assert_eq!(attempt.server.starts(), [1000, SIZE]);
    assert_eq!(fs::read(attempt.part()).unwrap(), content());
    // A partial file longer than the server's file is useless.
    fs::write(attempt.part(), vec![1; SIZE + 5]).unwrap();
    assert!(attempt.fetch().is_err());
    assert_eq!(attempt.left(), 0);
}

#[test]
fn a_server_that_cannot_resume_starts_again() {
    let attempt = Attempt::with(vec![Answer::Break(100_000), Answer::Whole]);
    attempt.fetch().unwrap();
    assert_eq!(attempt.server.starts(), [0, 100_000]);
    assert_eq!(fs::read(attempt.part()).unwrap(), content());
}

#[test]
fn a_server_that_gives_nothing_is_given_up_on_and_what_there_is_stays() {
    let attempt = Attempt::with(vec![Answer::Break(1000), Answer::Break(0)]);
    let error = attempt.fetch().unwrap_err().to_string();
    assert!(error.contains("127.0.0.1"), "{error}");
    assert_eq!(attempt.server.starts().len(), 1 + ATTEMPTS);
    assert_eq!(fs::read(attempt.part()).unwrap(), content()[..1000]);
}

#[test]
fn lies_about_the_size_pages_and_refusals_are_errors_and_leave_nothing() {
    let cases = [
        (Answer::Length(1000), "announced 1000 bytes"),
        (Answer::Length(1 << 30), "announced 1073741824 bytes"),
        (Answer::Page, "text instead of the file"),
        (Answer::Status(404), "status 404"),
    ];
    for (answer, reason) in cases {
        let attempt = Attempt::with(vec![answer]);
        let error = attempt.fetch().unwrap_err().to_string();
        assert!(error.contains(reason), "{error}");
        assert_eq!((attempt.server.starts().len(), attempt.left()), (1, 0));
    }
}

#[test]
fn a_refusal_does_not_cost_what_is_there() {
    let attempt = Attempt::with(vec![Answer::Status(403)]);
    fs::write(attempt.part(), b"begun").unwrap();
    assert!(attempt.fetch().is_err());
    assert_eq!(fs::read(attempt.part()).unwrap(), b"begun");
}

#[test]
fn a_folder_that_is_not_there_is_named() {
    let server = Server::start(content(), "v1", vec![Answer::Whole]);
    let download = Download {
        address: server.address(),
        sizes: 0..=u64::MAX,
        size_text: String::new(),
    };
    let error = download.fetch(Path::new("no/such/folder/part"), |_| {});
    assert!(error.unwrap_err().to_string().contains("no/such/folder"));
}
