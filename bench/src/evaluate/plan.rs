//! The plan of a run: its units, their estimated cost and their progress.

use std::collections::BTreeSet;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::manifest::FORMAT;
use super::unit::UnitProgress;

/// `plan.json`: which pairs by which methods. A folder that several runs added to has several blocks.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RunPlan {
    /// [`FORMAT`] of the writer.
    pub format: u32,
    /// All pairs of a block are evaluated by all its methods.
    pub blocks: Vec<PlanBlock>,
    /// The estimated cost of all of it, of plans for shards.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub estimate: Option<Estimate>,
}

/// Pairs by methods.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct PlanBlock {
    /// Ids in order.
    pub pairs: Vec<String>,
    /// Labels in order.
    pub methods: Vec<String>,
}

impl RunPlan {
    /// Adds a block, once.
    #[must_use]
    pub fn with(mut self, block: PlanBlock) -> Self {
        self.format = FORMAT;
        if !self.blocks.contains(&block) {
            self.blocks.push(block);
        }
        self
    }

    /// Every planned pair with each method.
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

/// The estimated cost of a whole evaluation, finished units included.
///
/// Linear in sources and pairs: if a method predicts Gaussians, only the first pair of a source pays for the
/// prediction. Rescoring by `common_region` is not counted; [`wall_secs`](StageCost::wall_secs) alone counts the time of
/// `command` programs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Estimate {
    /// Pairs by methods.
    pub units: usize,
    /// Different source views.
    pub sources: usize,
    /// Pairs of the plan.
    pub pairs: usize,
    /// Pairs that were measured.
    pub measured_pairs: usize,
    /// Measured units that failed.
    pub measured_failures: usize,
    /// All stages together; disk space is what stays in the run folder.
    #[serde(flatten)]
    pub total: StageCost,
    /// Predicted Gaussians and pictures. Disk space is what separate stages keep of them.
    pub predict: StageCost,
    /// Renderings.
    pub render: StageCost,
    /// Metrics.
    pub score: StageCost,
}

/// Estimated cost of a stage.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct StageCost {
    /// Time of all cores together, s.
    pub cpu_secs: f64,
    /// Wall time on this machine, s.
    pub wall_secs: f64,
    /// `None` if the system does not say.
    pub peak_bytes: Option<u64>,
    /// Bytes of the files that it writes.
    pub disk_bytes: u64,
}

/// Progress of an evaluation in a folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct RunStatus {
    /// Units of the plan.
    pub units: usize,
    /// Units with all their scores.
    pub done: usize,
    /// Units with a picture but not all scores.
    pub unscored: usize,
    /// Recorded failures; a run tries them again.
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
