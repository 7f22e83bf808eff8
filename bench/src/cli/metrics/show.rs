//! Results as text, JSON and CSV.

use std::fmt::{self, Display, Formatter};

use serde_json::{Map, Value, json};
use sharp_metrics::{
    Family, MetricInfo, MetricKey, ResizeKernel, Scorer, Terms, WeightsUsed, term_names,
};

use super::find::Sought;
use super::scored::Scored;
use crate::evaluate::results::number;
use crate::io::counts::counted;
use crate::io::fingerprints::{self, DECODERS};
use crate::io::text::{csv_bytes, csv_cell};
use crate::pictures::keyed_scores::{csv_cells, json_number, json_scores};
use crate::pictures::other_forms::OtherForm;

/// All pairs with their scorer and options.
pub(super) struct ScoredPairs<'a> {
    pub(super) scored: &'a [Scored],
    pub(super) scorer: &'a Scorer,
    pub(super) terms: bool,
    pub(super) sought: Option<&'a Sought>,
    pub(super) resize: Option<ResizeKernel>,
    /// Warnings about all pairs together, one sentence each.
    pub(super) warnings: Vec<String>,
}

impl ScoredPairs<'_> {
    fn keys(&self) -> impl Iterator<Item = (usize, MetricKey)> + '_ {
        self.scorer.keys().iter().copied().enumerate()
    }

    /// Mean over the pairs; `None` unless every pair has the score.
    fn mean(&self, at: usize) -> Option<f64> {
        let scores = self
            .scored
            .iter()
            .map(|pair| pair.scores[at].1.as_ref().ok());
        let sum: Option<f64> = scores.map(Option::<&f64>::copied).sum();
        sum.map(|sum| sum / self.scored.len() as f64)
    }

    fn means(&self) -> impl Iterator<Item = (MetricKey, f64)> + '_ {
        let keys = self.keys();
        keys.filter_map(|(at, key)| Some((key, self.mean(at)?)))
    }

    /// The JSON output, a stable interface for scripts: keys may be added but are never removed.
    pub(super) fn json(&self) -> Value {
        let infinite = self.keys().filter_map(|(at, key)| {
            let scores = self.scored.iter().map(|pair| &pair.scores[at].1);
            let count = scores
                .filter(|s| matches!(s, Ok(v) if v.is_infinite()))
                .count();
            (count > 0).then(|| (key.to_string(), json!(count)))
        });
        let mut results = json!({
            "pairs": self.scored.iter().map(|pair| self.pair_json(pair)).collect::<Vec<_>>(),
            "mean": self.means().map(|(key, v)| (key.to_string(), json_number(v))).collect::<Map<_, _>>(),
            "infinite": infinite.collect::<Map<_, _>>(),
            "warnings": self.warnings,
            "metrics": self.scorer.info(),
            "conditions": {
                "version": env!("CARGO_PKG_VERSION"),
                "source_fingerprint": fingerprints::BUILD,
                "decoder": DECODERS,
                "networks": self.scorer.options().arithmetic().to_string(),
                "resize_prediction": self.resize.map_or("none", ResizeKernel::name),
            },
        });
        if let Some(kernel) = self.resize {
            results["conditions"]["resize_prediction_as"] = json!(kernel.describe());
        }
        if let Some(sought) = self.sought {
            let found = self
                .found(sought)
                .into_iter()
                .map(|(key, _)| key.to_string());
            let others = self.other_means().into_iter();
            let others = others.filter(|form| sought.matches(form.value));
            results["found"] = found
                .chain(others.map(|form| form.name.to_owned()))
                .collect();
        }
        results
    }

    fn pair_json(&self, pair: &Scored) -> Value {
        let [scores, unavailable] = json_scores(&pair.scores);
        let [prediction, target] = pair.depths;
        let mut value = json!({
            "prediction": pair.prediction.display().to_string(),
            "target": pair.target.display().to_string(),
            "scores": scores,
            "unavailable": unavailable,
            "bit_depth": {"prediction": prediction, "target": target},
        });
        if !pair.notes.is_empty() {
            value["notes"] = json!(pair.notes);
        }
        if let Some((width, height)) = pair.resized_from {
            value["resized_from"] = json!([width, height]);
        }
        if let Some(mask) = &pair.mask {
            value["mask"] = json!(mask.display().to_string());
            value["mask_share"] = json!(pair.left);
        }
        if self.terms {
            let terms = pair.terms.iter();
            let terms = terms.map(|(key, terms)| (key.to_string(), terms_json(*key, terms)));
            value["terms"] = terms.collect::<Map<_, _>>().into();
        }
        if !pair.maps.is_empty() {
            let maps = pair.maps.iter().map(|(key, files, scale)| {
                let facts = json!({
                    "png": files.png.display().to_string(),
                    "exr": files.exr.display().to_string(),
                    "dark": scale.alike,
                    "bright": scale.different,
                });
                (key.clone(), facts)
            });
            value["maps"] = maps.collect::<Map<_, _>>().into();
        }
        value
    }

    /// The metrics whose value, or mean over several pairs, prints as the number `sought`.
    fn found(&self, sought: &Sought) -> Vec<(MetricKey, f64)> {
        self.means()
            .filter(|(_, value)| sought.matches(*value))
            .collect()
    }

    /// The variants in other packages that were computed for every pair, each with its mean over the pairs.
    fn other_means(&self) -> Vec<OtherForm> {
        let first = self.scored.first().map_or(&[][..], |pair| &pair.others);
        let mean = |form: &OtherForm| {
            let of_pair = |pair: &Scored| {
                let same = pair.others.iter().find(|other| other.name == form.name);
                same.map(|other| other.value)
            };
            let sum: Option<f64> = self.scored.iter().map(of_pair).sum();
            Some(OtherForm {
                value: sum? / self.scored.len() as f64,
                ..form.clone()
            })
        };
        first.iter().filter_map(mean).collect()
    }

    fn write_folder(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for pair in self.scored {
            writeln!(f, "{}", pair.prediction.display())?;
            for (key, score) in &pair.scores {
                if let Ok(value) = score {
                    writeln!(f, "  {:<34} {}", key.to_string(), number(*value))?;
                }
            }
            self.write_terms(f, pair)?;
        }
        writeln!(f, "mean of {} pairs", self.scored.len())?;
        for (at, key) in self.keys() {
            let mut reasons = self
                .scored
                .iter()
                .filter_map(|pair| pair.scores[at].1.as_ref().err());
            let mean = self
                .mean(at)
                .ok_or_else(|| reasons.next().cloned().unwrap_or_default());
            writeln!(f, "  {:<34} {}", key.to_string(), in_words(&mean))?;
        }
        Ok(())
    }

    fn write_terms(&self, f: &mut Formatter<'_>, pair: &Scored) -> fmt::Result {
        if !self.terms {
            return Ok(());
        }
        for (key, terms) in &pair.terms {
            let names = term_names(key.metric()).iter();
            match terms {
                Terms::Lpips { layers } => {
                    for (name, value) in names.zip(layers) {
                        writeln!(f, "  {key} {name} {}", number(*value))?;
                    }
                }
                Terms::Dists { structure, texture } => {
                    for ((name, s), t) in names.zip(structure).zip(texture) {
                        let (s, t) = (number(*s), number(*t));
                        writeln!(f, "  {key} {name} structure {s} texture {t}")?;
                    }
                }
            }
        }
        Ok(())
    }

    fn write_found(&self, f: &mut Formatter<'_>, sought: &Sought) -> fmt::Result {
        let found = self.found(sought);
        let others = self.other_means();
        let mut is_found = !found.is_empty();
        for (key, value) in &found {
            writeln!(f, "{} is {key} ({})", sought.text, number(*value))?;
            writeln!(f, "    {}", MetricInfo::new(*key, &[]).convention)?;
        }
        for form in others.iter().filter(|form| sought.matches(form.value)) {
            is_found = true;
            let value = number(form.value);
            writeln!(
                f,
                "{} is {} ({value}), a variant that was not selected",
                sought.text, form.name
            )?;
            writeln!(f, "    {}", form.convention)?;
        }
        if is_found {
            return Ok(());
        }
        writeln!(
            f,
            "{} matches none of the selected metrics and none of their known variants",
            sought.text
        )?;
        // Find the nearest value per family of metrics, because values of different families are not comparable.
        let own = self
            .means()
            .map(|(key, value)| (key.family(), key.to_string(), value));
        let others = others
            .into_iter()
            .map(|form| (form.family, form.name.to_owned(), form.value));
        let all: Vec<(Family, String, f64)> = own.chain(others).collect();
        let distance = |value: f64| sought.distance(value);
        for family in Family::ALL {
            let of_family = all.iter().filter(|(other, ..)| *other == family);
            let nearest = of_family.min_by(|a, b| distance(a.2).total_cmp(&distance(b.2)));
            if let Some((_, name, value)) = nearest {
                writeln!(
                    f,
                    "  nearest {:<6} {name} ({})",
                    family.name(),
                    number(*value)
                )?;
            }
        }
        Ok(())
    }

    /// CSV with `prediction,target`, `mask` if there are masks, one column per key, and the reasons for missing scores.
    pub(super) fn csv(&self) -> Vec<u8> {
        let masked = self.scored.iter().any(|pair| pair.mask.is_some());
        let mut header = vec!["prediction".to_owned(), "target".to_owned()];
        header.extend(masked.then(|| "mask".to_owned()));
        header.extend(self.resize.map(|kernel| format!("resized_from({kernel})")));
        header.extend(self.keys().map(|(_, key)| key.to_string()));
        header.push("unavailable".to_owned());
        let rows = self.scored.iter().map(|pair| {
            let files = [
                Some(&pair.prediction),
                Some(&pair.target),
                pair.mask.as_ref(),
            ];
            let mut row: Vec<String> = files
                .into_iter()
                .take(2 + usize::from(masked))
                .map(|file| {
                    let path = file.map(|file| file.display().to_string());
                    csv_cell(&path.unwrap_or_default()).into_owned()
                })
                .collect();
            if self.resize.is_some() {
                let size = pair.resized_from.map(|(w, h)| format!("{w}x{h}"));
                row.push(size.unwrap_or_default());
            }
            row.extend(csv_cells(&pair.scores));
            row
        });
        csv_bytes(header, rows)
    }
}

