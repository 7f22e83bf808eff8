//! A card per pair: source and target, then prediction, error and scores of each method.

use std::fmt::Write as _;

use crate::evaluate::record::{Record, Score, Status};
use crate::report::gallery::{GalleryPair, Shown};
use crate::report::input::{Better, Metric};
use crate::report::plots::palette::style;
use crate::report::tables::shown;

use super::Page;
use crate::report::escape::escape;

/// The section with its controls.
pub fn section(out: &mut String, page: &Page<'_>) {
    let gallery = page.gallery;
    let options = &page.input.options;
    out.push_str("<section id=\"pairs\">\n<h2>Pairs</h2>\n");
    if gallery.pairs.is_empty() {
        out.push_str("<p class=\"empty\">No pair to show.</p>\n</section>\n");
        return;
    }
    let how = if gallery.pairs.len() < gallery.of {
        format!(
            "{} of {} pairs: of each dataset the worst by mean score, then an even choice of the others; the scores \
             file has all of them.",
            gallery.pairs.len(),
            gallery.of
        )
    } else {
        "All pairs of the run.".into()
    };
    let _ = write!(
        out,
        "<p>{how} Pictures are reduced to at most {} pixels a side for this page ({:.0} MB for all); scores are those of \
         the full pictures. Error: absolute difference in sRGB, mean over the channels.</p>\n\
         <p class=\"scale\"><span>0</span><span class=\"errorbar\" role=\"img\" aria-label=\"Colour scale of the error \
         pictures, from black for none to pale yellow\"></span><span>≥ {}</span><span class=\"js hint\">Point at a \
         prediction to see the target in its place. Click any picture to enlarge it.</span></p>\n",
        gallery.side,
        options.picture_bytes as f64 / 1e6,
        options.error_max
    );
    controls(out, page);
    out.push_str("<div id=\"cards\">\n");
    let scored = scored_somewhere(page);
    for (order, pair) in gallery.pairs.iter().enumerate() {
        card(out, page, pair, order, &scored);
    }
    out.push_str(
        "</div>\n<p id=\"none\" class=\"empty\" hidden>No pair matches.</p>\n</section>\n",
    );
    out.push_str(VIEWER);
}

/// The large view; filled by the script.
const VIEWER: &str = "<dialog id=\"viewer\" aria-label=\"Pictures of a pair\">\n\
    <header><div><strong id=\"v-title\"></strong> <span id=\"v-sub\"></span></div>\
    <button type=\"button\" id=\"v-close\" aria-label=\"Close\">✕</button></header>\n\
    <div class=\"stage\"><img id=\"v-under\" alt=\"\"><img id=\"v-over\" alt=\"\">\
    <div id=\"v-bar\" aria-hidden=\"true\"></div><span id=\"v-what\" aria-live=\"polite\"></span></div>\n\
    <p id=\"v-scores\"></p>\n\
    <footer><div class=\"seg\" role=\"group\" aria-label=\"Picture\">\
    <button type=\"button\" data-view=\"source\">1 Source</button>\
    <button type=\"button\" data-view=\"target\">2 Target</button>\
    <button type=\"button\" data-view=\"prediction\">3 Prediction</button>\
    <button type=\"button\" data-view=\"error\">4 Error</button>\
    <button type=\"button\" data-view=\"compare\">5 Compare</button></div>\
    <div class=\"seg\" role=\"group\" aria-label=\"Method\" id=\"v-methods\"></div>\
    <small>← → pair · ↑ ↓ method · 1–5 picture · space target ⇄ prediction · Esc</small></footer>\n</dialog>\n";

