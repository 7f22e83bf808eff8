//! Whether the numbers of two runs may stand in one column.

use std::collections::BTreeSet;

use super::manifest::Manifest;

/// What [`Manifest::scoring`] says of the machine: the devices are compared by [`super::device_class`], and how a run
/// renders is its methods' affair.
const MACHINE: [&str; 3] = ["renderer", "kernels", "metric networks"];

/// The first thing that makes the scores of two runs different quantities: a metric's convention or weights, or a rule
/// of scoring. `None` where they may be compared.
pub fn identity_difference(a: &Manifest, b: &Manifest) -> Option<String> {
    let differs = |what: &str, a: &str, b: &str| {
        (a != b).then(|| format!("{what} is \"{a}\" in one and \"{b}\" in the other"))
    };
    for metric in &b.metrics {
        let Some(before) = a.metrics.iter().find(|m| m.key == metric.key) else {
            continue;
        };
        let convention = differs(&metric.key, &before.convention, &metric.convention);
        let what = format!("the network of {}", metric.key);
        let found = convention
            .or_else(|| differs(&what, &before.weights, &metric.weights))
            .or_else(|| differs("the input range", &before.input_range, &metric.input_range))
            .or_else(|| differs("the resize rule", &before.resize, &metric.resize));
        if found.is_some() {
            return found;
        }
    }
    let rules: BTreeSet<&String> = a.scoring.keys().chain(b.scoring.keys()).collect();
    rules
        .into_iter()
        .filter(|rule| !MACHINE.contains(&rule.as_str()))
        .find_map(|rule| {
            let text = |m: &Manifest| m.scoring.get(rule).cloned().unwrap_or_default();
            differs(rule, &text(a), &text(b))
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::runs::manifest::{FORMAT, PairFacts, scoring_facts};
    use crate::runs::metric_facts::MetricFacts;
    use std::collections::BTreeMap;

    fn manifest(weights: &str, renderer: &str) -> Manifest {
        Manifest {
            format: FORMAT,
            version: "0".into(),
            source_fingerprint: "f".into(),
            backend: renderer.into(),
            datasets: Vec::new(),
            pairs: PairFacts {
                sha256: "p".into(),
                listed: 1,
                evaluated: 1,
                limit: None,
                origin: "built".into(),
                options: BTreeMap::new(),
                proxies: Vec::new(),
            },
            methods: Vec::new(),
            metrics: vec![MetricFacts {
                key: "dists".into(),
                convention: "c".into(),
                weights: weights.into(),
                input_range: String::new(),
                resize: String::new(),
                precision: String::new(),
                backbone: None,
                own_weights: None,
            }],
            scoring: scoring_facts(renderer, "exact"),
        }
    }

    #[test]
    fn other_weights_or_rules_are_another_quantity() {
        let one = manifest("vgg16=aa", "cpu-avx512");
        assert_eq!(identity_difference(&one, &one), None);
        assert_eq!(
            identity_difference(&one, &manifest("vgg16=aa", "wgpu:x")),
            None
        );
        let found = identity_difference(&one, &manifest("vgg16=bb", "cpu-avx512"));
        assert_eq!(
            found.as_deref(),
            Some("the network of dists is \"vgg16=aa\" in one and \"vgg16=bb\" in the other")
        );
        let mut region = one.clone();
        region.scoring.insert("region".into(), "common".into());
        assert!(identity_difference(&one, &region).is_some_and(|d| d.starts_with("region is")));
        // A metric that only one of them has is no difference.
        region = one.clone();
        region.metrics.clear();
        assert_eq!(identity_difference(&one, &region), None);
    }
}
