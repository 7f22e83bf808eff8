//! The plan of a run.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use super::estimate::Estimate;
use super::manifest::FORMAT;

/// `plan.json`: which pairs by which methods. A folder that several runs added to has several blocks.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct RunPlan {
    /// [`FORMAT`] of the writer.
    pub format: u32,
    /// All pairs of a block are evaluated by all its methods.
    pub blocks: Vec<PlanBlock>,
    /// What all of it would cost, where it was planned to be worked off by shards.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub estimate: Option<Estimate>,
}

/// Pairs by methods.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct PlanBlock {
    /// Ids in order.
    pub pairs: Vec<String>,
    /// Labels in order.
    pub methods: Vec<String>,
}

impl RunPlan {
    /// Adds a block unless it is there.
    #[must_use]
    pub fn with(mut self, block: PlanBlock) -> Self {
        self.format = FORMAT;
        if !self.blocks.contains(&block) {
            self.blocks.push(block);
        }
        self
    }

    /// Every planned pair with a method, once.
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

    /// Every planned pair, once.
    pub fn pairs(&self) -> BTreeSet<&str> {
        let pairs = self.blocks.iter().flat_map(|block| &block.pairs);
        pairs.map(String::as_str).collect()
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