fn controls(out: &mut String, page: &Page<'_>) {
    out.push_str("<div id=\"controls\" class=\"js\">\n");
    out.push_str("<label>Dataset <select id=\"f-dataset\"><option value=\"\">all</option>");
    for (d, dataset) in page.board.datasets.iter().enumerate() {
        let _ = write!(
            out,
            "<option value=\"{d}\">{}</option>",
            escape(&dataset.dataset.name)
        );
    }
    out.push_str("</select></label>\n<label>Sort by <select id=\"f-sort\"><option value=\"order\">run order</option>");
    for (m, metric) in scored_somewhere(page) {
        let up = match metric.better {
            Better::Higher => "up",
            Better::Lower => "down",
            Better::Neither => continue,
        };
        let label = escape(&metric.label);
        let reverse = if up == "up" { "down" } else { "up" };
        let _ = write!(
            out,
            "<option value=\"{up}:{m}\">{label}, worst first</option>\
             <option value=\"{reverse}:{m}\">{label}, best first</option>"
        );
    }
    out.push_str(
        "<option value=\"down:baseline\">baseline, largest first</option>\
         <option value=\"up:baseline\">baseline, smallest first</option>\
         <option value=\"up:overlap\">overlap, smallest first</option></select></label>\n\
         <label>of <select id=\"f-of\"><option value=\"\">mean of methods shown</option>",
    );
    for (m, method) in page.board.methods.iter().enumerate() {
        let _ = write!(
            out,
            "<option value=\"{m}\">{}</option>",
            escape(&method.label)
        );
    }
    out.push_str("</select></label>\n<fieldset><legend>Methods</legend>");
    for (m, method) in page.board.methods.iter().enumerate() {
        let _ = write!(
            out,
            "<label class=\"chip\"><input type=\"checkbox\" name=\"method\" value=\"{m}\" checked>\
             <i style=\"background:{}\"></i>{}</label>",
            style(m).ink.hex(),
            escape(&method.label)
        );
    }
    out.push_str("</fieldset>\n</div>\n");
}

/// The metrics that have a number anywhere, with their positions. The tables say why the others have none.
fn scored_somewhere<'a>(page: &Page<'a>) -> Vec<(usize, &'a Metric)> {
    let has_number = |metric: &Metric| {
        let mut records = page.input.records.iter();
        records.any(|r| {
            r.scores
                .get(&metric.key)
                .is_some_and(|s| s.value().is_some())
        })
    };
    let metrics = page.input.metrics.iter().enumerate();
    metrics.filter(|(_, metric)| has_number(metric)).collect()
}

fn card(
    out: &mut String,
    page: &Page<'_>,
    shown_pair: &GalleryPair<'_>,
    order: usize,
    scored: &[(usize, &Metric)],
) {
    let facts = shown_pair.pair.facts;
    let dataset = page
        .board
        .datasets
        .iter()
        .position(|d| d.dataset.name == facts.dataset)
        .unwrap_or_default();
    let attribute = |name: &str, value: Option<f64>| match value {
        Some(v) if v.is_finite() => format!(" data-{name}=\"{v}\""),
        _ => String::new(),
    };
    let _ = write!(
        out,
        "<article class=\"pair\" data-order=\"{order}\" data-dataset=\"{dataset}\"{}{}>\n<header><h3>{} \
         <span>{} → {}</span></h3><ul>",
        attribute("baseline", Some(facts.baseline_m)),
        attribute("overlap", facts.overlap),
        escape(&facts.scene),
        escape(&facts.source),
        escape(&facts.target)
    );
    for fact in pair_facts(facts) {
        let _ = write!(out, "<li>{fact}</li>");
    }
    out.push_str("</ul></header>\n<div class=\"strip\">\n<div class=\"col views\"><h4>Input and truth</h4>\n");
    let what = format!("{}, {} to {}", facts.scene, facts.source, facts.target);
    picture(
        out,
        "source",
        "Source",
        &shown_pair.source,
        &format!("Source photograph of {what}"),
    );
    picture(
        out,
        "target",
        "Target",
        &shown_pair.target,
        &format!("Target photograph of {what}"),
    );
    out.push_str("</div>\n");
    let columns = shown_pair.pair.by_method.iter().zip(&shown_pair.methods);
    for (m, (record, pictures)) in columns.enumerate() {
        let Some(method) = page.board.methods.get(m) else {
            continue;
        };
        let label = &method.label;
        let _ = writeln!(
            out,
            "<div class=\"col method\" data-method=\"{m}\"><h4><i style=\"background:{}\"></i>{}</h4>",
            style(m).ink.hex(),
            escape(label)
        );
        let (Some(record), Some((prediction, error))) = (record, pictures) else {
            out.push_str("<p class=\"absent\">no record of this pair</p></div>\n");
            continue;
        };
        picture(
            out,
            "prediction",
            "Prediction",
            prediction,
            &format!("Prediction by {label} of {what}"),
        );
        picture(
            out,
            "error",
            "Error",
            error,
            &format!("Absolute error of {label} on {what}"),
        );
        scores(out, record, scored, &page.input.extras);
        out.push_str("</div>\n");
    }
    out.push_str("</div>\n</article>\n");
}

