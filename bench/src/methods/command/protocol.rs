//! Requests to the program and its answers: one line of JSON each.
//!
//! Request: `{"protocol":1,"pair_id":…,"source_picture":…,"write_to":…,"pair":{…}}`. Paths are absolute;
//! `source_picture` is a PNG, `pair` is the `pair.json` of `pairs export`, and the program writes its PNG to
//! `write_to`. With `depth=privileged`, `source_depth` is the source's true z-depth as `.npy`. With `scales=`, each
//! pair is requested once per scale, and `scale` is the factor by which the program multiplies the cameras' distance in
//! its own units; `pair` stays in metres.
//!
//! Answer: `{"pair_id":…}` if the picture was written to `write_to`. Optional keys are `"picture":PATH` if it was
//! written elsewhere (.png, .jpg, .exr, .npy), and `"extras":{NAME:NUMBER}` for additional columns of the scores.
//! `{"pair_id":…,"error":REASON}` means that the program could not predict this pair and is ready for the next one.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::methods::{MAX_EXTRAS, SourceView, TargetCamera};
use crate::pairs::description::PairDescription;

/// The source's files, by absolute path.
#[derive(Debug)]
pub(super) struct SourceFiles {
    /// Path of the picture, a PNG file.
    pub(super) picture: PathBuf,
    /// Path of the depth, a NumPy array of float32 metres `[H, W]`, 0 where unknown.
    pub(super) depth: Option<PathBuf>,
}

/// Protocol version; also passed to the program as `SHARP_BENCH_PROTOCOL`.
pub(super) const VERSION: u32 = 1;

#[derive(Debug, Serialize)]
pub(super) struct PairRequest<'a> {
    protocol: u32,
    pair_id: &'a str,
    source_picture: &'a Path,
    write_to: &'a Path,
    #[serde(skip_serializing_if = "Option::is_none")]
    source_depth: Option<&'a Path>,
    #[serde(skip_serializing_if = "Option::is_none")]
    scale: Option<f64>,
    pair: PairDescription,
}

impl<'a> PairRequest<'a> {
    pub(super) fn new(
        source: &SourceView,
        target: &TargetCamera<'a>,
        files: &'a SourceFiles,
        scale: Option<f64>,
        write_to: &'a Path,
    ) -> Self {
        Self {
            protocol: VERSION,
            pair_id: target.pair_id(),
            source_picture: &files.picture,
            write_to,
            source_depth: files.depth.as_deref(),
            scale,
            pair: PairDescription::new(target.pair_id(), source.camera(), target.camera()),
        }
    }

    pub(super) fn pair_id(&self) -> &'a str {
        self.pair_id
    }

    pub(super) fn to_line(&self) -> serde_json::Result<String> {
        let mut line = serde_json::to_string(self)?;
        line.push('\n');
        Ok(line)
    }
}

#[derive(Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Answer {
    pair_id: String,
    pub(super) picture: Option<PathBuf>,
    #[serde(default)]
    pub(super) extras: BTreeMap<String, f64>,
    pub(super) error: Option<String>,
}

impl Answer {
    /// Parses the answer for `pair_id`. Errors do not name the method.
    pub(super) fn parse(line: &str, pair_id: &str) -> Result<Self, String> {
        let answer: Self =
            serde_json::from_str(line).map_err(|error| format!("{}: {error}", no_answer(line)))?;
        if answer.pair_id != pair_id {
            return Err(format!(
                "it answered for pair '{}', which was not requested",
                excerpt(&answer.pair_id)
            ));
        }
        if answer.extras.len() > MAX_EXTRAS {
            return Err(format!(
                "it sent {} extras; a method reports at most {MAX_EXTRAS}",
                answer.extras.len()
            ));
        }
        for name in answer.extras.keys() {
            let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
            let reserved = name.starts_with("crop_")
                || name.starts_with("predicted_")
                || matches!(name.as_str(), "scored_share" | "valid_share");
            if name.is_empty() || !name.chars().all(plain) {
                return Err(format!(
                    "its extra '{}' may contain only lower-case letters, digits and '_'",
                    excerpt(name)
                ));
            }
            if reserved {
                return Err(format!(
                    "its extra '{}' has a reserved name (crop_…, predicted_…, scored_share, valid_share)",
                    excerpt(name)
                ));
            }
        }
        Ok(answer)
    }
}

/// Error for a line on standard output that is not an answer.
pub(super) fn no_answer(line: &str) -> String {
    format!(
        "not an answer (standard output is for answers only; print anything else to standard error): {}",
        excerpt(line)
    )
}

/// The beginning of a text, for use in an error.
pub(super) fn excerpt(text: &str) -> String {
    const CHARS: usize = 80;
    let mut short: String = text.chars().take(CHARS).collect();
    if text.chars().count() > CHARS {
        short.push('…');
    }
    short.escape_debug().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers() {
        let parse = |line: &str| Answer::parse(line, "a/b/c__d");
        let plain = parse(r#"{"pair_id":"a/b/c__d"}"#).unwrap();
        assert_eq!((plain.picture, plain.error), (None, None));
        let full = parse(r#"{"pair_id":"a/b/c__d","picture":"x.exr","extras":{"secs":2}}"#);
        let full = full.unwrap();
        assert_eq!(full.picture, Some("x.exr".into()));
        assert_eq!(full.extras["secs"], 2.0);
        let many = (0..33).map(|i| format!("\"e{i}\":1"));
        let many = many.collect::<Vec<_>>().join(",");
        let many = format!(r#"{{"pair_id":"a/b/c__d","extras":{{{many}}}}}"#);
        for (line, part) in [
            ("hello", "standard error): hello"),
            ("{}", "pair_id"),
            (r#"{"pair_id":"other"}"#, "not requested"),
            (r#"{"pair_id":"a/b/c__d","pciture":"x"}"#, "pciture"),
            (r#"{"pair_id":"a/b/c__d","extras":{"crop_x":1}}"#, "crop_x"),
            (r#"{"pair_id":"a/b/c__d","extras":{"a b":1}}"#, "a b"),
            (r#"{"pair_id":"a/b/c__d","extras":{"a":"b"}}"#, "f64"),
            (&many, "33 extras"),
        ] {
            let error = parse(line).unwrap_err();
            assert!(error.contains(part), "{line}: {error}");
        }
        let long = parse(&"x".repeat(10_000)).unwrap_err();
        assert!(long.len() < 400, "{long}");
    }
}
