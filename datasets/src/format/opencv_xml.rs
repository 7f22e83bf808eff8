//! OpenCV's FileStorage in its XML form: named matrices and scalars.
//!
//! Only elements, attributes (skipped), comments and the XML declaration are understood. A
//! document type or an entity is refused: nothing in a camera file needs one.

use std::collections::BTreeMap;
use std::path::Path;

use crate::{DatasetError, files};

/// The top level of a storage: element name to what it holds.
pub type Storage = BTreeMap<String, Node>;

/// A value in a storage.
#[derive(Debug, Clone, PartialEq)]
pub enum Node {
    /// A number.
    Number(f64),
    /// A matrix, row by row. Entries may be NaN or infinite, as written.
    Matrix {
        /// Number of rows.
        rows: usize,
        /// Number of columns.
        cols: usize,
        /// rows · cols numbers.
        data: Vec<f64>,
    },
    /// Anything else.
    Text(String),
}

/// Reads a storage.
///
/// # Errors
/// Names the file: not XML, not closed, a matrix whose entries do not match its size.
pub fn read(path: &Path) -> Result<Storage, DatasetError> {
    parse(&files::read_text(path)?).map_err(|reason| DatasetError::malformed(path, reason))
}

/// As [`read`], from text; the error is the bare reason.
///
/// # Errors
/// See [`read`].
pub fn parse(text: &str) -> Result<Storage, String> {
    if text.trim_start().starts_with("%YAML") {
        return Err("this is OpenCV's YAML form; only the XML form is read".into());
    }
    let mut parser = Parser { rest: text };
    let root = loop {
        match parser.next()? {
            Token::Open(name) => break parser.element(name, 0)?,
            Token::Text(t) if t.trim().is_empty() => {}
            _ => return Err("not an XML file".into()),
        }
    };
    if root.name != "opencv_storage" {
        return Err(format!(
            "the root element is <{}>, not <opencv_storage>",
            root.name
        ));
    }
    root.children
        .into_iter()
        .map(|child| Ok((child.name.clone(), node(child)?)))
        .collect()
}

fn node(element: Element) -> Result<Node, String> {
    let child = |name: &str| element.children.iter().find(|c| c.name == name);
    if let (Some(rows), Some(cols), Some(data)) = (child("rows"), child("cols"), child("data")) {
        let side = |e: &Element| {
            e.text
                .trim()
                .parse::<usize>()
                .map_err(|_| format!("<{}> of {} is '{}'", e.name, element.name, e.text.trim()))
        };
        let (rows, cols) = (side(rows)?, side(cols)?);
        let data = data
            .text
            .split_ascii_whitespace()
            .map(|t| number(t).ok_or_else(|| format!("{} holds '{t}'", element.name)))
            .collect::<Result<Vec<_>, _>>()?;
        if rows.checked_mul(cols) != Some(data.len()) {
            return Err(format!(
                "{} is {rows}x{cols} but has {} entries",
                element.name,
                data.len()
            ));
        }
        return Ok(Node::Matrix { rows, cols, data });
    }
    let text = element.text.trim();
    Ok(number(text).map_or_else(|| Node::Text(text.to_owned()), Node::Number))
}

/// A number as OpenCV writes it: `1.`, `1e+00`, `.Nan`, `-.Inf`.
fn number(text: &str) -> Option<f64> {
    match text.to_ascii_lowercase().as_str() {
        ".nan" | "-.nan" => Some(f64::NAN),
        ".inf" | "+.inf" => Some(f64::INFINITY),
        "-.inf" => Some(f64::NEG_INFINITY),
        other => other.parse().ok(),
    }
}

struct Element {
    name: String,
    text: String,
    children: Vec<Element>,
}

