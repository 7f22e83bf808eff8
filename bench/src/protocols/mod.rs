//! Other people's evaluations by name: what each fixes, and what it makes of a request.
//!
//! Every preset keeps the rules of its code, those that mislead included, and says where this harness does otherwise.
//!
//! * `table`: the presets.

mod table;

use serde::Serialize;
use sharp::color::Quantization;
use sharp_datasets::error::nearest_of;
use sharp_metrics::{MetricKey, Selection, SelectionError};

use crate::config::DatasetConfig;
use crate::evaluate::Aggregation;
use crate::evaluate::manifest::ProtocolRecord;
use crate::pairs::PairOptions;
use crate::pairs::frame::Frame;
use crate::scoring::ScoringRules;
use crate::scoring::rules::{Border, PairMask};

pub use self::table::PROTOCOLS;

/// Someone's evaluation.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Protocol {
    pub name: &'static str,
    /// Repository and commit, or the paper.
    pub source: &'static str,
    pub pairs: PairRule,
    /// The size at which pictures are seen and compared, as a dataset's `frame=`; `None`: as the dataset has them.
    pub frame: Option<&'static str>,
    /// Over what pictures that are not opaque are composited, as a dataset's `alpha=`; `None` where its data has none.
    pub alpha: Option<&'static str>,
    pub border: Border,
    pub quantised: Quantised,
    /// Keys; none where the code publishes no metrics.
    pub metrics: &'static [&'static str],
    pub aggregation: Aggregation,
    pub mask: PairMask,
    /// What becomes of a target that fails.
    pub failures: &'static str,
    /// Rules that mislead, kept as they are.
    pub traps: &'static [&'static str],
    /// Where this harness does otherwise.
    pub departures: &'static [&'static str],
}

/// Where the pairs come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(tag = "kind", content = "rule", rename_all = "snake_case")]
pub enum PairRule {
    /// Built by the rules of SHARP's paper.
    Paper,
    /// A published list, handed in with `--pairs` after `pairs import`.
    List(&'static str),
    /// The rule of the targets; which source shows them is for whoever runs it to say, with `--pairs`.
    NoSource(&'static str),
    /// Why it cannot be run here.
    Refused(&'static str),
}

/// What predictions become before they are scored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantised {
    /// Scored as floats there, as 8 bit here.
    Float,
    Round,
    Truncate,
    Unpublished,
}

/// What was asked for besides a protocol.
#[derive(Debug, Clone, Copy)]
pub struct Asked<'a> {
    pub datasets: &'a [DatasetConfig],
    pub has_pair_list: bool,
    pub pair_options: Option<&'a PairOptions>,
    pub metrics: Option<&'a Selection>,
    pub quantization: Option<Quantization>,
}

/// What a request becomes under a protocol.
#[derive(Debug, Clone, PartialEq)]
pub struct Followed {
    pub datasets: Vec<DatasetConfig>,
    /// `None` where the protocol names none and none were asked for.
    pub metrics: Option<Selection>,
    pub quantization: Option<Quantization>,
    pub rules: ScoringRules,
    pub aggregation: Aggregation,
    pub record: ProtocolRecord,
}

/// Why a request cannot follow a protocol.
#[derive(Debug, thiserror::Error)]
pub enum ProtocolError {
    #[error("no protocol '{name}'; {}", nearest_of(name, &names()))]
    Unknown { name: String },
    #[error("--protocol {protocol} {rule}, which {option} contradicts")]
    Contradicted {
        protocol: &'static str,
        rule: String,
        option: String,
    },
    #[error("--protocol {protocol} needs --pairs FILE: {reason}")]
    NeedsPairs {
        protocol: &'static str,
        reason: String,
    },
    #[error("--protocol {protocol} cannot be followed here: {reason}")]
    Refused {
        protocol: &'static str,
        reason: &'static str,
    },
    #[error("--protocol {protocol}: {error}")]
    Metrics {
        protocol: &'static str,
        error: SelectionError,
    },
}

fn names() -> Vec<&'static str> {
    PROTOCOLS.iter().map(|protocol| protocol.name).collect()
}

