//! A paragraph for a paper on how a run's numbers were computed.

use std::collections::BTreeSet;

use sharp_datasets::registry::entry;

use super::board::{ReportDataset, bundled_network, proxies};
use super::metrics_text::{MethodsText, short};
use super::tables::latex::{escape, noted};
use crate::evaluate::Results;
use crate::evaluate::manifest::{DatasetRecord, ListOrigin, Manifest};
use crate::evaluate::record::{Record, Status};
use crate::methods::{Privilege, TrueDepth};

/// Citations of datasets, by format.
const CITED: [(&str, &str); 6] = [
    ("middlebury", "scharstein2014high"),
    ("booster", "zamaramirez2024booster"),
    ("scannetpp", "yeshwanth2023scannetpp"),
    ("wildrgbd", "xia2024rgbd"),
    ("tanks-and-temples", "knapitsch2017tanks"),
    ("eth3d", "schops2017multi"),
];

/// Keys of [`Manifest::scoring`] that the paragraph mentions, each with the start of its sentence.
const CONVENTIONS: [(&str, &str); 5] = [
    ("prediction", "Predictions"),
    ("target", "Ground truth"),
    ("resolution", "Resolution"),
    ("aggregation", "Reported numbers"),
    ("frustum mask", "View-frustum mask"),
];

/// The paragraph: datasets with their pairs, conventions, metrics, and known differences from the SHARP paper.
pub fn methods_text(results: &Results) -> MethodsText {
    let Results {
        manifest, records, ..
    } = results;
    let protocol = manifest
        .protocol
        .as_ref()
        .filter(|protocol| protocol.name != "sharp");
    let protocol = protocol.map_or_else(
        || "the protocol of SHARP~\\cite{mescheder2025sharp}".to_owned(),
        |protocol| {
            let (name, source) = (escape(&protocol.name), escape(&protocol.source));
            format!("the evaluation of {name} ({source})")
        },
    );
    let mut before = vec![format!(
        "View synthesis was evaluated with \\texttt{{sharp-bench}} {}, following {protocol}.",
        escape(&manifest.version)
    )];
    before.push(datasets(manifest, records));
    before.extend(failures(records));
    let metrics: Vec<_> = manifest
        .metrics
        .iter()
        .map(|metric| metric.info.clone())
        .collect();
    let is_masked = metrics.iter().any(|metric| metric.key.is_masked());
    before.extend(CONVENTIONS.iter().filter_map(|(key, head)| {
        let convention = manifest.scoring.get(*key)?;
        let is_said = match *key {
            "frustum mask" => is_masked,
            "resolution" => frames(manifest).is_empty(),
            _ => true,
        };
        is_said.then(|| format!("{head}: {}.", escape(convention)))
    }));
    let frames = frames(manifest);
    if !frames.is_empty() {
        before.push(format!(
            "Resolution: the views of {} were resized and cropped first; ground truth has the resulting size.",
            frames.join(", ")
        ));
    }
    before.extend(predictions(manifest, records));
    let text = MethodsText::of(before, &metrics, vec![deviations(manifest, records)]);
    MethodsText {
        latex: noted(text.latex),
        ..text
    }
}

/// For each dataset whose views were resized, its name and the rule.
fn frames(manifest: &Manifest) -> Vec<String> {
    let framed = manifest.datasets.iter().filter_map(|dataset| {
        let frame = dataset
            .readings
            .iter()
            .find(|reading| reading.key == "frame")?;
        Some(format!(
            "{} by \\texttt{{{}}}",
            title(dataset),
            escape(&frame.value)
        ))
    });
    framed.collect()
}

/// States the number of pairs of each dataset, and the list that the pairs are from.
fn datasets(manifest: &Manifest, records: &[Record]) -> String {
    let named = manifest.datasets.iter().map(|dataset| {
        let of_dataset = records
            .iter()
            .filter(|record| record.dataset == dataset.name);
        let pairs: BTreeSet<&str> = of_dataset.map(|record| record.pair_id.as_str()).collect();
        let cited = CITED.iter().find(|(format, _)| *format == dataset.format);
        let cited = cited.map_or_else(String::new, |(_, key)| format!("~\\cite{{{key}}}"));
        let sizes = dataset.sizes();
        let sizes = sizes.map_or_else(String::new, |sizes| format!(", {}", escape(&sizes)));
        format!("{}{cited} ($n={}${sizes})", title(dataset), pairs.len())
    });
    let named: Vec<String> = named.collect();
    let limits = manifest.pairs.lists.iter().filter_map(|list| list.limit);
    let limit = limits.max().map_or_else(String::new, |limit| {
        format!("; at most {limit} of them were selected for evaluation")
    });
    format!(
        "Pairs of source and target view: {}. The list of all {} pairs has the sha256 \\texttt{{{}}}; {} of these \
         pairs were evaluated{limit}.",
        named.join(", "),
        manifest.pairs.listed,
        short(&manifest.pairs.sha256),
        manifest.pairs.evaluated
    )
}

