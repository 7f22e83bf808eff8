//! What a gate says, for other programs: JUnit XML for a build server, Markdown for a comment on a pull request.

use std::fmt::Write as _;

use super::{Check, GateReport, State};
use crate::io::text::visible_line;
use crate::report::tables::markdown::escape;
use crate::report::tables::shown;

/// Rows of a comment at most: forges cut long ones.
const ROWS: usize = 40;

impl Check {
    /// Where it looks: `eth3d`, `eth3d/office`, and the methods where their labels differ.
    pub fn place(&self) -> String {
        let mut place = self.dataset.clone();
        if let Some(scene) = &self.scene {
            place += &format!("/{scene}");
        }
        match self.method_a == self.method_b {
            true => format!("{place}, {}", self.method_b),
            false => format!("{place}, {} to {}", self.method_a, self.method_b),
        }
    }

    /// The limit, and the metric's key where the limit has another name for it.
    fn title(&self) -> String {
        match self.limit.starts_with(&self.quantity) {
            true => self.limit.clone(),
            false => format!("{}: {}", self.limit, self.quantity),
        }
    }

    /// A, B, B − A, the interval and p as a table shows them; `-` for what is not known.
    pub fn cells(&self) -> [String; 5] {
        let number = |value: Option<f64>| {
            value.map_or_else(|| "-".to_owned(), |value| shown(value, self.decimals))
        };
        let is_cost = self.limit.ends_with('%');
        let difference = match self.difference {
            Some(percent) if is_cost => format!("{} %", shown(percent, 1)),
            other => number(other),
        };
        let interval = match (self.ci_low, self.ci_high) {
            (None, None) => "-".to_owned(),
            (low, high) => format!("{} .. {}", number(low), number(high)),
        };
        let p = match self.p_holm {
            None => "-".to_owned(),
            Some(p) if p < 0.0001 => "<0.0001".to_owned(),
            Some(p) => format!("{p:.4}"),
        };
        [number(self.a), number(self.b), difference, interval, p]
    }
}

/// A test case a check: fired is a failure, inconclusive an error, not compared skipped.
pub fn junit(report: &GateReport) -> String {
    let count = |state| report.checks.iter().filter(|c| c.state == state).count();
    let mut out = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
    let _ = writeln!(
        out,
        "<testsuite name=\"sharp-bench gate\" tests=\"{}\" failures=\"{}\" errors=\"{}\" skipped=\"{}\">",
        report.checks.len(),
        count(State::Fired),
        count(State::Inconclusive),
        count(State::NotCompared)
    );
    for check in &report.checks {
        let said = xml(&said(check));
        let _ = write!(
            out,
            "  <testcase classname=\"{}\" name=\"{}\">",
            xml(&check.place()),
            xml(&check.title())
        );
        let _ = match check.state {
            State::Fired => write!(out, "<failure message=\"{said}\"/>"),
            State::Inconclusive => write!(out, "<error message=\"{said}\"/>"),
            State::NotCompared => write!(out, "<skipped message=\"{said}\"/>"),
            State::Passed | State::NotSignificant => {
                write!(out, "<system-out>{said}</system-out>")
            }
        };
        out.push_str("</testcase>\n");
    }
    out.push_str("</testsuite>\n");
    out
}

/// `fired: 23.10 to 22.40, -0.70 (-0.90 .. -0.50), p 0.0010; reason`.
fn said(check: &Check) -> String {
    let [a, b, difference, interval, p] = check.cells();
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

/// Text that XML 1.0 can hold, also between quotes.
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

/// What names, reads and mentions nobody: neither markup nor `@someone`.
fn text(text: &str) -> String {
    escape(&visible_line(text)).replace('@', "@&#8203;")
}

/// Verdict, what was judged, the worst pairs, and how to see more.
pub fn markdown(report: &GateReport) -> String {
    let mut out = format!("### Quality gate {}\n\n", text(&report.headline()));
    out.push_str("A is the baseline, B what is judged.\n\n");
    out.push_str("| | limit | on | A | B | B − A | 95 % | p | |\n|:---|:---|:---|---:|---:|---:|---:|---:|:---|\n");
    let mut checks: Vec<&Check> = report.checks.iter().collect();
    checks.sort_by_key(|check| std::cmp::Reverse(check.state));
    for check in checks.iter().take(ROWS) {
        let state = match check.state {
            State::Fired => "**fired**",
            other => other.text(),
        };
        let [a, b, difference, interval, p] = check.cells();
        let _ = writeln!(
            out,
            "| {state} | {} | {} | {a} | {b} | {difference} | {interval} | {} | {} |",
            text(&check.title()).replace(": ", "<br>"),
            text(&check.place()),
            text(&p),
            text(&check.reason)
        );
    }
    if checks.len() > ROWS {
        let _ = writeln!(out, "\n{} more rows are in the log.", checks.len() - ROWS);
    }
    if let Some(check) = report.worst_of.and_then(|at| report.checks.get(at)) {
        let _ = match report.worst.as_slice() {
            [] => writeln!(out, "\nNo pair lost {}.", text(&check.quantity)),
            _ => writeln!(
                out,
                "\nWorst pairs, {} on {}:\n\n| pair | A | B | worse by |\n|:---|---:|---:|---:|",
                text(&check.quantity),
                text(&check.place())
            ),
        };
        for pair in &report.worst {
            let number = |value| shown(value, check.decimals);
            let (a, b, loss) = (number(pair.a), number(pair.b), number(pair.loss));
            let _ = writeln!(out, "| {} | {a} | {b} | {loss} |", text(&pair.pair_id));
        }
    }
    for note in &report.notes {
        let _ = writeln!(out, "\nNote: {}.", text(note));
    }
    let command = report.compare_command();
    let _ = write!(out, "\nTo see more:\n\n    {}\n", visible_line(&command));
    out
}
