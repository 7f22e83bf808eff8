//! Limits on the cost of predictions, which are meaningless across different devices.

use std::collections::{BTreeMap, BTreeSet};

use super::config::{Limit, Resource};
use super::judge::{Judge, blank};
use super::{Check, CheckState};
use crate::evaluate::unit::Timing;
use crate::track::compare::{ALL, Against};

impl Judge<'_> {
    /// Each limit on what predictions cost.
    pub(super) fn costs_of(&mut self, against: &Against, sides: &[BTreeMap<String, Timing>; 2]) {
        let device = self.device_difference(against, sides);
        for limit in &self.config.fail_if {
            let Limit::Cost { cost, percent } = limit else {
                continue;
            };
            let check = blank(limit.to_string(), cost.name(), against, ALL);
            let check = match (&device, costs(*cost, sides)) {
                (Some(difference), _) => Check {
                    state: CheckState::NotCompared,
                    reason: difference.clone(),
                    ..check
                },
                (None, Some([before, now])) if before >= cost.least() => {
                    let more = 100.0 * (now / before - 1.0);
                    Check {
                        state: match more > *percent {
                            true => CheckState::Fired,
                            false => CheckState::Passed,
                        },
                        a: Some(before),
                        b: Some(now),
                        difference: Some(more),
                        decimals: 3,
                        ..check
                    }
                }
                (None, _) => Check {
                    state: CheckState::NotCompared,
                    reason: format!(
                        "not measured, or below {}, where noise decides",
                        cost.least()
                    ),
                    ..check
                },
            };
            self.subjects.push(None);
            self.checks.push(check);
        }
    }

    /// The first thing in which the devices that predicted differ, or why that is not known.
    fn device_difference(
        &self,
        against: &Against,
        sides: &[BTreeMap<String, Timing>; 2],
    ) -> Option<String> {
        let mut machines = Vec::new();
        for (side, timings) in ["A", "B"].into_iter().zip(sides) {
            let known = timings.values().map(|timing| timing.machine.as_deref());
            let known: BTreeSet<Option<&str>> = known.collect();
            let mut known = known.into_iter();
            match (known.next(), known.next()) {
                (Some(Some(machine)), None) => machines.push(machine.to_owned()),
                (None, _) => return Some(format!("{side} holds no times; bundles never do")),
                (Some(None), _) => {
                    return Some(format!("{side} does not say which processor predicted"));
                }
                (Some(Some(one)), Some(other)) => {
                    let other = other.unwrap_or_default();
                    return Some(format!("{side} was predicted by {one}, and by {other}"));
                }
            }
        }
        let facts = |at: usize, label: &str| {
            let manifest = &self.comparison.manifests[at];
            let mut methods = manifest.methods.iter();
            let method = methods.find(|method| method.label == label);
            let device = method.and_then(|method| method.identity.settings.get("device"));
            [
                ("processor", machines[at].clone()),
                ("class of CPU kernels", manifest.kernels.name().to_owned()),
                ("renderer", manifest.renderer.backend.clone()),
                ("network's device", device.cloned().unwrap_or_default()),
            ]
        };
        let mut facts = facts(0, &against.a).into_iter().zip(facts(1, &against.b));
        let ((what, a), (_, b)) = facts.find(|(a, b)| a != b)?;
        Some(format!("the {what} is {a} in A and {b} in B"))
    }
}

/// Costs of A and B: mean seconds per pair over the pairs that both have, or MiB.
fn costs(cost: Resource, sides: &[BTreeMap<String, Timing>; 2]) -> Option<[f64; 2]> {
    let [a, b] = sides;
    let both = || a.iter().filter_map(|(pair, a)| Some([a, b.get(pair)?]));
    let each: [Vec<&Timing>; 2] = [0, 1].map(|side| both().map(|timing| timing[side]).collect());
    let [a, b] = each.map(|timings| match cost {
        Resource::SecondsPerPair => {
            let total: f64 = timings.iter().map(|timing| timing.synthesis_secs()).sum();
            Some(total / timings.len() as f64)
        }
        Resource::PeakMemory => {
            let peaks: Option<Vec<u64>> = timings.iter().map(|timing| timing.peak_bytes).collect();
            Some(peaks?.into_iter().max()? as f64 / (1 << 20) as f64)
        }
    });
    Some([a?, b?])
}