fn pair_facts(facts: &Record) -> Vec<String> {
    let mut list = vec![format!("<b>{}</b>", escape(&facts.dataset))];
    if facts.baseline_m.is_finite() {
        list.push(format!("baseline {:.3} m", facts.baseline_m));
    }
    if facts.rotation_deg.is_finite() {
        list.push(format!("rotation {:.1}°", facts.rotation_deg));
    }
    if let Some(depth) = facts.median_depth_m.filter(|d| d.is_finite()) {
        list.push(format!("median depth {depth:.2} m"));
    }
    if let Some(overlap) = facts.overlap.filter(|o| o.is_finite()) {
        list.push(format!("overlap {:.1} %", overlap * 100.0));
    }
    list
}

fn picture(out: &mut String, kind: &str, caption: &str, shown: &Shown, alt: &str) {
    let _ = write!(out, "<figure data-kind=\"{kind}\">");
    match shown {
        Ok(p) => {
            let _ = write!(
                out,
                "<button type=\"button\" class=\"pic\"><img src=\"{}\" width=\"{}\" height=\"{}\" alt=\"{}\" \
                 decoding=\"async\" loading=\"lazy\"></button>",
                p.uri,
                p.width,
                p.height,
                escape(alt)
            );
        }
        Err(reason) => {
            let _ = write!(out, "<p class=\"absent\">{}</p>", escape(reason));
        }
    }
    let _ = writeln!(out, "<figcaption>{caption}</figcaption></figure>");
}

fn scores(out: &mut String, record: &Record, metrics: &[(usize, &Metric)], extras: &[Metric]) {
    out.push_str("<dl>");
    if let Status::Failed { reason } = &record.status {
        let _ = writeln!(
            out,
            "<div class=\"bad\"><dt>failed</dt><dd>{}</dd></div></dl>",
            escape(reason)
        );
        return;
    }
    for (m, metric) in metrics {
        let key = escape(&metric.key);
        let heading = escape(&metric.heading());
        let _ = match record.scores.get(&metric.key) {
            Some(Score::Value(value)) => write!(
                out,
                "<div><dt title=\"{key}\">{heading}</dt><dd data-metric=\"{m}\" data-value=\"{value}\">{}</dd></div>",
                shown(*value, metric.decimals)
            ),
            Some(Score::Unavailable { unavailable }) => write!(
                out,
                "<div><dt title=\"{key}\">{heading}</dt><dd title=\"{}\">n/a</dd></div>",
                escape(unavailable)
            ),
            None => write!(
                out,
                "<div><dt title=\"{key}\">{heading}</dt><dd title=\"not computed in this run\">n/a</dd></div>"
            ),
        };
    }
    let reported = record.reported();
    for extra in extras {
        if let Some(value) = reported.get(extra.key.as_str()) {
            let _ = write!(
                out,
                "<div class=\"extra\"><dt>{}</dt><dd>{}</dd></div>",
                escape(&extra.label),
                shown(*value, extra.decimals)
            );
        }
    }
    out.push_str("</dl>\n");
}
