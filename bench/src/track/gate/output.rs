//! Output of a gate: tables, JUnit XML for a build server, Markdown for a pull request comment.

use std::fmt::Write as _;

use super::{Check, CheckState, GateReport};
use crate::io::text::visible_line;
use crate::report::tables::grid::{GridCell, TextGrid};
use crate::report::tables::markdown::escape;
use crate::report::tables::shown;
use crate::track::compare::tables::p_text;

/// Maximum number of rows in a comment, because hosts truncate long comments.
const ROWS: usize = 40;

impl Check {
    /// Dataset, scene and methods: `eth3d, sharp`, `eth3d/office, old to new`.
    fn place(&self) -> String {
        let mut place = self.dataset.clone();
        if let Some(scene) = &self.scene {
            place += &format!("/{scene}");
        }
        if self.method_a == self.method_b {
            format!("{place}, {}", self.method_b)
        } else {
            format!("{place}, {} to {}", self.method_a, self.method_b)
        }
    }

    /// Cells for A, B, B − A, interval and p.
    fn numbers(&self) -> [GridCell; 5] {
        let number = |value| GridCell::optional(value, |value| shown(value, self.decimals));
        let difference = if self.limit.ends_with('%') {
            GridCell::optional(self.difference, |percent| {
                format!("{} %", shown(percent, 1))
            })
        } else {
            number(self.difference)
        };
        [
            number(self.a),
            number(self.b),
            difference,
            GridCell::interval(self.ci_low, self.ci_high, self.decimals),
            GridCell::optional(self.p_holm, p_text),
        ]
    }
}

/// One row per check.
fn grid<'a>(title: String, checks: impl Iterator<Item = &'a Check>) -> TextGrid {
    let rows = checks.map(|check| {
        let said = [
            check.state.text(),
            &check.limit,
            &check.quantity,
            &check.place(),
        ]
        .map(GridCell::words);
        let numbers = check.numbers().into_iter();
        said.into_iter()
            .chain(numbers)
            .chain([GridCell::words(&check.reason)])
            .collect()
    });
    let heads = [
        "", "limit", "of", "on", "A", "B", "B - A", "95 %", "p Holm", "",
    ];
    TextGrid::new(title, &heads, rows)
}

impl GateReport {
    /// Tables of all checks, then of the worst pairs if there are any.
    pub fn grids(&self) -> Vec<TextGrid> {
        let checks = grid(
            "A is the baseline, B the candidate".to_owned(),
            self.checks.iter(),
        );
        std::iter::once(checks).chain(self.worst_grid()).collect()
    }

    fn worst_grid(&self) -> Option<TextGrid> {
        let check = self.checks.get(self.worst_of?)?;
        let rows = self.worst.iter().map(|pair| {
            let number = |value: f64| GridCell::rounded(value, check.decimals);
            vec![
                GridCell::words(&pair.pair_id),
                number(pair.a),
                number(pair.b),
                number(pair.loss),
            ]
        });
        let title = format!("worst pairs, {} on {}", check.quantity, check.place());
        (!self.worst.is_empty())
            .then(|| TextGrid::new(title, &["pair", "A", "B", "worse by"], rows))
    }
}

/// Formats the report as JUnit XML, one test case per check: fired is a failure, inconclusive an
/// error, not compared is skipped.
pub fn junit(report: &GateReport) -> String {
    let count = |state| report.checks.iter().filter(|c| c.state == state).count();
    let mut out = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
    let _ = writeln!(
        out,
        "<testsuite name=\"sharp-bench gate\" tests=\"{}\" failures=\"{}\" errors=\"{}\" skipped=\"{}\">",
        report.checks.len(),
        count(CheckState::Fired),
        count(CheckState::Inconclusive),
        count(CheckState::NotCompared)
    );
    for check in &report.checks {
        let said = xml(&said(check));
        let said = match check.state {
            CheckState::Fired => format!("<failure message=\"{said}\"/>"),
            CheckState::Inconclusive => format!("<error message=\"{said}\"/>"),
            CheckState::NotCompared => format!("<skipped message=\"{said}\"/>"),
            CheckState::Passed | CheckState::NotSignificant => {
                format!("<system-out>{said}</system-out>")
            }
        };
        let _ = writeln!(
            out,
            "  <testcase classname=\"{}\" name=\"{}\">{said}</testcase>",
            xml(&check.place()),
            xml(&format!("{}: {}", check.limit, check.quantity))
        );
    }
    out.push_str("</testsuite>\n");
    out
}

/// One line on a check, such as `fired: 23.10 to 22.40, -0.70 (-0.90 .. -0.50), p 0.0010; reason`.
fn said(check: &Check) -> String {
    let [a, b, difference, interval, p] = check.numbers().map(|cell| cell.text);
    let mut said = check.state.text().to_owned();
    if check.difference.is_some() {
        said += &format!(": {a} to {b}, {difference}");
    }
    if check.p_holm.is_some() {
        said += &format!(" ({interval}), p {p}");
    }
    if !check.reason.is_empty() {
        said += &format!("; {}", check.reason);
    }
    said
}

/// Escapes text and attributes for XML 1.0.
fn xml(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in visible_line(text).chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\u{fffe}' | '\u{ffff}' => {
                let _ = write!(out, "\\u{:04x}", u32::from(c));
            }
            c => out.push(c),
        }
    }
    out
}

/// Outcome, checks with the most severe first, worst pairs, and the `compare` command that shows details.
pub fn markdown(report: &GateReport) -> String {
    let mut checks: Vec<&Check> = report.checks.iter().collect();
    checks.sort_by_key(|check| std::cmp::Reverse(check.state));
    let left_out = checks.len().saturating_sub(ROWS);
    checks.truncate(ROWS);
    let mut page = format!(
        "### Quality gate {}\n\nA is the baseline, B the candidate.\n\n{}",
        report.headline(),
        grid(String::new(), checks.into_iter()).markdown()
    );
    if left_out > 0 {
        let _ = writeln!(page, "\n{left_out} more rows are in the log.");
    }
    if let Some(worst) = report.worst_grid() {
        let _ = write!(page, "\n{}:\n\n{}", escape(&worst.title), worst.markdown());
    }
    for note in &report.notes {
        let _ = writeln!(page, "\nNote: {}.", escape(&visible_line(note)));
    }
    let command = report.compare_command();
    format!("{page}\nTo see more:\n\n    {}\n", visible_line(&command))
}
