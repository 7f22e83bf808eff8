//! Limits on the cost of predictions, which are only meaningful on the same device.

use std::collections::{BTreeMap, BTreeSet};

use super::config::{Limit, Resource};
use super::{Check, CheckState, GateConfig, fired};
use crate::evaluate::unit::Timing;
use crate::track::compare::{ALL, Against, RunComparison};

/// Checks each limit on time and memory. `sides` are the timings of A and B, by pair.
pub(super) fn costs_of(
    comparison: &RunComparison,
    config: &GateConfig,
    against: &Against,
    sides: &[BTreeMap<String, Timing>; 2],
) -> Vec<Check> {
    let device = device_difference(comparison, against, sides);
    let checks = config.fail_if.iter().filter_map(|limit| {
        let Limit::Cost { cost, percent } = limit else {
            return None;
        };
        let check = Check::of(limit.to_string(), cost.name(), against, ALL);
        Some(match (&device, costs(*cost, sides)) {
            (Some(difference), _) => check.decided(CheckState::NotCompared, difference),
            (None, Some([before, now])) if before >= cost.least() => {
                let more = 100.0 * (now / before - 1.0);
                check
                    .measured(before, now, more, 3)
                    .decided(fired(more > *percent), "")
            }
            (None, Some([before, _])) => {
                let (least, unit) = (cost.least(), cost.unit());
                let reason = format!(
                    "A has {before:.3} {unit}; below {least} {unit}, differences are mostly noise"
                );
                check.decided(CheckState::NotCompared, reason)
            }
            (None, None) => check.decided(
                CheckState::NotCompared,
                "not measured in at least one of the runs",
            ),
        })
    });
    checks.collect()
}

/// The first difference between the devices that made the predictions, or the reason why a
/// device is unknown; `None` if the devices are equal.
fn device_difference(
    comparison: &RunComparison,
    against: &Against,
    sides: &[BTreeMap<String, Timing>; 2],
) -> Option<String> {
    let mut machines = Vec::new();
    for (side, timings) in ["A", "B"].into_iter().zip(sides) {
        let known = timings.values().map(|timing| timing.machine.as_deref());
        let known: BTreeSet<Option<&str>> = known.collect();
        match Vec::from_iter(known)[..] {
            [Some(machine)] => machines.push(machine.to_owned()),
            [] => {
                return Some(format!(
                    "{side} has no times; a bundle has them if it was written with --times"
                ));
            }
            [Some(one), other, ..] => {
                let other = other.unwrap_or_default();
                return Some(format!(
                    "{side} was predicted partly by {one} and partly by {other}"
                ));
            }
            [None, ..] => {
                return Some(format!("{side} does not state which processor predicted"));
            }
        }
    }
    let facts = |at: usize, label: &str| {
        let manifest = &comparison.manifests[at];
        let method = manifest.methods.iter().find(|method| method.label == label);
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

/// Costs of A and B over their common pairs: mean seconds per pair, or peak MiB.
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
