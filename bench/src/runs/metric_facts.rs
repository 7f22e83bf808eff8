//! What a metric column was computed with: everything that its key does not say.

use serde::{Deserialize, Serialize};
use sharp_metrics::{MetricInfo, MetricKey, OwnWeights, WeightsUsed};

/// One metric column.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MetricFacts {
    /// Canonical key.
    pub key: String,
    /// Its convention, in words.
    pub convention: String,
    /// The network's weights, `vgg16=<features_sha256>` or `vgg16=absent`; empty for a metric without a network.
    pub weights: String,
    /// What a picture's levels become before the metric proper.
    #[serde(default)]
    pub input_range: String,
    /// What happens to the pictures' resolution.
    #[serde(default)]
    pub resize: String,
    /// Precision of the arithmetic.
    #[serde(default)]
    pub precision: String,
    /// The network, if its weights are at hand.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub backbone: Option<BackboneFacts>,
    /// The metric's own learned weights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub own_weights: Option<OwnWeightsFacts>,
}

/// The network behind a learned metric.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct BackboneFacts {
    /// torchvision's name.
    pub name: String,
    /// sha256 over the convolutions' names and values: the same for a full file and a features-only copy.
    pub features_sha256: String,
    /// sha256 of the file that they were published in; `None` for weights that no file holds.
    pub file_sha256: Option<String>,
}

/// The weights that a metric learned on top of its network.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct OwnWeightsFacts {
    /// Package that published them.
    pub package: String,
    /// File in the package.
    pub file: String,
    /// sha256 of that file.
    pub sha256: String,
}

impl MetricFacts {
    /// The facts of a key, with the weights that a scorer uses.
    pub fn of(key: MetricKey, used: &[WeightsUsed]) -> Self {
        let facts = MetricInfo::new(key, used);
        let backbone = facts
            .backbone
            .and_then(|backbone| used.iter().find(|used| used.backbone == backbone.name));
        Self {
            key: key.to_string(),
            convention: facts.convention,
            weights: weights_text(key, used),
            input_range: facts.input_range,
            resize: facts.resize,
            precision: facts.precision,
            backbone: backbone.map(BackboneFacts::from),
            own_weights: facts.own_weights.map(OwnWeightsFacts::from),
        }
    }

    /// Convention and facts as sentences.
    pub fn in_words(&self) -> String {
        let mut text = self.convention.clone();
        // Manifests of earlier versions have no more than that.
        if !self.input_range.is_empty() {
            text += &format!(
                " Input range {}; resizing: {}; {}.",
                self.input_range, self.resize, self.precision
            );
        }
        if let Some(own) = &self.own_weights {
            text += &format!(" {} {} sha256 {}.", own.package, own.file, own.sha256);
        }
        if !self.weights.is_empty() {
            text += &format!(" Weights: {}.", self.weights);
        }
        text
    }
}

/// The network's weights by hash: `vgg16=<features_sha256>`, `vgg16=absent`, or nothing for a metric without a network.
pub fn weights_text(key: MetricKey, used: &[WeightsUsed]) -> String {
    let backbone = MetricInfo::new(key, used).backbone;
    backbone.map_or_else(String::new, |backbone| backbone.to_string())
}

impl From<&WeightsUsed> for BackboneFacts {
    fn from(used: &WeightsUsed) -> Self {
        Self {
            name: used.backbone.name().to_owned(),
            features_sha256: used.features_sha256.clone(),
            file_sha256: used.original_sha256.clone(),
        }
    }
}

impl From<OwnWeights> for OwnWeightsFacts {
    fn from(own: OwnWeights) -> Self {
        Self {
            package: own.package,
            file: own.file,
            sha256: own.sha256,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sharp_metrics::{Scorer, Selection, Weights};

    #[test]
    fn weights_are_named_by_hash_or_said_to_be_absent() {
        let selection = Selection::parse("psnr,lpips-squeeze,dists").unwrap();
        let facts = |weights| -> Vec<MetricFacts> {
            let scorer = Scorer::new(&selection, &weights).unwrap();
            let keys = scorer.keys().iter();
            keys.map(|&key| MetricFacts::of(key, scorer.weights()))
                .collect()
        };
        let with = facts(Weights::deterministic(""));
        assert!(with[0].weights.is_empty() && with[0].backbone.is_none());
        let squeeze = with[1].backbone.as_ref().unwrap();
        assert_eq!(
            with[1].weights,
            format!("squeezenet1_1={}", squeeze.features_sha256)
        );
        assert_eq!(with[1].input_range, "-1..1");
        assert!(
            with[1].in_words().contains("4a5350f2"),
            "{}",
            with[1].in_words()
        );
        let without = facts(Weights::none());
        assert_eq!(without[2].weights, "vgg16=absent");
        assert!(without[2].backbone.is_none());
        // What an earlier version wrote can still be read.
        let old = r#"{"key":"psnr","convention":"c","weights":""}"#;
        let old: MetricFacts = serde_json::from_str(old).unwrap();
        assert_eq!(old.in_words(), "c");
    }
}
