//! Escapes untrusted text for terminals, pages and tables.

use std::borrow::Cow;

/// Characters that a terminal or page interprets instead of displaying: control characters and bidirectional marks.
fn is_obeyed(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Escapes control and bidirectional characters, except newlines and tabs, as `\uXXXX`. Escaping inside a JSON string
/// does not change its value.
pub fn visible(text: &str) -> Cow<'_, str> {
    escaped(text, |c| is_obeyed(c) && c != '\n' && c != '\t')
}

/// Like [`visible`], but also escapes newlines and tabs, for text that must stay on one line.
pub fn visible_line(text: &str) -> Cow<'_, str> {
    escaped(text, is_obeyed)
}

fn escaped(text: &str, is_escaped: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.contains(&is_escaped) {
        return text.into();
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_escaped(c) {
            out += &format!("\\u{:04x}", u32::from(c))
        } else {
            out.push(c)
        }
    }
    out.into()
}

/// An error with its causes on one line; skips causes that the text already contains.
pub fn one_line(error: &anyhow::Error) -> String {
    error
        .chain()
        .map(ToString::to_string)
        .fold(String::new(), |line, cause| {
            if line.is_empty() {
                cause
            } else if line.contains(&cause) {
                line
            } else {
                format!("{line}: {cause}")
            }
        })
}

/// Maximum length of a stored failure reason, characters.
const LONGEST_REASON: usize = 1000;

/// A reason as one line of bounded length, for table cells and CSV fields.
pub fn reason_line(text: &str) -> String {
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    shortened(&line, LONGEST_REASON).into_owned()
}

/// Shortens a text of more than `longest` characters: keeps both ends, and states the number of
/// omitted characters between the ends.
pub fn shortened(text: &str, longest: usize) -> Cow<'_, str> {
    let length = text.chars().count();
    if length <= longest {
        return text.into();
    }
    let (first, last) = (longest * 2 / 3, longest / 3);
    let head: String = text.chars().take(first).collect();
    let tail: String = text.chars().skip(length - last).collect();
    format!(
        "{head} [… {} characters left out …] {tail}",
        length - first - last
    )
    .into()
}

/// Shortens absolute paths to the part after the last slash, for readers on other machines: `/home/me/a.png` becomes
/// `…/a.png`. A path is taken to end at a blank, a quote, or punctuation that ends a phrase.
pub fn without_folders(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    let mut before = ' ';
    while let Some(c) = rest.chars().next() {
        let is_address = before == ':' && rest.starts_with("//") && !rest.starts_with("///");
        let ends = |c: char| c.is_whitespace() || "'\"`,;:()[]<>=".contains(c);
        let path = &rest[..rest.find(ends).unwrap_or(rest.len())];
        if c == '/' && ends(before) && !is_address && path.len() > 1 {
            let name = path.trim_end_matches('/').rsplit('/').next();
            out += "…/";
            out += name.unwrap_or_default();
            rest = &rest[path.len()..];
        } else {
            out.push(c);
            rest = &rest[c.len_utf8()..];
        }
        before = out.chars().next_back().unwrap_or(' ');
    }
    out
}

/// Whether spreadsheets would take the text for a formula, after any number of leading `'`.
fn is_formula(text: &str) -> bool {
    let start = text.trim_start_matches('\'');
    start.starts_with(['=', '+', '-', '@', '\t', '\r', '＝', '＋', '－', '＠'])
}

/// A CSV cell for untrusted text: prefixes `'` if a spreadsheet would evaluate the text;
/// [`csv_text`] removes the prefix. Numbers do not need this.
pub fn csv_cell(text: &str) -> Cow<'_, str> {
    if is_formula(text) {
        format!("'{text}").into()
    } else {
        text.into()
    }
}

/// Formats a header and rows as CSV.
pub fn csv_bytes<R: IntoIterator<Item: AsRef<[u8]>>>(
    head: impl IntoIterator<Item: AsRef<[u8]>>,
    rows: impl IntoIterator<Item = R>,
) -> Vec<u8> {
    // Writing to memory fails only for rows of unequal length, which `flexible` allows.
    let mut writer = csv::WriterBuilder::new()
        .flexible(true)
        .from_writer(Vec::new());
    let _ = writer.write_record(head);
    for row in rows {
        let _ = writer.write_record(row);
    }
    writer.into_inner().unwrap_or_default()
}

/// The text of a CSV cell, without the leading `'` that [`csv_cell`] adds to formulas; other cells
/// are unchanged.
pub fn csv_text(cell: &str) -> &str {
    match cell.strip_prefix('\'') {
        Some(text) if is_formula(text) => text,
        _ => cell,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_left_to_obey() {
        assert_eq!(visible("plain, 森\n\tx"), "plain, 森\n\tx");
        assert_eq!(visible_line("a\n\u{1b}[2J"), "a\\u000a\\u001b[2J");
        let hostile = "\u{1b}]0;x\u{7}\u{9b}31m\u{202e}gpj\u{2066}\u{200f}\u{7f}\r";
        let shown = visible(hostile);
        assert!(!shown.contains(is_obeyed), "{shown}");
        let json = serde_json::to_string(hostile).unwrap();
        let read: String = serde_json::from_str(&visible(&json)).unwrap();
        assert_eq!(read, hostile);
    }

    #[test]
    fn paths_of_this_machine_are_reduced_to_names() {
        for (text, reduced) in [
            ("/home/me/a.png: cannot be read", "…/a.png: cannot be read"),
            ("M:eth3d=/data/eth3d,right=im1", "M:eth3d=…/eth3d,right=im1"),
            (
                "run='python /opt/x/my.py' (/tmp/)",
                "run='python …/my.py' (…/tmp)",
            ),
            ("file:///home/me/a.png", "file:…/a.png"),
            (
                "see https://a.org/b/c, 3 / 4 and/or",
                "see https://a.org/b/c, 3 / 4 and/or",
            ),
        ] {
            assert_eq!(without_folders(text), reduced);
        }
    }

    #[test]
    fn reasons_keep_both_ends() {
        assert_eq!(reason_line(" a\n b "), "a b");
        let long = format!("first {} last", "é".repeat(1 << 20));
        let kept = reason_line(&long);
        assert!(kept.starts_with("first é") && kept.ends_with("é last"));
        assert!(kept.chars().count() < LONGEST_REASON + 50);
        assert!(kept.contains(&format!("{} characters left out", (1 << 20) + 11 - 999)));
    }

    #[test]
    fn formulas_become_text_and_come_back() {
        for text in ["=cmd|' /C calc'!A0", "-3.5+1", "'=x", "''@x", "\t=1"] {
            assert_eq!(csv_cell(text), format!("'{text}"));
            assert_eq!(csv_text(&csv_cell(text)), text);
        }
        for text in ["plain", "a=b", "'quoted'", ""] {
            assert_eq!(csv_cell(text), text);
            assert_eq!(csv_text(text), text);
        }
        // As written by another program.
        assert_eq!(csv_text("=x"), "=x");
    }
}