impl Display for ScoredPairs<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        if let [pair] = self.scored {
            for (key, score) in &pair.scores {
                writeln!(f, "{:<36} {}", key.to_string(), in_words(score))?;
            }
            self.write_terms(f, pair)?;
        } else {
            self.write_folder(f)?;
        }
        let resized = self.scored.iter();
        let resized = resized.filter(|pair| pair.resized_from.is_some()).count();
        if let Some(kernel) = self.resize.filter(|_| resized > 0) {
            let predictions = counted(resized, "prediction");
            let how = kernel.describe();
            writeln!(f, "{predictions} resized: {kernel}, {how}")?;
        }
        let masked: Vec<f64> = self
            .scored
            .iter()
            .filter(|pair| pair.mask.is_some())
            .map(|pair| pair.left)
            .collect();
        if !masked.is_empty() {
            let mean = 100.0 * masked.iter().sum::<f64>() / masked.len() as f64;
            let of_pairs = match masked.len() {
                1 => String::new(),
                count => format!(", mean of {count} pairs"),
            };
            writeln!(
                f,
                "mask: {mean:.1} % of the pixels count under @mask{of_pairs}"
            )?;
        }
        for used in self.scorer.weights() {
            writeln!(f, "{}", weights_line(used))?;
        }
        for (_, files, _) in self.scored.iter().flat_map(|pair| &pair.maps) {
            writeln!(f, "map {}", files.png.display())?;
        }
        self.sought
            .map_or(Ok(()), |sought| self.write_found(f, sought))
    }
}

fn in_words(score: &Result<f64, String>) -> String {
    match score {
        Ok(value) => number(*value),
        Err(reason) => format!("unavailable: {reason}"),
    }
}

fn weights_line(used: &WeightsUsed) -> String {
    let file = used.original_sha256.as_deref();
    let file = file.map_or_else(String::new, |sha256| format!(", file sha256 {sha256}"));
    format!(
        "weights of {}: features sha256 {}{file}",
        used.backbone, used.features_sha256
    )
}

fn terms_json(key: MetricKey, terms: &Terms) -> Value {
    let names = term_names(key.metric());
    match terms {
        Terms::Lpips { layers } => json!({"names": names, "layers": layers}),
        Terms::Dists { structure, texture } => {
            json!({"names": names, "structure": structure, "texture": texture})
        }
    }
}
