//! Parses method instances of the command line: `KIND[:key=value,…]`.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::privilege::TrueDepth;

#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SpecError {
    #[error("method '{spec}': unknown kind; {known}")]
    UnknownKind { spec: String, known: String },
    /// An invalid option.
    #[error("method '{spec}': {reason}")]
    Malformed { spec: String, reason: String },
    /// An option names an unusable file, folder or device.
    #[error("method '{spec}': {reason}")]
    Refused { spec: String, reason: String },
}

/// A method as given on the command line: a kind, a label (by default the kind's name) and options.
///
/// Values that contain a comma are quoted with `'…'` or `"…"`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(with = "String")]
#[serde(into = "String", try_from = "String")]
pub struct MethodSpec {
    /// `target`, `copy`, `depth-splat`, ….
    pub kind: String,
    /// Value of the `method` column; unique within a run.
    pub label: String,
    pub options: BTreeMap<String, String>,
}

impl SpecError {
    /// The error's reason, without the spec.
    pub fn reason(self) -> String {
        match self {
            Self::UnknownKind { .. } => self.to_string(),
            Self::Malformed { reason, .. } | Self::Refused { reason, .. } => reason,
        }
    }
}

impl MethodSpec {
    pub fn error(&self, reason: impl Into<String>) -> SpecError {
        SpecError::Malformed {
            spec: self.to_string(),
            reason: reason.into(),
        }
    }

    pub(super) fn refused(&self, reason: impl ToString) -> SpecError {
        SpecError::Refused {
            spec: self.to_string(),
            reason: reason.to_string(),
        }
    }

    /// Fails on options that the kind does not have.
    pub fn expect_options(&self, known: &[&str]) -> Result<(), SpecError> {
        match self.options.keys().find(|k| !known.contains(&k.as_str())) {
            None => Ok(()),
            Some(key) if known.is_empty() => Err(self.error(format!(
                "unknown option '{key}'; the only option of {} is label",
                self.kind
            ))),
            Some(key) => Err(self.error(format!(
                "unknown option '{key}'; the options of {} are label, {}",
                self.kind,
                known.join(", ")
            ))),
        }
    }

    pub(super) fn option(&self, key: &str) -> Option<&str> {
        self.options.get(key).map(String::as_str)
    }

    /// Parses `depth=none|privileged`. For `privileged`, returns the argument: the use of true depth that this kind of
    /// method supports.
    pub(super) fn depth(&self, privileged: TrueDepth) -> Result<TrueDepth, SpecError> {
        match self.option("depth") {
            None | Some("none") => Ok(TrueDepth::None),
            Some("privileged") => Ok(privileged),
            Some(other) => Err(self.error(format!("depth={other}: expected none or privileged"))),
        }
    }

    /// A copy without `align=`, with a label of its own.
    pub(super) fn unaligned(&self) -> Self {
        let mut other = self.clone();
        other.options.remove("align");
        other.label.push_str("-unaligned");
        other
    }

    pub(super) fn folder(&self) -> Result<PathBuf, SpecError> {
        let Some(dir) = self.option("dir").map(PathBuf::from) else {
            return Err(self.error("needs dir=FOLDER"));
        };
        if !dir.is_dir() {
            return Err(self.refused(format!("{} is not a folder", dir.display())));
        }
        Ok(dir)
    }
}

impl FromStr for MethodSpec {
    type Err = SpecError;

    fn from_str(text: &str) -> Result<Self, SpecError> {
        let error = |reason: String| SpecError::Malformed {
            spec: text.to_owned(),
            reason,
        };
        let (kind, rest) = text.split_once(':').unwrap_or((text, ""));
        if kind.is_empty() {
            return Err(error("no kind before ':'".into()));
        }
        let mut options = BTreeMap::new();
        for item in split_outside_quotes(rest).map_err(&error)? {
            let Some((key, value)) = item.split_once('=') else {
                return Err(error(format!("'{item}' is not key=value")));
            };
            let value = unquote(value.trim()).to_owned();
            if options.insert(key.trim().to_owned(), value).is_some() {
                return Err(error(format!("option '{}' is given twice", key.trim())));
            }
        }
        let label = options.remove("label").unwrap_or_else(|| kind.to_owned());
        check_label(&label).map_err(error)?;
        Ok(Self {
            kind: kind.to_owned(),
            label,
            options,
        })
    }
}

