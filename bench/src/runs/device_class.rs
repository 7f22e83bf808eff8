//! On what kind of device the networks behind the metrics were computed.

use super::manifest::Manifest;

/// Runs whose learned metrics must not share a column.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "the networks behind LPIPS and DISTS were computed by {0} in one run and by {1} in another: such numbers differ in \
     their last digits and do not share a column; report the runs apart, or score them on one device"
)]
pub struct MixedDevices(String, String);

/// Checks that the learned metrics of all runs come from devices of one kind: the CPU's kernels, whatever their
/// instruction set, or candle on one kind of device. Runs without learned metrics do not count.
///
/// # Errors
/// [`MixedDevices`] with the first two kinds.
pub fn check_one_class(runs: &[&Manifest]) -> Result<(), MixedDevices> {
    let mut classes = runs.iter().filter_map(|run| class(run));
    let Some(first) = classes.next() else {
        return Ok(());
    };
    match classes.find(|class| *class != first) {
        Some(other) => Err(MixedDevices(first.to_owned(), other.to_owned())),
        None => Ok(()),
    }
}

/// `candle on …`, or `kernels of the CPU`; `None` for a run without learned metrics.
fn class(run: &Manifest) -> Option<&str> {
    if run.metrics.iter().all(|metric| metric.weights.is_empty()) {
        return None;
    }
    let networks = run.scoring.get("metric networks").map(String::as_str);
    networks
        .filter(|text| text.starts_with("candle on "))
        .or(Some("kernels of the CPU"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn run(weights: &str, networks: Option<&str>) -> Manifest {
        let scoring = match networks {
            Some(text) => json!({ "metric networks": text }),
            None => json!({}),
        };
        serde_json::from_value(json!({
            "format": 1, "version": "", "source_fingerprint": "", "backend": "", "datasets": [],
            "pairs": { "sha256": "", "listed": 0, "evaluated": 0, "origin": "", "options": {} },
            "methods": [],
            "metrics": [{ "key": "dists", "convention": "", "weights": weights }],
            "scoring": scoring,
        }))
        .unwrap()
    }

    #[test]
    fn only_learned_metrics_of_different_kinds_of_devices_are_refused() {
        let (cpu, other) = (
            run("vgg16=a", Some("avx512, winograd")),
            run("vgg16=a", None),
        );
        let (gpu, psnr) = (
            run("vgg16=a", Some("candle on cuda")),
            run("", Some("candle on cuda")),
        );
        assert_eq!(check_one_class(&[]), Ok(()));
        assert_eq!(check_one_class(&[&cpu, &other, &psnr]), Ok(()));
        assert_eq!(check_one_class(&[&gpu, &gpu]), Ok(()));
        let error = check_one_class(&[&cpu, &gpu]).unwrap_err().to_string();
        assert!(
            error.contains("by kernels of the CPU in one run and by candle on cuda"),
            "{error}"
        );
    }
}
