//! Opens everything that a configuration refers to.

use std::path::Path;

use sharp::render::Backend;

use super::Protocol;
use crate::config::{ConfigError, RunConfig};
use crate::evaluate::{Aggregation, Request};
use crate::methods;
use crate::pairs::{OpenDataset, PairOrigin};
use crate::scoring::ScoringRules;

impl Request {
    /// Applies the protocol, opens the datasets and builds the methods of a configuration. If
    /// `plan` (a planned run folder) is given, the plan's pairs are used.
    ///
    /// # Errors
    /// If the configuration contradicts its protocol or itself, or refers to something that does
    /// not exist.
    pub fn of(config: &RunConfig, plan: Option<&Path>) -> Result<Self, ConfigError> {
        let usage = |reason: &str| Err(ConfigError::Usage(reason.to_owned()));
        let backend = config.backend()?;
        if backend == Backend::Auto {
            return usage(
                "--backend auto is only for `render`, because scores must not depend on the \
                 machine's hardware; set cpu or wgpu",
            );
        }
        if config.limit == Some(0) {
            return usage("--limit 0: no pair to evaluate");
        }
        if config.datasets.is_empty() {
            return usage(
                "no dataset; give one with --dataset SPEC (`datasets list` shows the formats)",
            );
        }
        let protocol = config
            .protocol
            .as_deref()
            .map(Protocol::named)
            .transpose()?;
        let config = match protocol {
            Some(protocol) => protocol.follow(config)?,
            None => config.clone(),
        };
        let scoring = config
            .metrics
            .complete_scoring(&config.metrics.selection()?)?;
        let chooser = config.scale_sweep.then(|| config.metrics.scale_chooser());
        let methods = methods::build(&config.methods, chooser.transpose()?.as_ref())?;
        Ok(Self {
            checks: config.pairs.overlap.checks().filter(|_| plan.is_none()),
            only_scenes: config.scenes.clone(),
            pairs: match plan {
                Some(root) => PairOrigin::Planned(root.to_owned()),
                None => config.pairs.origin()?,
            },
            limit: config.limit,
            methods,
            scoring: scoring.under(protocol.map_or_else(ScoringRules::default, Protocol::rules)),
            common_region: config.common_region,
            aggregation: protocol.map_or_else(Aggregation::default, |p| p.aggregation),
            protocol: protocol.map(Protocol::record),
            backend,
            rendering: config.rendering.settings(),
            datasets: OpenDataset::open_all(&config.datasets, config.scenes.as_deref())?,
            config: Some(config),
        })
    }
}
