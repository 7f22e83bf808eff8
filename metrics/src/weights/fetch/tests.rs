//! Fetching from a server that misbehaves.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};

use sharp_checkpoint::deterministic::backbone_weights;
use sharp_checkpoint::{DType, OutTensor, write_safetensors};

use super::*;
use crate::backbone::architecture;

/// A whole squeezenet1_1 with a classifier, as bytes of a safetensors file.
fn weights() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("full");
    let mut tensors: Vec<OutTensor> = architecture::tensors(Backbone::SqueezeNet1_1)
        .into_iter()
        .map(|tensor| OutTensor {
            name: format!("features.{}", tensor.name),
            dtype: DType::F32,
            shape: tensor.shape,
        })
        .collect();
    tensors.push(OutTensor {
        name: "classifier.1.bias".into(),
        dtype: DType::F32,
        shape: vec![1000],
    });
    write_safetensors(&path, &BTreeMap::new(), &tensors, |tensor| {
        let values = backbone_weights("", &tensor.name, &tensor.shape);
        let bytes = values.iter().flat_map(|v| v.to_le_bytes());
        Ok(Cow::Owned(bytes.collect()))
    })
    .unwrap();
    std::fs::read(path).unwrap()
}

/// What a server does with one request for `bytes[start..]`.
#[derive(Clone, Copy)]
enum Answer {
    Whole,
    /// Resumes, as asked.
    Rest,
    /// Closes the connection after so many bytes.
    Break(usize),
    /// Announces another length and sends that much.
    Length(usize),
    Page,
    Status(u16),
}

/// Serves `bytes`, one answer a request; the last one again and again. Returns the address and the
/// starts that were asked for.
fn serve(bytes: Vec<u8>, answers: Vec<Answer>) -> (String, Arc<Mutex<Vec<usize>>>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}/w.pth", listener.local_addr().unwrap());
    let asked = Arc::new(Mutex::new(Vec::new()));
    let log = asked.clone();
    std::thread::spawn(move || {
        for (i, stream) in listener.incoming().enumerate() {
            let answer = answers[i.min(answers.len() - 1)];
            // A client that hangs up early is part of the tests.
            let _ = respond(stream.unwrap(), &bytes, answer, &log);
        }
    });
    (address, asked)
}

fn respond(
    mut stream: TcpStream,
    bytes: &[u8],
    answer: Answer,
    log: &Mutex<Vec<usize>>,
) -> std::io::Result<()> {
    let mut start = 0;
    for line in BufReader::new(stream.try_clone()?).lines() {
        let line = line?.to_lowercase();
        if let Some(range) = line.strip_prefix("range: bytes=") {
            start = range.trim_end_matches('-').parse().unwrap();
        }
        if line.is_empty() {
            break;
        }
    }
    log.lock().unwrap().push(start);
    let total = bytes.len();
    let mut head = |status: &str, length: usize, extra: &str| {
        write!(
            stream,
            "HTTP/1.1 {status}\r\nContent-Length: {length}\r\n{extra}Connection: close\r\n\r\n"
        )
    };
    let range = format!("Content-Range: bytes {start}-{}/{total}\r\n", total - 1);
    match answer {
        Answer::Whole => {
            head("200 OK", total, "")?;
            stream.write_all(bytes)
        }
        Answer::Rest => {
            head("206 Partial Content", total - start, &range)?;
            stream.write_all(&bytes[start..])
        }
        Answer::Break(count) => {
            if start > 0 {
                head("206 Partial Content", total - start, &range)?;
            } else {
                head("200 OK", total, "")?;
            }
            stream.write_all(&bytes[start..][..count])
        }
        Answer::Length(length) => {
            head("200 OK", length, "")?;
            stream.write_all(&vec![7; length])
        }
        Answer::Page => {
            let page = "<html>Please log in.</html>";
            head("200 OK", page.len(), "Content-Type: text/html\r\n")?;
            stream.write_all(page.as_bytes())
        }
        Answer::Status(status) => head(&format!("{status} No"), 0, ""),
    }
}

