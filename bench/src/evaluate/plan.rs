//! The plan of a run: its units, their estimated cost and their progress.

use std::collections::BTreeSet;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::manifest::FORMAT;
use super::unit::UnitProgress;

/// `plan.json`: the planned pairs and methods. Each run that adds to a folder adds a block.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RunPlan {
    /// [`FORMAT`] of the writer.
    pub format: u32,
    /// Blocks; all pairs of a block are evaluated by all of its methods.
    pub blocks: Vec<PlanBlock>,
    /// Estimated cost of the whole plan; only in plans for shards.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub estimate: Option<Estimate>,
}

/// A set of pairs evaluated by a set of methods.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct PlanBlock {
    /// Pair ids in order.
    pub pairs: Vec<String>,
    /// Method labels in order.
    pub methods: Vec<String>,
}

impl RunPlan {
    /// Adds a block unless the plan already has it.
    #[must_use]
    pub fn with(mut self, block: PlanBlock) -> Self {
        self.format = FORMAT;
        if !self.blocks.contains(&block) {
            self.blocks.push(block);
        }
        self
    }

    /// All planned units, as pair id and method.
    pub fn units(&self) -> BTreeSet<(&str, &str)> {
        let mut units = BTreeSet::new();
        for PlanBlock { pairs, methods } in &self.blocks {
            for pair in pairs {
                units.extend(
                    methods
                        .iter()
                        .map(|method| (pair.as_str(), method.as_str())),
                );
            }
        }
        units
    }

    pub fn pairs(&self) -> BTreeSet<&str> {
        let pairs = self.blocks.iter().flat_map(|block| &block.pairs);
        pairs.map(String::as_str).collect()
    }
}

/// Estimated cost of a whole evaluation, including finished units.
///
/// Times and disk space are assumed to grow linearly with the numbers of sources and pairs. If a method predicts
/// Gaussians, only a source's first pair includes the prediction. Rescoring for `common_region` is not included. The
/// time of `command` programs is included only in [`wall_secs`](StageCost::wall_secs).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Estimate {
    /// Number of units (pairs times methods).
    pub units: usize,
    /// Number of distinct source views.
    pub sources: usize,
    /// Number of planned pairs.
    pub pairs: usize,
    /// Number of measured pairs.
    pub measured_pairs: usize,
    /// Number of measured units that failed.
    pub measured_failures: usize,
    /// All stages together. Disk space is that of the finished run folder.
    #[serde(flatten)]
    pub total: StageCost,
    /// Predicting Gaussians and pictures. Disk space is that of the files passed on to the next stage, if stages run
    /// separately.
    pub predict: StageCost,
    pub render: StageCost,
    pub score: StageCost,
}

/// Estimated cost of a stage.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct StageCost {
    /// Time summed over all cores, in seconds.
    pub cpu_secs: f64,
    /// Wall time on this machine, in seconds.
    pub wall_secs: f64,
    /// Peak memory, bytes; `None` if the system does not report it.
    pub peak_bytes: Option<u64>,
    /// Size of the written files, in bytes.
    pub disk_bytes: u64,
}

/// Progress of an evaluation in a folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct RunStatus {
    /// Planned units.
    pub units: usize,
    /// Units with all their scores.
    pub done: usize,
    /// Units with a picture but not all scores.
    pub unscored: usize,
    /// Recorded failures; a run retries them.
    pub failed: usize,
    /// Units without a result.
    pub missing: usize,
}

impl RunStatus {
    pub(super) fn add(&mut self, standing: UnitProgress) {
        self.units += 1;
        *match standing {
            UnitProgress::Done => &mut self.done,
            UnitProgress::Unscored => &mut self.unscored,
            UnitProgress::Failed => &mut self.failed,
            UnitProgress::Missing => &mut self.missing,
        } += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plan_counts_every_unit_once() {
        let block = |pairs: &[&str], methods: &[&str]| PlanBlock {
            pairs: pairs.iter().map(|&p| p.to_owned()).collect(),
            methods: methods.iter().map(|&m| m.to_owned()).collect(),
        };
        let plan = RunPlan::default()
            .with(block(&["p", "q"], &["a"]))
            .with(block(&["p", "q"], &["a"]))
            .with(block(&["q"], &["a", "b"]));
        assert_eq!(plan.blocks.len(), 2);
        let units: Vec<_> = plan.units().into_iter().collect();
        assert_eq!(units, [("p", "a"), ("q", "a"), ("q", "b")]);
    }
}
