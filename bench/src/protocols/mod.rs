//! Published evaluation procedures by name, each with the settings of a run that the procedure
//! fixes.
//!
//! Every preset follows the rules of the original code, even misleading rules, and states where
//! this harness differs from it.
//!
//! * `table`: the presets; `request`: applies a protocol and opens a configuration.

mod request;
mod table;

use std::fmt::Display;

use serde::{Deserialize, Serialize};
use sharp::color::Quantization;
use sharp_datasets::error::nearest_of;
use sharp_metrics::{MetricKey, Selection};

use crate::config::rendering::Quantise;
use crate::config::{ConfigError, PairConfig, RunConfig};
use crate::evaluate::Aggregation;
use crate::evaluate::manifest::ProtocolRecord;
use crate::pairs::frame::Frame;
use crate::pairs::{DatasetConfig, PairOptions};
use crate::scoring::ScoringRules;
use crate::scoring::rules::{Border, PairMask};

pub use self::table::PROTOCOLS;

#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Protocol {
    pub name: String,
    /// Repository and commit, or the paper.
    pub source: String,
    pub pairs: PairRule,
    /// Size at which pictures are predicted and compared, in the form of a dataset's `frame=` setting; `None` for the
    /// dataset's own size.
    pub frame: Option<String>,
    /// Background for pictures that are not opaque, in the form of a dataset's `alpha=` setting; `None` if the
    /// protocol's data is opaque.
    pub alpha: Option<String>,
    pub border: Border,
    pub quantised: Quantised,
    /// Metric keys; empty if the code publishes no metrics.
    pub metrics: Vec<String>,
    pub aggregation: Aggregation,
    pub mask: PairMask,
    /// Treatment of failed targets.
    pub failures: String,
    /// Misleading rules of the original that this harness follows nevertheless.
    pub traps: Vec<String>,
    /// Differences between this harness and the original.
    pub departures: Vec<String>,
}

/// Origin of the pairs.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "kind", content = "rule", rename_all = "snake_case")]
pub enum PairRule {
    /// Built by the rules of SHARP's paper.
    #[default]
    Paper,
    /// A published list, given with `--pairs` after `pairs import`.
    List(String),
    /// Only targets are fixed; the user chooses the sources with `--pairs`.
    NoSource(String),
    /// Cannot be run here; the text gives the reason.
    Refused(String),
}

/// How predictions are rounded before scoring.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantised {
    /// The original scores floats; this harness scores 8-bit levels.
    Float,
    #[default]
    Round,
    Truncate,
    Unpublished,
}

