//! JSON as written by Python and by hand: bare `NaN` and `Infinity`, trailing commas. Implemented
//! as a pass before `serde_json`, which limits nesting. JSON5 would accept far more than these
//! files contain.

use serde_json::Value;

use super::FormatError;

/// Parses JSON, replacing `NaN`, `Infinity` and `-Infinity` with `null` and ignoring commas before a closing bracket.
///
/// # Errors
/// If the text is not JSON; states the line and column.
pub fn parse(text: &str) -> Result<Value, FormatError> {
    serde_json::from_str(&strict(text)).map_err(|e| invalid!("not JSON: {e}"))
}

/// Converts the document to strict JSON. Only the replaced words change its length.
fn strict(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text.trim_start_matches('\u{feff}');
    while let Some(c) = rest.chars().next() {
        if c == '"' {
            let (string, after) = split_string(rest);
            out.push_str(string);
            rest = after;
            continue;
        }
        if c == ',' && rest[1..].trim_start().starts_with([']', '}']) {
            rest = &rest[1..];
            continue;
        }
        let word = ["NaN", "-Infinity", "Infinity"]
            .into_iter()
            .find(|word| rest.starts_with(word));
        if let Some(word) = word {
            out.push_str("null");
            rest = &rest[word.len()..];
            continue;
        }
        out.push(c);
        rest = &rest[c.len_utf8()..];
    }
    out
}

/// Splits text into a string literal with its quotes, and the rest.
fn split_string(text: &str) -> (&str, &str) {
    let mut escaped = false;
    for (i, c) in text.char_indices().skip(1) {
        match c {
            _ if escaped => escaped = false,
            '\\' => escaped = true,
            '"' => return text.split_at(i + 1),
            _ => {}
        }
    }
    (text, "")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_python_writes_is_read() {
        let value =
            parse("\u{feff}{\"a\": [NaN, -Infinity, 1.5,], \"NaN,]\": \"\\\"NaN\", }").unwrap();
        assert_eq!(value["a"], serde_json::json!([null, null, 1.5]));
        assert_eq!(value["NaN,]"], "\"NaN");
    }

    #[test]
    fn other_mistakes_are_errors() {
        for text in ["", "{", "[1 2]", "{\"a\": NaNa}", "\"abc", "[,]x"] {
            assert!(parse(text).is_err(), "{text}");
        }
        let deep = "[".repeat(100_000);
        assert!(parse(&deep).is_err());
    }
}
