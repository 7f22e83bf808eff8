//! OpenCV's FileStorage in its XML form: named matrices and scalars.

use std::collections::BTreeMap;

use super::FormatError;

/// Top level of an OpenCV `FileStorage`: values, keyed by the name of their element.
pub type FileStorage = BTreeMap<String, Node>;

/// A value of a [`FileStorage`].
#[derive(Debug, Clone, PartialEq)]
pub enum Node {
    Number(f64),
    /// A matrix in row-major order. Entries may be NaN or infinite, as stored.
    Matrix {
        rows: usize,
        cols: usize,
        data: Vec<f64>,
    },
    /// An element that is not a matrix, as text.
    Text(String),
}

/// Parses the XML that OpenCV's `FileStorage` writes.
///
/// # Errors
/// If the XML is malformed or has a document type (which no camera file needs), or the entries of a matrix do not match
/// its size.
pub fn parse(text: &str) -> Result<FileStorage, FormatError> {
    if text.trim_start().starts_with("%YAML") {
        let reason = "this is OpenCV's YAML form; only the XML form is read";
        return Err(FormatError::Unsupported(reason.to_owned()));
    }
    let document =
        roxmltree::Document::parse(text).map_err(|error| invalid!("not an XML file: {error}"))?;
    let root = document.root_element();
    if !root.has_tag_name("opencv_storage") {
        let name = root.tag_name().name();
        return Err(invalid!(
            "the root element is <{name}>, not <opencv_storage>"
        ));
    }
    let children = root.children().filter(roxmltree::Node::is_element);
    children
        .map(|child| Ok((child.tag_name().name().to_owned(), node(child)?)))
        .collect()
}

fn node(element: roxmltree::Node<'_, '_>) -> Result<Node, FormatError> {
    let name = element.tag_name().name();
    let child = |name: &str| element.children().find(|c| c.has_tag_name(name));
    let (Some(rows), Some(cols), Some(data)) = (child("rows"), child("cols"), child("data")) else {
        let text = text_of(element).trim().to_owned();
        return Ok(number(&text).map_or_else(|| Node::Text(text), Node::Number));
    };
    let side = |side: roxmltree::Node<'_, '_>| {
        let (what, text) = (side.tag_name().name(), text_of(side));
        let side = text.trim().parse::<usize>();
        side.map_err(|_| invalid!("<{what}> of {name} is '{}', not a count", text.trim()))
    };
    let (rows, cols) = (side(rows)?, side(cols)?);
    let data = text_of(data)
        .split_ascii_whitespace()
        .map(|t| number(t).ok_or_else(|| invalid!("{name} contains '{t}', which is not a number")))
        .collect::<Result<Vec<_>, _>>()?;
    if rows.checked_mul(cols) != Some(data.len()) {
        let entries = data.len();
        return Err(invalid!(
            "{name} is {rows}x{cols} but has {entries} entries"
        ));
    }
    Ok(Node::Matrix { rows, cols, data })
}

/// Concatenates the text directly inside an element, which comments may split.
fn text_of(element: roxmltree::Node<'_, '_>) -> String {
    let texts = element.children().filter(roxmltree::Node::is_text);
    texts.filter_map(|text| text.text()).collect()
}

/// Parses a number as OpenCV writes it: `1.`, `1e+00`, `.Nan`, `-.Inf`.
fn number(text: &str) -> Option<f64> {
    match text.to_ascii_lowercase().as_str() {
        ".nan" | "-.nan" => Some(f64::NAN),
        ".inf" | "+.inf" => Some(f64::INFINITY),
        "-.inf" => Some(f64::NEG_INFINITY),
        other => other.parse().ok(),
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
        let nested = "<opencv_storage>".to_owned() + &"<a>".repeat(100_000);
        for (text, reason) in [
            ("", "not an XML"),
            ("hello", "not an XML"),
            ("<a></a>", "not <opencv_storage>"),
            ("<!DOCTYPE x [<!ENTITY a \"b\">]><opencv_storage/>", "DTD"),
            ("<opencv_storage><a></opencv_storage>", "expected 'a' tag"),
            ("<opencv_storage><a>", "never closed"),
            (nested.as_str(), "never closed"),
            (
                "<opencv_storage><m><rows>3</rows><cols>3</cols><data>1 2</data></m></opencv_storage>",
                "3x3 but has 2",
            ),
        ] {
            let error = parse(text).unwrap_err();
            assert!(
                matches!(&error, FormatError::Invalid(found) if found.contains(reason)),
                "{error}"
            );
        }
        assert!(matches!(
            parse("%YAML:1.0"),
            Err(FormatError::Unsupported(_))
        ));
    }
}
