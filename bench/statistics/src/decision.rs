//! Derives a verdict from p and interval.

use crate::inference::{ALPHA, Inference};

/// Holm's step-down correction ("A simple sequentially rejective multiple test procedure", Scandinavian Journal of
/// Statistics, 1979): rejecting the corrected p values below a level keeps the probability of any false alarm at or
/// below that level. `None` marks a missing test, which is not counted.
pub fn holm(p: &[Option<f64>]) -> Vec<Option<f64>> {
    let mut order: Vec<(f64, usize)> = (0..p.len()).filter_map(|k| Some((p[k]?, k))).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut corrected = vec![None; p.len()];
    let mut largest = 0.0_f64;
    for (rank, (value, k)) in order.iter().enumerate() {
        largest = largest.max(value * (order.len() - rank) as f64).min(1.0);
        corrected[*k] = Some(largest);
    }
    corrected
}

/// The outcome for side B, relative to side A.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    Better,
    Worse,
    /// No difference: the sides are equal, or the interval lies within the practical threshold.
    None,
    /// The data do not allow a decision.
    Inconclusive,
}

/// The verdict that a mean difference supports: none if `all_equal`; otherwise, inconclusive without `inference`.
///
/// If the corrected p is significant, the verdict is better or worse, even if the difference is too
/// small to matter. If p is not significant, the verdict is none if the whole interval lies within
/// ±`practical` (the largest difference that does not matter), and inconclusive otherwise.
pub fn verdict(
    inference: Option<&Inference>,
    p_corrected: Option<f64>,
    all_equal: bool,
    higher_is_better: bool,
    practical: f64,
) -> Verdict {
    let Some(inference) = inference.filter(|_| !all_equal) else {
        return if all_equal {
            Verdict::None
        } else {
            Verdict::Inconclusive
        };
    };
    if p_corrected.is_some_and(|p| p < ALPHA) {
        return if (inference.mean > 0.0) == higher_is_better {
            Verdict::Better
        } else {
            Verdict::Worse
        };
    }
    let (low, high) = inference.interval;
    if low >= -practical && high <= practical {
        Verdict::None
    } else {
        Verdict::Inconclusive
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Clusters, Resampling, infer};

    #[test]
    fn holm_as_by_statsmodels() {
        let p = [
            Some(0.01),
            Some(0.04),
            None,
            Some(0.03),
            Some(0.005),
            Some(0.2),
        ];
        let expected = [
            Some(0.04),
            Some(0.09),
            None,
            Some(0.09),
            Some(0.025),
            Some(0.2),
        ];
        for (ours, expected) in holm(&p).into_iter().zip(expected) {
            assert_eq!(ours.is_some(), expected.is_some());
            assert!((ours.unwrap_or(0.0) - expected.unwrap_or(0.0)).abs() < 1e-15);
        }
        assert_eq!(holm(&[Some(0.7), Some(0.6)]), [Some(1.0), Some(1.0)]);
        assert!(holm(&[]).is_empty());
    }

    #[test]
    fn verdicts() {
        let differences = [0.9, 1.0, 1.1, 1.0].into_iter().enumerate();
        let sample = Clusters::new(differences.map(|(scene, d)| (scene, [20.0, 20.0 + d])));
        let found = infer(&[&sample], Resampling::default()).expect("four scenes");
        let judge = |p, higher, practical| verdict(Some(&found), p, false, higher, practical);
        assert_eq!(judge(Some(0.049), true, 0.0), Verdict::Better);
        assert_eq!(judge(Some(0.049), false, 0.0), Verdict::Worse);
        // Significant, even if too small to matter.
        assert_eq!(judge(Some(0.049), false, 2.0), Verdict::Worse);
        assert_eq!(judge(Some(0.05), false, 0.0), Verdict::Inconclusive);
        assert_eq!(judge(Some(0.05), false, 1.0), Verdict::Inconclusive);
        assert_eq!(judge(Some(0.05), false, 1.5), Verdict::None);
        assert_eq!(judge(None, true, 0.0), Verdict::Inconclusive);
        assert_eq!(verdict(None, None, false, true, 9.0), Verdict::Inconclusive);
        assert_eq!(verdict(None, None, true, true, 0.0), Verdict::None);
    }
}