fn title(dataset: &DatasetRecord) -> String {
    escape(ReportDataset::of(&dataset.name, &dataset.format).title())
}

fn failures(records: &[Record]) -> Option<String> {
    let failed = records
        .iter()
        .filter(|record| record.status != Status::Ok)
        .count();
    (failed > 0).then(|| {
        format!(
            "{failed} of {} predictions failed and are excluded from all numbers.",
            records.len()
        )
    })
}

/// Sentences on how predictions were processed before scoring, and on privileged inputs of methods.
fn predictions(manifest: &Manifest, records: &[Record]) -> Vec<String> {
    let mut sentences = Vec::new();
    let mut say = |labels: BTreeSet<&str>, what: &str| {
        if !labels.is_empty() {
            let labels: Vec<String> = labels.into_iter().map(escape).collect();
            sentences.push(what.replace("METHODS", &labels.join(", ")));
        }
    };
    let with = |is: fn(&Record) -> bool| -> BTreeSet<&str> {
        let found = records.iter().filter(|record| is(record));
        found.map(|record| record.method.as_str()).collect()
    };
    let privileged = |is: fn(Privilege) -> bool| -> BTreeSet<&str> {
        let methods = manifest.methods.iter();
        let methods = methods.filter(|method| is(method.privilege));
        methods.map(|method| method.label.as_str()).collect()
    };
    say(
        with(|record| record.extras.contains_key("mean_alpha")),
        &format!(
            "The Gaussians of METHODS were rendered by {}.",
            escape(&manifest.renderer.to_string())
        ),
    );
    for method in &manifest.methods {
        let resized = records
            .iter()
            .any(|r| r.method == method.label && r.resized_from.is_some());
        if let Some(kernel) = method.identity.settings.get("resize").filter(|_| resized) {
            let what = format!(
                "Predictions of METHODS smaller than the target were resized by {}.",
                escape(kernel)
            );
            say(BTreeSet::from([method.label.as_str()]), &what);
        }
    }
    for method in &manifest.methods {
        if let Some(what) = bundled_network(&method.identity) {
            let sentence = format!("The network of METHODS: {}.", escape(&what));
            say(BTreeSet::from([method.label.as_str()]), &sentence);
        }
    }
    say(
        with(|record| record.crop.is_some()),
        "Predictions of METHODS show a part of the target and are scored on this part.",
    );
    say(
        with(|record| record.valid_share.is_some()),
        "Pixels excluded by a dataset's mask do not count in the scores of METHODS.",
    );
    say(
        with(|record| record.scale.is_some()),
        "For METHODS, the best of several scales of the scene was chosen by DISTS against the target.",
    );
    say(
        privileged(|known| known.depth == TrueDepth::DepthScale),
        "The depth of METHODS was scaled by the median ratio of the source's true depth to the predicted depth.",
    );
    say(
        privileged(|known| known.depth == TrueDepth::SourceDepth),
        "METHODS saw the true depth of the source.",
    );
    say(
        privileged(|known| known.several_views),
        "METHODS saw several views of a scene.",
    );
    say(
        privileged(|known| known.target_pose),
        "Before scoring METHODS, the target's camera was moved so that the picture fits the target's photograph.",
    );
    if manifest.common_region {
        let rule = "All methods are scored on the part of a target that all of them predict.";
        sentences.push(rule.to_owned());
    }
    sentences
}

