//! How the numbers came about: what each key means, the methods, the datasets, the facts of the run, what failed.

use std::fmt::Write as _;

use super::Page;
use crate::report::escape::escape;

/// Failures listed in the page at most.
const FAILURES: usize = 200;

/// The section.
pub fn section(out: &mut String, page: &Page<'_>) {
    out.push_str("<section id=\"provenance\">\n<h2>How the numbers came about</h2>\n");
    failures(out, page);
    out.push_str(
        "<h3>Metrics</h3>\n<div class=\"scroll\"><table class=\"facts\"><thead><tr><th scope=\"col\">Key</th>\
         <th scope=\"col\">Direction</th><th scope=\"col\">Convention</th></tr></thead><tbody>\n",
    );
    for metric in page.input.metrics.iter().chain(&page.input.extras) {
        let unit = if metric.unit.is_empty() {
            String::new()
        } else {
            format!(", in {}", escape(&metric.unit))
        };
        let _ = writeln!(
            out,
            "<tr><th scope=\"row\"><code>{}</code></th><td>{}{unit}</td><td>{}</td></tr>",
            escape(&metric.key),
            metric.better.words(),
            escape(&metric.convention)
        );
    }
    out.push_str("</tbody></table></div>\n");
    let methods = page.board.methods.iter();
    let methods = methods.map(|m| (m.label.as_str(), m.description.as_str()));
    described(out, "Methods", methods);
    let datasets = page.board.datasets.iter();
    let datasets = datasets.map(|d| (d.dataset.name.as_str(), d.dataset.description.as_str()));
    described(out, "Datasets", datasets);
    for group in &page.input.facts {
        let facts = group
            .facts
            .iter()
            .map(|(name, value)| (name.as_str(), value.as_str()));
        described(out, &group.title, facts);
    }
    out.push_str("</section>\n");
}

fn described<'a>(out: &mut String, title: &str, facts: impl Iterator<Item = (&'a str, &'a str)>) {
    let rows: Vec<_> = facts.filter(|(_, value)| !value.is_empty()).collect();
    if rows.is_empty() {
        return;
    }
    let _ = write!(
        out,
        "<h3>{}</h3>\n<div class=\"scroll\"><table class=\"facts\"><tbody>\n",
        escape(title)
    );
    for (name, value) in rows {
        let _ = writeln!(
            out,
            "<tr><th scope=\"row\">{}</th><td>{}</td></tr>",
            escape(name),
            escape(value)
        );
    }
    out.push_str("</tbody></table></div>\n");
}

fn failures(out: &mut String, page: &Page<'_>) {
    let failures = page.board.failures();
    if failures.is_empty() {
        return;
    }
    let _ = write!(
        out,
        "<details class=\"failures\" open><summary>{} of the predictions failed; they count as missing, and every \
         number says over how many pairs it is a mean</summary>\n<div class=\"scroll\"><table class=\"facts\"><thead><tr>\
         <th scope=\"col\">Pair</th><th scope=\"col\">Method</th><th scope=\"col\">Reason</th></tr></thead><tbody>\n",
        failures.len()
    );
    for (record, reason) in failures.iter().take(FAILURES) {
        let _ = writeln!(
            out,
            "<tr><th scope=\"row\"><code>{}</code></th><td>{}</td><td>{}</td></tr>",
            escape(&record.pair_id),
            escape(&record.method),
            escape(reason)
        );
    }
    out.push_str("</tbody></table></div>\n");
    if failures.len() > FAILURES {
        let _ = writeln!(
            out,
            "<p>And {} more, in the records of the run.</p>",
            failures.len() - FAILURES
        );
    }
    out.push_str("</details>\n");
}