impl Protocol {
    /// Looks up a protocol.
    ///
    /// # Errors
    /// If there is no protocol called `name`.
    pub fn named(name: &str) -> Result<&'static Self, ConfigError> {
        let found = PROTOCOLS.iter().find(|protocol| protocol.name == name);
        found.ok_or_else(|| {
            let known: Vec<&str> = PROTOCOLS.iter().map(|known| known.name.as_str()).collect();
            let nearest = nearest_of(name, &known);
            ConfigError::Usage(format!("no protocol '{name}'; {nearest}"))
        })
    }

    /// Applies the protocol to a configuration: frame size and background of datasets, metrics, rounding. Idempotent.
    ///
    /// # Errors
    /// If the configuration contradicts the protocol, or lacks something that the protocol needs.
    pub fn follow(&self, config: &RunConfig) -> Result<RunConfig, ConfigError> {
        self.check_pairs(&config.pairs)?;
        let mut followed = config.clone();
        for dataset in &mut followed.datasets {
            self.show(dataset)?;
        }
        self.check_metrics(config.metrics.asked()?.as_ref())?;
        if followed.metrics.metrics.is_none() && !self.metrics.is_empty() {
            followed.metrics.metrics = Some(self.metrics.join(","));
        }
        followed.rendering.quantise = self.quantise(config.rendering.quantise)?;
        Ok(followed)
    }

    pub fn rules(&self) -> ScoringRules {
        ScoringRules {
            mask: self.mask,
            border: self.border,
        }
    }

    pub fn record(&self) -> ProtocolRecord {
        ProtocolRecord {
            name: self.name.clone(),
            source: self.source.clone(),
            failures: self.failures.clone(),
            traps: self.traps.clone(),
            departures: self.departures(),
        }
    }

    /// Differences between this harness and the original, including those implied by the protocol's fields.
    pub fn departures(&self) -> Vec<String> {
        let of_pairs = match &self.pairs {
            PairRule::NoSource(rule) => Some(format!(
                "pairs: from the given list; this protocol has no source view: {rule}"
            )),
            _ => None,
        };
        let of_levels = (self.quantised == Quantised::Float).then(|| {
            "quantisation: predictions are rounded to 8 bit; the original scores floats (a difference below 0.01 dB up to 40 dB)"
                .to_owned()
        });
        let implied = of_pairs.into_iter().chain(of_levels);
        implied.chain(self.departures.iter().cloned()).collect()
    }

    fn refusal(&self, text: impl Display) -> ConfigError {
        ConfigError::Usage(format!("--protocol {} {text}", self.name))
    }

    fn contradicted(&self, rule: impl Display, option: impl Display) -> ConfigError {
        self.refusal(format!("{rule}, which {option} contradicts"))
    }

    fn check_pairs(&self, asked: &PairConfig) -> Result<(), ConfigError> {
        let needs = |reason: String| {
            if asked.pairs.is_some() {
                Ok(())
            } else {
                Err(self.refusal(format!("needs --pairs FILE: {reason}")))
            }
        };
        match &self.pairs {
            PairRule::Paper if asked.pairs.is_some() => Ok(()),
            PairRule::Paper => match asked.pair_options.as_ref().map(PairOptions::proxies) {
                Some(changed) if !changed.is_empty() => Err(self.contradicted(
                    "builds pairs as in the paper",
                    format!("--pair-options {}", changed.join(",")),
                )),
                _ => Ok(()),
            },
            PairRule::List(what) => needs(format!("its pairs are {what}; see `pairs import`")),
            PairRule::NoSource(rule) => needs(format!(
                "it has no source view ({rule}), so the list must state a source for each target"
            )),
            PairRule::Refused(reason) => {
                Err(self.refusal(format!("cannot be followed here: {reason}")))
            }
        }
    }

    /// Gives a dataset the protocol's picture size, and the protocol's background if the dataset does not set one.
    fn show(&self, dataset: &mut DatasetConfig) -> Result<(), ConfigError> {
        let own = dataset.frame;
        let of_protocol = self
            .frame
            .as_ref()
            .and_then(|frame| frame.parse::<Frame>().ok());
        let rule = match (of_protocol, own) {
            (Some(frame), Some(own)) if own != frame => Some(format!("requires frame={frame}")),
            (None, Some(_)) if !matches!(self.pairs, PairRule::NoSource(_)) => {
                Some("uses pictures at their own size".to_owned())
            }
            _ => None,
        };
        if let (Some(rule), Some(own)) = (rule, own) {
            return Err(self.contradicted(rule, format!("--dataset …,frame={own}")));
        }
        dataset.frame = own.or(of_protocol);
        if let Some(alpha) = &self.alpha {
            let settings = &mut dataset.spec.settings;
            settings.entry("alpha").or_insert_with(|| alpha.clone());
        }
        Ok(())
    }

    /// Fails if a choice of metrics does not include all of the protocol's.
    fn check_metrics(&self, asked: Option<&Selection>) -> Result<(), ConfigError> {
        let own = Selection::parse(&self.metrics.join(","));
        let (Some(asked), Ok(own)) = (asked, own) else {
            return Ok(());
        };
        let keys: Vec<MetricKey> = asked.keys().collect();
        match own.keys().find(|key| !keys.contains(key)) {
            None => Ok(()),
            Some(lacking) => Err(self.contradicted(
                format!("scores {lacking}"),
                format!("--metrics without {lacking}"),
            )),
        }
    }

    fn quantise(&self, asked: Option<Quantise>) -> Result<Option<Quantise>, ConfigError> {
        let own = match self.quantised {
            Quantised::Truncate => Quantise::Truncate,
            Quantised::Float | Quantised::Round => Quantise::Round,
            Quantised::Unpublished => return Ok(asked),
        };
        match asked {
            Some(asked) if asked != own => Err(self.contradicted(
                format!(
                    "converts renderings to 8 bit by {}",
                    Quantization::from(own)
                ),
                format!("--quantise {}", Quantization::from(asked)),
            )),
            _ => Ok(Some(own)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::MetricConfig;

    /// A configuration with a pair list.
    fn asked(dataset: &str) -> RunConfig {
        RunConfig {
            datasets: vec![dataset.parse().unwrap()],
            pairs: PairConfig {
                pairs: Some("pairs.csv".into()),
                ..PairConfig::default()
            },
            ..RunConfig::default()
        }
    }

    fn metrics(list: &str) -> MetricConfig {
        MetricConfig {
            metrics: Some(list.to_owned()),
            ..MetricConfig::default()
        }
    }

    #[test]
    fn every_preset_is_sound() {
        let mut names = std::collections::BTreeSet::new();
        for protocol in PROTOCOLS.iter() {
            assert!(names.insert(protocol.name.as_str()));
            assert!(
                protocol
                    .frame
                    .as_ref()
                    .is_none_or(|frame| frame.parse::<Frame>().is_ok())
            );
            for key in &protocol.metrics {
                let parsed = key.parse::<MetricKey>().unwrap();
                assert_eq!(parsed.to_string(), *key, "{}", protocol.name);
            }
            let refused = matches!(protocol.pairs, PairRule::Refused(_));
            let followed = protocol.follow(&asked("synthetic"));
            assert_eq!(followed.is_err(), refused, "{}", protocol.name);
            // The run.toml of a run folder already follows the protocol.
            let twice = followed
                .ok()
                .map(|once| (protocol.follow(&once).unwrap(), once));
            assert!(
                twice.is_none_or(|(twice, once)| twice == once),
                "{}",
                protocol.name
            );
        }
        let expected = [
            "3dgs",
            "depthsplat",
            "flash3d",
            "lvsm",
            "multinerf",
            "mvsplat",
            "nerfacto",
            "nerfbaselines",
            "pixelsplat",
            "scannetpp",
            "seva",
            "sharp",
            "splatfacto",
            "splatter",
            "unisharp",
        ];
        assert!(names.into_iter().eq(expected));
    }

    #[test]
    fn a_protocol_sets_what_it_fixes() {
        let asked = asked("R:colmap=data");
        let pixelsplat = Protocol::named("pixelsplat").unwrap();
        let followed = pixelsplat.follow(&asked).unwrap();
        assert_eq!(
            followed.datasets[0].to_string(),
            "R:colmap=data,frame=cover:256x256:lanczos"
        );
        let keys = followed.metrics.selection().unwrap();
        let keys: Vec<String> = keys.keys().map(|k| k.to_string()).collect();
        assert_eq!(
            keys,
            ["psnr", "ssim[gauss11,valid,sample]", "lpips[vgg,v0.1]"]
        );
        assert_eq!(pixelsplat.aggregation, Aggregation::Scenes);
        assert_eq!(followed.rendering.quantise, Some(Quantise::Truncate));
        let unisharp = Protocol::named("unisharp").unwrap();
        assert_eq!(unisharp.rules().mask, PairMask::SourceBounds);
        assert_eq!(unisharp.follow(&asked).unwrap().datasets, asked.datasets);
        let seva = Protocol::named("seva").unwrap().follow(&asked).unwrap();
        assert_eq!(seva.rendering.quantise, None);
        let keys = seva.metrics.selection().unwrap();
        assert!(
            keys.keys()
                .any(|k| k.to_string() == "lpips[alex,v0.1,eps=tm]")
        );
        assert!(seva.datasets[0].to_string().contains("576"));
    }

    #[test]
    fn contradictions_name_both_sides() {
        let framed = asked("synthetic,frame=width:100:area");
        let plain = asked("synthetic");
        let listless = RunConfig {
            pairs: PairConfig::default(),
            ..plain.clone()
        };
        let said = |name: &str, asked: &RunConfig| {
            let protocol = Protocol::named(name).unwrap();
            protocol.follow(asked).unwrap_err().to_string()
        };
        let mut other_options = listless.clone();
        other_options.pairs.pair_options = Some("threshold=0.5".parse().unwrap());
        let mut rounded = plain.clone();
        rounded.rendering.quantise = Some(Quantise::Round);
        let fewer = RunConfig {
            metrics: metrics("psnr,ssim"),
            ..plain.clone()
        };
        for (name, asked, parts) in [
            (
                "pixelsplat",
                &framed,
                ["cover:256x256", "frame=width:100:area"],
            ),
            (
                "pixelsplat",
                &fewer,
                [
                    "--protocol pixelsplat scores ssim[gauss11,valid,sample]",
                    "--metrics",
                ],
            ),
            ("pixelsplat", &rounded, ["truncate", "--quantise round"]),
            (
                "sharp",
                &other_options,
                ["as in the paper", "threshold=0.5"],
            ),
            (
                "sharp",
                &framed,
                ["uses pictures at their own size", "frame=width:100:area"],
            ),
            ("3dgs", &listless, ["no source view", "index % 8"]),
            ("splatter", &plain, ["cannot be followed", "SRN"]),
        ] {
            let error = said(name, asked);
            assert!(parts.iter().all(|part| error.contains(part)), "{error}");
        }
        let error = Protocol::named("nerf").unwrap_err().to_string();
        assert!(error.contains("unisharp"), "{error}");
        // Additional columns do not contradict the protocol.
        let more = RunConfig {
            metrics: metrics("dists,psnr,ssim-gauss11-valid-sample,lpips-vgg"),
            ..plain
        };
        let followed = Protocol::named("lvsm").unwrap().follow(&more).unwrap();
        assert_eq!(followed.metrics, more.metrics);
    }
}