impl Protocol {
    /// # Errors
    /// [`ProtocolError::Unknown`].
    pub fn named(name: &str) -> Result<&'static Self, ProtocolError> {
        let found = PROTOCOLS.iter().find(|protocol| protocol.name == name);
        found.ok_or_else(|| ProtocolError::Unknown {
            name: name.to_owned(),
        })
    }

    /// What a request becomes.
    ///
    /// # Errors
    /// When something that was asked for contradicts the protocol, or the protocol needs something that was not.
    pub fn follow(&self, asked: Asked<'_>) -> Result<Followed, ProtocolError> {
        self.check_pairs(asked)?;
        Ok(Followed {
            datasets: asked
                .datasets
                .iter()
                .map(|dataset| self.seen(dataset))
                .collect::<Result<_, _>>()?,
            metrics: self.selection(asked.metrics)?,
            quantization: self.quantization(asked.quantization)?,
            rules: ScoringRules {
                mask: self.mask,
                border: self.border,
            },
            aggregation: self.aggregation,
            record: ProtocolRecord {
                name: self.name.to_owned(),
                source: self.source.to_owned(),
                failures: self.failures.to_owned(),
                traps: self.traps.iter().map(ToString::to_string).collect(),
                departures: self.departures(),
            },
        })
    }

    /// Where this harness does otherwise, what follows from the protocol's fields included.
    pub fn departures(&self) -> Vec<String> {
        let of_pairs = match self.pairs {
            PairRule::NoSource(rule) => Some(format!(
                "pairs: those of the list that is given; theirs has no source view: {rule}"
            )),
            _ => None,
        };
        let of_levels = (self.quantised == Quantised::Float).then(|| {
            "quantisation: predictions are rounded to 8 bit, theirs are scored as floats (below 0.01 dB up to 40 dB)"
                .to_owned()
        });
        let others = self.departures.iter().map(ToString::to_string);
        of_pairs
            .into_iter()
            .chain(of_levels)
            .chain(others)
            .collect()
    }

    fn contradicted(&self, rule: impl Into<String>, option: impl Into<String>) -> ProtocolError {
        ProtocolError::Contradicted {
            protocol: self.name,
            rule: rule.into(),
            option: option.into(),
        }
    }

    fn check_pairs(&self, asked: Asked<'_>) -> Result<(), ProtocolError> {
        let needs = |reason: String| match asked.has_pair_list {
            true => Ok(()),
            false => Err(ProtocolError::NeedsPairs {
                protocol: self.name,
                reason,
            }),
        };
        match self.pairs {
            PairRule::Paper if asked.has_pair_list => Ok(()),
            PairRule::Paper => match asked.pair_options.map(PairOptions::proxies) {
                Some(changed) if !changed.is_empty() => Err(self.contradicted(
                    "builds pairs as the paper says",
                    format!("--pair-options {}", changed.join(",")),
                )),
                _ => Ok(()),
            },
            PairRule::List(what) => needs(format!("its pairs are {what}; see `pairs import`")),
            PairRule::NoSource(rule) => needs(format!(
                "it has no source view ({rule}), so that the list has to say from which source each target is predicted"
            )),
            PairRule::Refused(reason) => Err(ProtocolError::Refused {
                protocol: self.name,
                reason,
            }),
        }
    }

    /// The dataset at the protocol's size and, where it says none itself, over the protocol's background.
    fn seen(&self, dataset: &DatasetConfig) -> Result<DatasetConfig, ProtocolError> {
        let own = dataset.frame;
        let of_protocol = self.frame.map(str::parse::<Frame>).and_then(Result::ok);
        let rule = match (of_protocol, own) {
            (Some(frame), Some(own)) if own != frame => {
                Some(format!("sees pictures as frame={frame}"))
            }
            (None, Some(_)) if !matches!(self.pairs, PairRule::NoSource(_)) => {
                Some("sees pictures as they are".to_owned())
            }
            _ => None,
        };
        if let (Some(rule), Some(own)) = (rule, own) {
            return Err(self.contradicted(rule, format!("--dataset …,frame={own}")));
        }
        let mut seen = dataset.clone();
        seen.frame = own.or(of_protocol);
        if let Some(alpha) = self.alpha {
            let settings = &mut seen.spec.settings;
            settings.entry("alpha").or_insert_with(|| alpha.to_owned());
        }
        Ok(seen)
    }

    /// The protocol's metrics, then further ones that were asked for.
    fn selection(&self, asked: Option<&Selection>) -> Result<Option<Selection>, ProtocolError> {
        if self.metrics.is_empty() {
            return Ok(asked.cloned());
        }
        let own = Selection::parse(&self.metrics.join(","));
        let own = own.map_err(|error| ProtocolError::Metrics {
            protocol: self.name,
            error,
        })?;
        let Some(asked) = asked else {
            return Ok(Some(own));
        };
        let keys: Vec<MetricKey> = asked.keys().collect();
        match own.keys().find(|key| !keys.contains(key)) {
            None => Ok(Some(asked.clone())),
            Some(lacking) => {
                Err(self.contradicted(format!("scores {lacking}"), "--metrics without it"))
            }
        }
    }

    fn quantization(
        &self,
        asked: Option<Quantization>,
    ) -> Result<Option<Quantization>, ProtocolError> {
        let own = match self.quantised {
            Quantised::Truncate => Quantization::Truncate,
            Quantised::Float | Quantised::Round => Quantization::Round,
            Quantised::Unpublished => return Ok(asked),
        };
        match asked {
            Some(asked) if asked != own => Err(self.contradicted(
                format!("brings renderings to 8 bit by {own}"),
                format!("--quantise {asked}"),
            )),
            _ => Ok(Some(own)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(datasets: &[DatasetConfig]) -> Asked<'_> {
        Asked {
            datasets,
            has_pair_list: true,
            pair_options: None,
            metrics: None,
            quantization: None,
        }
    }

    #[test]
    fn every_preset_is_sound() {
        let mut names = std::collections::BTreeSet::new();
        for protocol in &PROTOCOLS {
            assert!(names.insert(protocol.name));
            assert!(
                protocol
                    .frame
                    .is_none_or(|frame| frame.parse::<Frame>().is_ok())
            );
            for key in protocol.metrics {
                let parsed = key.parse::<MetricKey>().unwrap();
                assert_eq!(parsed.to_string(), *key, "{}", protocol.name);
            }
            let refused = matches!(protocol.pairs, PairRule::Refused(_));
            let followed = protocol.follow(asked(&["synthetic".parse().unwrap()]));
            assert_eq!(followed.is_err(), refused, "{}", protocol.name);
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
        let datasets = ["R:colmap=data".parse().unwrap()];
        let pixelsplat = Protocol::named("pixelsplat").unwrap();
        let followed = pixelsplat.follow(asked(&datasets)).unwrap();
        assert_eq!(
            followed.datasets[0].to_string(),
            "R:colmap=data,frame=cover:256x256:lanczos"
        );
        let keys: Vec<String> = followed
            .metrics
            .unwrap()
            .keys()
            .map(|k| k.to_string())
            .collect();
        assert_eq!(
            keys,
            ["psnr", "ssim[gauss11,valid,sample]", "lpips[vgg,v0.1]"]
        );
        assert_eq!(followed.aggregation, Aggregation::Scenes);
        assert_eq!(followed.quantization, Some(Quantization::Truncate));
        let unisharp = Protocol::named("unisharp").unwrap();
        let followed = unisharp.follow(asked(&datasets)).unwrap();
        assert_eq!(followed.rules.mask, PairMask::SourceBounds);
        assert_eq!(followed.datasets, datasets);
        let seva = Protocol::named("seva")
            .unwrap()
            .follow(asked(&datasets))
            .unwrap();
        assert_eq!(seva.quantization, None);
        let keys = seva.metrics.unwrap();
        assert!(
            keys.keys()
                .any(|k| k.to_string() == "lpips[alex,v0.1,eps=tm]")
        );
        assert!(seva.datasets[0].to_string().contains("576"));
    }

    #[test]
    fn contradictions_name_both_sides() {
        let datasets = ["synthetic,frame=width:100:area".parse().unwrap()];
        let said = |name: &str, asked: Asked<'_>| {
            let protocol = Protocol::named(name).unwrap();
            protocol.follow(asked).unwrap_err().to_string()
        };
        let plain = ["synthetic".parse().unwrap()];
        let metrics = Selection::parse("psnr,ssim").unwrap();
        let options: PairOptions = "threshold=0.5".parse().unwrap();
        for (name, asked, parts) in [
            (
                "pixelsplat",
                asked(&datasets),
                ["cover:256x256", "frame=width:100:area"],
            ),
            (
                "pixelsplat",
                Asked {
                    metrics: Some(&metrics),
                    ..asked(&plain)
                },
                [
                    "--protocol pixelsplat scores ssim[gauss11,valid,sample]",
                    "--metrics",
                ],
            ),
            (
                "pixelsplat",
                Asked {
                    quantization: Some(Quantization::Round),
                    ..asked(&plain)
                },
                ["truncate", "--quantise round"],
            ),
            (
                "sharp",
                Asked {
                    has_pair_list: false,
                    pair_options: Some(&options),
                    ..asked(&plain)
                },
                ["as the paper says", "threshold=0.5"],
            ),
            (
                "sharp",
                asked(&datasets),
                ["sees pictures as they are", "frame=width:100:area"],
            ),
            (
                "3dgs",
                Asked {
                    has_pair_list: false,
                    ..asked(&plain)
                },
                ["no source view", "index % 8"],
            ),
            ("splatter", asked(&plain), ["cannot be followed", "SRN"]),
        ] {
            let error = said(name, asked);
            assert!(parts.iter().all(|part| error.contains(part)), "{error}");
        }
        let error = Protocol::named("nerf").unwrap_err().to_string();
        assert!(error.contains("unisharp"), "{error}");
        // Further columns contradict nothing.
        let more = Selection::parse("dists,psnr,ssim-gauss11-valid-sample,lpips-vgg").unwrap();
        let asked = Asked {
            metrics: Some(&more),
            ..asked(&plain)
        };
        let followed = Protocol::named("lvsm").unwrap().follow(asked).unwrap();
        assert_eq!(followed.metrics, Some(more));
    }
}
