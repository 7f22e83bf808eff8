//! Learning-rate schedule: linear warm-up, then half a cosine.

use serde::Deserialize;

/// The paper's schedule; the defaults are its values.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Schedule {
    /// Learning rate at the end of the warm-up.
    pub peak: f64,
    /// Learning rate at the last step.
    pub last: f64,
    /// Number of steps from 0 to the peak. If it is 0, the first step is already close to the peak.
    pub warmup_steps: u64,
}

impl Default for Schedule {
    fn default() -> Self {
        Self {
            peak: 1.6e-4,
            last: 1.6e-5,
            warmup_steps: 10_000,
        }
    }
}

impl Schedule {
    /// Learning rate at `step` of `steps`, counted from 1 (it would be 0 at step 0). Constant after the last step.
    pub fn learning_rate(&self, step: u64, steps: u64) -> f64 {
        let warmup = self.warmup_steps;
        if step < warmup {
            return self.peak * step as f64 / warmup as f64;
        }
        if step >= steps {
            return self.last;
        }
        let share = (step - warmup) as f64 / (steps - warmup) as f64;
        let cosine = (std::f64::consts::PI * share).cos();
        self.last + 0.5 * (self.peak - self.last) * (1.0 + cosine)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_schedule_has_its_published_values() {
        let rate = |step| Schedule::default().learning_rate(step, 100_000);
        let close = |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 1e-12);
        close(rate(1), 1.6e-8);
        close(rate(5_000), 0.8e-4);
        close(rate(9_999), 1.6e-4 * 0.9999);
        close(rate(10_000), 1.6e-4);
        // Half of the cosine, then a third of its angle: (1 + cos 60°) / 2 = 3/4.
        close(rate(55_000), 0.5 * (1.6e-4 + 1.6e-5));
        close(rate(40_000), 1.6e-5 + 0.75 * 1.44e-4);
        close(rate(100_000), 1.6e-5);
        close(rate(100_001), 1.6e-5);
    }

    #[test]
    fn without_warm_up_the_cosine_starts_at_once() {
        let schedule = Schedule {
            peak: 3.0,
            last: 1.0,
            warmup_steps: 0,
        };
        let found = [1, 2, 3, 4].map(|step| schedule.learning_rate(step, 4));
        let root = 0.5_f64.sqrt();
        for (found, expected) in found.iter().zip([2.0 + root, 2.0, 2.0 - root, 1.0]) {
            assert!((found - expected).abs() < 1e-12, "{found}");
        }
    }
}