/// The canonical spec: the kind, then the label unless it is the kind's name, then the options, sorted by key.
impl fmt::Display for MethodSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.kind)?;
        let label = (self.label != self.kind).then_some(("label", &self.label));
        let options = self
            .options
            .iter()
            .map(|(key, value)| (key.as_str(), value));
        let mut separator = ':';
        for (key, value) in label.into_iter().chain(options) {
            let is_plain = !value.contains([',', '\'', '"']) && value.trim() == value;
            let quote = ['\'', '"']
                .into_iter()
                .find(|quote| !value.contains(*quote));
            match quote.filter(|_| !is_plain) {
                Some(quote) => write!(f, "{separator}{key}={quote}{value}{quote}")?,
                None => write!(f, "{separator}{key}={value}")?,
            }
            separator = ',';
        }
        Ok(())
    }
}

impl From<MethodSpec> for String {
    fn from(spec: MethodSpec) -> Self {
        spec.to_string()
    }
}

impl TryFrom<String> for MethodSpec {
    type Error = SpecError;

    fn try_from(text: String) -> Result<Self, SpecError> {
        text.parse()
    }
}

/// Checks a label, which becomes a file name and a table row. Errors do not name the method.
pub fn check_label(label: &str) -> Result<(), String> {
    if label.is_empty() {
        return Err("the label is empty".into());
    }
    if label.starts_with('.') || label.chars().any(|c| c.is_control() || "/\\".contains(c)) {
        return Err(format!(
            "label '{}' must not start with a dot or contain a slash or control character",
            label.escape_debug()
        ));
    }
    Ok(())
}

fn split_outside_quotes(text: &str) -> Result<Vec<&str>, String> {
    let mut items = Vec::new();
    let (mut start, mut open) = (0, None);
    for (at, c) in text.char_indices() {
        match (open, c) {
            (None, '\'' | '"') => open = Some(c),
            (Some(quote), c) if c == quote => open = None,
            (None, ',') => {
                items.push(&text[start..at]);
                start = at + 1;
            }
            _ => {}
        }
    }
    if let Some(quote) = open {
        return Err(format!("quote {quote} is not closed"));
    }
    items.push(&text[start..]);
    items.retain(|item| !item.trim().is_empty());
    Ok(items)
}

fn unquote(value: &str) -> &str {
    for quote in ['\'', '"'] {
        if let Some(inner) = value
            .strip_prefix(quote)
            .and_then(|v| v.strip_suffix(quote))
        {
            return inner;
        }
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_labels_and_quoted_values() {
        let plain: MethodSpec = "depth-splat".parse().unwrap();
        assert_eq!(
            (plain.kind.as_str(), plain.label.as_str()),
            ("depth-splat", "depth-splat")
        );

        let full: MethodSpec = "command:label=mine,run='python my.py, twice'"
            .parse()
            .unwrap();
        assert_eq!(full.label, "mine");
        assert_eq!(full.options["run"], "python my.py, twice");
    }

    #[test]
    fn what_is_wrong_is_said() {
        for (text, part) in [
            (":label=x", "no kind"),
            ("copy:label", "not key=value"),
            ("copy:label=", "empty"),
            ("copy:label=a/b", "slash"),
            ("imported:dir=a,dir=b", "twice"),
            ("command:run='x", "not closed"),
        ] {
            let error = text.parse::<MethodSpec>().unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
        for text in [
            "copy",
            "command:label=m,files='a,b',run=\"it's, so\",timeout=3",
            "command:run=sh \"a b\" 'c'",
        ] {
            let spec: MethodSpec = text.parse().unwrap();
            assert_eq!(spec.to_string().parse(), Ok(spec), "{text}");
        }
        let spec: MethodSpec = "copy:speed=3".parse().unwrap();
        assert!(spec.expect_options(&[]).is_err());
        assert!(spec.expect_options(&["speed"]).is_ok());
    }
}
