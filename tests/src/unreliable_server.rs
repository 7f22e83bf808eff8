//! A local HTTP server that misbehaves as instructed.

#![allow(
    clippy::unwrap_used,
    reason = "a test server that cannot work fails its test"
)]

use std::io::{self, BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex, PoisonError};

/// Reaction of the server to a request for `bytes[start..]`.
#[derive(Debug, Clone, Copy)]
pub enum Answer {
    /// Sends everything, whatever range was requested.
    Whole,
    /// Sends the requested range; reports if nothing is left.
    Rest,
    /// Closes the connection after the given number of bytes.
    Break(usize),
    /// Announces the given length instead of the true one, and sends as many bytes.
    Length(usize),
    /// Sends an HTML page.
    Page,
    /// Sends a status without a body.
    Status(u16),
}

/// The server; its thread ends with the test's process.
#[derive(Debug)]
pub struct Server {
    host: String,
    asked: Arc<Mutex<Vec<String>>>,
}

impl Server {
    /// Serves `bytes` under `tag`, with one answer per request; the last answer is repeated.
    pub fn start(bytes: Vec<u8>, tag: &'static str, answers: Vec<Answer>) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let host = format!("http://{}", listener.local_addr().unwrap());
        let asked = Arc::new(Mutex::new(Vec::new()));
        let log = Arc::clone(&asked);
        std::thread::spawn(move || {
            for (i, stream) in listener.incoming().enumerate() {
                let answer = answers[i.min(answers.len() - 1)];
                // Some tests close the connection early.
                let _ = respond(stream.unwrap(), &bytes, tag, answer, &log);
            }
        });
        Self { host, asked }
    }

    /// `http://127.0.0.1:PORT`.
    pub fn host(&self) -> &str {
        &self.host
    }

    /// The address of a file; every path is the same file.
    pub fn address(&self) -> String {
        format!("{}/weights.pth", self.host)
    }

    /// The heads of all requests so far, in lower case.
    pub fn requests(&self) -> Vec<String> {
        let asked = self.asked.lock().unwrap_or_else(PoisonError::into_inner);
        asked.clone()
    }

    /// The first byte that each request asked for.
    pub fn starts(&self) -> Vec<usize> {
        self.requests().iter().map(|head| start_of(head)).collect()
    }
}

fn start_of(head: &str) -> usize {
    head.lines()
        .find_map(|line| line.strip_prefix("range: bytes="))
        .map_or(0, |range| range.trim_end_matches('-').parse().unwrap())
}

fn respond(
    mut stream: TcpStream,
    bytes: &[u8],
    tag: &str,
    answer: Answer,
    log: &Mutex<Vec<String>>,
) -> io::Result<()> {
    let mut request = String::new();
    for line in BufReader::new(stream.try_clone()?).lines() {
        let line = line?.to_lowercase();
        if line.is_empty() {
            break;
        }
        request += &line;
        request.push('\n');
    }
    let start = start_of(&request);
    log.lock()
        .unwrap_or_else(PoisonError::into_inner)
        .push(request);
    let total = bytes.len();
    let mut head = |status: &str, length: usize, extra: &str| {
        write!(
            stream,
            "HTTP/1.1 {status}\r\nContent-Length: {length}\r\nETag: \"{tag}\"\r\n{extra}Connection: close\r\n\r\n"
        )
    };
    let range = format!(
        "Content-Range: bytes {start}-{}/{total}\r\n",
        total.saturating_sub(1)
    );
    match answer {
        Answer::Whole => {
            head("200 OK", total, "")?;
            stream.write_all(bytes)
        }
        Answer::Rest if start >= total => head(
            "416 Range Not Satisfiable",
            0,
            &format!("Content-Range: bytes */{total}\r\n"),
        ),
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