fn published(bytes: &[u8], address: String) -> Published {
    let digest = Sha256::digest(bytes);
    Published {
        backbone: Backbone::SqueezeNet1_1,
        file: "w-cafe.pth".into(),
        address: address.into(),
        size_milli_mib: (bytes.len() as u64 * 2000 + (1 << 20)) / (2 << 20),
        sha256_prefix: digest[..4].iter().map(|b| format!("{b:02x}")).collect(),
        licence: "none",
    }
}

fn attempt_with(
    answers: Vec<Answer>,
) -> (Result<PathBuf, FetchError>, Vec<usize>, tempfile::TempDir) {
    let bytes = weights();
    let (address, asked) = serve(bytes.clone(), answers);
    let cache = tempfile::tempdir().unwrap();
    let result = fetch(&published(&bytes, address), cache.path(), false, |_| {});
    let asked = asked.lock().unwrap().clone();
    (result, asked, cache)
}

fn leftovers(cache: &tempfile::TempDir) -> usize {
    std::fs::read_dir(cache.path()).unwrap().count()
}

#[test]
fn features_are_kept_with_the_hash_of_the_original() {
    let (result, _, cache) = attempt_with(vec![Answer::Whole]);
    let kept = Checkpoint::open(result.unwrap()).unwrap();
    assert!(!kept.contains("classifier.1.bias") && kept.contains("features.0.weight"));
    let digest = Sha256::digest(weights());
    let expected: String = digest.iter().map(|b| format!("{b:02x}")).collect();
    assert_eq!(kept.metadata()["source_sha256"], expected);
    assert_eq!(leftovers(&cache), 1);
    // A second call needs no server.
    let unreachable = Published {
        address: "http://127.0.0.1:9/w".into(),
        ..published(&weights(), String::new())
    };
    assert!(fetch(&unreachable, cache.path(), true, |_| {}).is_ok());
}

#[test]
fn a_broken_transfer_is_resumed() {
    let answers = vec![
        Answer::Break(100_000),
        Answer::Break(50_000),
        Answer::Status(503),
        Answer::Rest,
    ];
    let (result, asked, _cache) = attempt_with(answers);
    result.unwrap();
    assert_eq!(asked, [0, 100_000, 150_000, 150_000]);
}

#[test]
fn a_server_that_cannot_resume_starts_again() {
    let (result, asked, _cache) = attempt_with(vec![Answer::Break(100_000), Answer::Whole]);
    result.unwrap();
    assert_eq!(asked, [0, 100_000]);
}

#[test]
fn a_server_that_gives_nothing_is_given_up_on() {
    let (result, asked, _cache) = attempt_with(vec![Answer::Break(0)]);
    let error = result.unwrap_err().to_string();
    assert!(
        error.contains("127.0.0.1") && asked.len() == ATTEMPTS,
        "{error}"
    );
}

#[test]
fn lies_about_the_size_pages_and_refusals_are_errors_and_leave_nothing() {
    let cases = [
        (Answer::Length(1000), "announced 1000 bytes"),
        (Answer::Length(1 << 30), "announced 1073741824 bytes"),
        (Answer::Page, "a page of text"),
        (Answer::Status(404), "status 404"),
    ];
    for (answer, reason) in cases {
        let (result, asked, cache) = attempt_with(vec![answer]);
        let error = result.unwrap_err().to_string();
        assert!(error.contains(reason), "{error}");
        assert_eq!((asked.len(), leftovers(&cache)), (1, 0));
    }
}

#[test]
fn other_bytes_of_the_right_size_are_deleted() {
    let (result, _, cache) = attempt_with(vec![Answer::Length(weights().len())]);
    let error = result.unwrap_err().to_string();
    assert!(error.contains("should begin with"), "{error}");
    assert_eq!(leftovers(&cache), 0);
}

#[test]
fn offline_says_what_to_do_instead() {
    let cache = tempfile::tempdir().unwrap();
    let published = Published::of(Backbone::Vgg16);
    let error = fetch(&published, cache.path(), true, |_| {}).unwrap_err();
    assert!(error.to_string().contains("--weights vgg16=FILE"));
}