enum Token<'a> {
    Open(&'a str),
    Empty(&'a str),
    Close(&'a str),
    Text(&'a str),
}

struct Parser<'a> {
    rest: &'a str,
}

impl<'a> Parser<'a> {
    fn next(&mut self) -> Result<Token<'a>, String> {
        loop {
            if self.rest.is_empty() {
                return Err("the file ends before its last element is closed".into());
            }
            if !self.rest.starts_with('<') {
                let end = self.rest.find('<').unwrap_or(self.rest.len());
                let (text, rest) = self.rest.split_at(end);
                self.rest = rest;
                return Ok(Token::Text(text));
            }
            if let Some(rest) = self.rest.strip_prefix("<!--") {
                self.rest = rest.split_once("-->").ok_or("a comment is not closed")?.1;
                continue;
            }
            let (tag, rest) = self.rest[1..]
                .split_once('>')
                .ok_or("a tag is not closed")?;
            self.rest = rest;
            if tag.starts_with('?') {
                continue;
            }
            if tag.starts_with('!') {
                return Err("document types and entities are not accepted".into());
            }
            let name = |tag: &'a str| tag.split_ascii_whitespace().next().unwrap_or("");
            return Ok(if let Some(tag) = tag.strip_prefix('/') {
                Token::Close(name(tag))
            } else if let Some(tag) = tag.strip_suffix('/') {
                Token::Empty(name(tag))
            } else {
                Token::Open(name(tag))
            });
        }
    }

    fn element(&mut self, name: &str, depth: usize) -> Result<Element, String> {
        if depth > 16 {
            return Err("elements are nested too deeply".into());
        }
        let mut element = Element {
            name: name.to_owned(),
            text: String::new(),
            children: Vec::new(),
        };
        loop {
            match self.next()? {
                Token::Text(text) => element.text.push_str(text),
                Token::Open(child) => element.children.push(self.element(child, depth + 1)?),
                Token::Empty(child) => element.children.push(Element {
                    name: child.to_owned(),
                    text: String::new(),
                    children: Vec::new(),
                }),
                Token::Close(closed) if closed == name => return Ok(element),
                Token::Close(closed) => {
                    return Err(format!("<{name}> is closed by </{closed}>"));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matrices_and_scalars_are_read() {
        let storage = parse(
            "<?xml version=\"1.0\"?>\n<opencv_storage>\n<!-- made by hand -->\n\
             <m type_id=\"opencv-matrix\"><rows>2</rows><cols>2</cols><dt>d</dt><data>\n\
             1. -2.5e+01\n    .Nan -.Inf</data></m>\n<b>8.0e+01</b><s>text</s><e/></opencv_storage>\n",
        )
        .unwrap();
        let Node::Matrix { rows, cols, data } = &storage["m"] else {
            panic!("not a matrix");
        };
        assert_eq!((*rows, *cols), (2, 2));
        assert_eq!(data[..2], [1.0, -25.0]);
        assert!(data[2].is_nan() && data[3] == f64::NEG_INFINITY);
        assert_eq!(storage["b"], Node::Number(80.0));
        assert_eq!(storage["s"], Node::Text("text".into()));
    }

    #[test]
    fn hostile_and_broken_files_are_refused() {
        let nested = "<opencv_storage>".to_owned() + &"<a>".repeat(1000);
        for (text, reason) in [
            ("", "ends before"),
            ("hello", "not an XML"),
            ("%YAML:1.0", "YAML"),
            ("<a></a>", "not <opencv_storage>"),
            (
                "<!DOCTYPE x [<!ENTITY a \"b\">]><opencv_storage/>",
                "not accepted",
            ),
            ("<opencv_storage><a></opencv_storage>", "closed by"),
            ("<opencv_storage><a>", "ends before"),
            (nested.as_str(), "nested too deeply"),
            (
                "<opencv_storage><m><rows>3</rows><cols>3</cols><data>1 2</data></m></opencv_storage>",
                "3x3 but has 2",
            ),
        ] {
            let error = parse(text).unwrap_err();
            assert!(error.contains(reason), "{error}");
        }
    }
}
