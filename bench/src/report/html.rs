//! Style shared by all pages, and functions that embed data and plots in them.

use serde_json::Value;
use sharp_plots::ink::{GRID, INK, MUTED, PAPER};

pub(crate) const STYLE: &str = include_str!("../../templates/style.css");
pub(crate) const VERSION: &str = env!("CARGO_PKG_VERSION");
/// JSON that is safe inside a `script` element: without `<`.
pub(crate) fn without_tags(value: &Value) -> String {
    value.to_string().replace('<', "\\u003c")
}

/// Replaces an SVG's colours for paper, ink and grid by the page's variables, so that it follows the page's theme.
pub(crate) fn themed(svg: &str) -> String {
    let mut out = svg.to_owned();
    for (ink, variable) in [
        (PAPER, "var(--card)"),
        (INK, "var(--ink)"),
        (MUTED, "var(--muted)"),
        (GRID, "var(--grid)"),
    ] {
        for attribute in ["fill", "stroke"] {
            let from = format!("{attribute}=\"{}\"", ink.hex());
            out = out.replace(&from, &format!("{attribute}=\"{variable}\""));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plots_take_the_colours_of_the_page() {
        let svg = "<rect fill=\"#FFFFFF\"/><text fill=\"#1B1F24\">#FFFFFF</text>";
        assert_eq!(
            themed(svg),
            "<rect fill=\"var(--card)\"/><text fill=\"var(--ink)\">#FFFFFF</text>"
        );
    }
}