/// States the choices that are known to differ from the paper's, and the choices that the paper leaves open.
fn deviations(manifest: &Manifest, records: &[Record]) -> String {
    let of_datasets = |choices: &dyn Fn(&DatasetRecord) -> Vec<String>| {
        let datasets = manifest.datasets.iter().filter_map(|dataset| {
            let choices = choices(dataset);
            let choices: Vec<String> = choices
                .iter()
                .map(|choice| format!("\\texttt{{{}}}", escape(choice)))
                .collect();
            (!choices.is_empty()).then(|| format!("{}: {}", title(dataset), choices.join(", ")))
        });
        datasets.collect::<Vec<String>>().join("; ")
    };
    let known = of_datasets(&|dataset| proxies(manifest, dataset, records));
    let open = of_datasets(&|dataset| {
        let readings = dataset.readings.iter().filter(|r| r.open && !r.proxy);
        readings.map(|r| format!("{}={}", r.key, r.value)).collect()
    });
    let is_papers =
        |dataset: &DatasetRecord| entry(&dataset.format).is_ok_and(|e| !e.paper_column.is_empty());
    let foreign: Vec<String> = manifest
        .datasets
        .iter()
        .filter(|dataset| !is_papers(dataset))
        .map(title)
        .collect();
    let mut others = Vec::new();
    if !foreign.is_empty() {
        others.push(format!("not among its datasets: {}", foreign.join(", ")));
    }
    if manifest
        .pairs
        .lists
        .iter()
        .any(|list| list.origin == ListOrigin::Given && list.choices.is_empty())
    {
        others.push("a given pair list, whose options are not recorded".to_owned());
    }
    if let Some(protocol) = manifest
        .protocol
        .as_ref()
        .filter(|protocol| protocol.name != "sharp")
    {
        others.push(format!("the evaluation of {}", escape(&protocol.name)));
    }
    let others = others.join("; ");
    let known = match (known.as_str(), others.as_str()) {
        ("", "") => "No reading of a dataset and no choice of pairs is known to differ from the SHARP paper's".to_owned(),
        ("", others) => format!("Unlike the SHARP paper: {others}"),
        (known, "") => format!("Known to differ from the SHARP paper: {known}"),
        (known, others) => format!("Known to differ from the SHARP paper: {known}; {others}"),
    };
    match open.as_str() {
        "" => format!("{known}."),
        open => format!("{known}. Left open by the paper and chosen here: {open}."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::record::Crop;
    use crate::evaluate::test_records::{manifest, record};
    use crate::scoring::Region;

    /// Two pairs of a procedural dataset with an underscore in its name; one method failed on one of them.
    fn results() -> Results {
        let mut manifest = manifest("psnr,lpips-alex");
        manifest.version = "9.9".to_owned();
        manifest.pairs.sha256 = "0123456789abcdef".to_owned();
        manifest.methods[0].label = "50%_crop".to_owned();
        let of = |number: usize| {
            let mut record = record("D_1", 0, number);
            record.method = "50%_crop".to_owned();
            record
        };
        let mut records = vec![of(0), of(1)];
        let region = Region {
            x: 0,
            y: 0,
            width: 8,
            height: 8,
        };
        records[0].crop = Some(Crop { region, share: 0.5 });
        records[1].status = Status::Failed {
            reason: "x".to_owned(),
        };
        Results {
            manifest,
            records,
            missing: BTreeSet::new(),
            pictures: Vec::new(),
            damaged: Vec::new(),
            methods_listed: false,
        }
    }

    #[test]
    fn the_paragraph_says_pairs_conventions_metrics_and_deviations() {
        let results = results();
        let text = methods_text(&results);
        let listed = results.manifest.pairs.listed;
        for part in [
            "\\texttt{sharp-bench} 9.9, following the protocol of SHARP~\\cite{mescheder2025sharp}.",
            "D\\_1 ($n=2$, 16$\\times$12 pixels)",
            &format!("all {listed} pairs has the sha256 \\texttt{{0123456789ab}}"),
            "1 of 2 predictions failed",
            "sRGB, 8 bit, rounded to nearest",
            "mean over pairs",
            "Predictions of 50\\%\\_crop show a part of the target",
            "(\\texttt{psnr}): -10 log10 of the mean squared error",
            "Features of AlexNet",
            "SHARP paper",
        ] {
            assert!(text.latex.contains(part), "{part}: {}", text.latex);
        }
        assert!(!text.latex.contains("View-frustum"));
    }

    #[test]
    fn every_dataset_of_the_paper_has_its_reference() {
        for (format, key) in CITED {
            let mut results = results();
            results.manifest.datasets[0].format = format.to_owned();
            let text = methods_text(&results);
            assert!(
                text.latex.contains(&format!("D\\_1~\\cite{{{key}}}")),
                "{format}"
            );
            assert!(text.bibtex.contains(&format!("{{{key},")), "{key}");
        }
    }
}
