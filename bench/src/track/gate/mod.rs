//! Decides whether run B may replace run A. A limit fires if a mean score is worse by more than the limit *and* the
//! difference is statistically significant. It also fires if a single scene is worse by more than its limit, if pairs
//! lost their scores, or if predictions cost more.
//!
//! * [`config`]: limits and their text form; [`output`]: tables, JUnit XML and Markdown.
//! * `judge`: applies limits on scores and coverage to a comparison; `cost`: limits on time and
//!   memory.
//!
//! A limit that cannot be judged never passes silently; see the table in `bench/docs/gate.md`.

pub mod config;
mod cost;
mod judge;
pub mod output;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::compare::{Against, CompareError, Practical, compare};
use crate::evaluate::EvaluateError;
pub use config::{GateConfig, Limit};
use judge::judge;

/// Why a gate cannot be evaluated.
#[derive(Debug, thiserror::Error)]
pub enum GateError {
    /// The runs cannot be compared.
    #[error(transparent)]
    Compare(#[from] CompareError),
    /// The times of a run cannot be read.
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    /// A limit names something that the runs do not have.
    #[error("{0}")]
    Limits(String),
}

/// Outcome of one check, or of all checks; from least to most severe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CheckState {
    #[default]
    Passed,
    /// The difference is beyond the limit, but not significant.
    NotSignificant,
    /// A cost that was not measured, is too small, or was measured on different devices.
    NotCompared,
    /// The runs do not allow a decision.
    Inconclusive,
    Fired,
}

impl CheckState {
    /// Display text.
    pub fn text(self) -> &'static str {
        match self {
            Self::Passed => "passed",
            Self::NotSignificant => "not significant",
            Self::NotCompared => "not compared",
            Self::Inconclusive => "inconclusive",
            Self::Fired => "fired",
        }
    }
}

/// A limit applied to one dataset or scene. Unknown and non-finite values are null.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Check {
    pub state: CheckState,
    /// The limit as written; `missing_pairs > 0` for coverage.
    pub limit: String,
    /// Key of a metric, name of a cost, or `missing_pairs` for coverage.
    pub quantity: String,
    pub method_a: String,
    pub method_b: String,
    /// The dataset's name, or `all`.
    pub dataset: String,
    /// The scene, for limits `per scene`.
    pub scene: Option<String>,
    /// Mean score or cost of A; for coverage, the number of pairs with scores in A.
    pub a: Option<f64>,
    /// Mean score or cost of B; for coverage, the number of pairs with scores in A that also have
    /// scores in B.
    pub b: Option<f64>,
    /// B − A; for costs, the increase in per cent.
    pub difference: Option<f64>,
    /// Lower end of the 95 % confidence interval of the difference.
    pub ci_low: Option<f64>,
    /// Upper end of the 95 % confidence interval of the difference.
    pub ci_high: Option<f64>,
    pub p_holm: Option<f64>,
    /// Minimum detectable effect with 80 % power.
    pub mde: Option<f64>,
    /// Reason for the state, in one line; empty if the numbers suffice.
    pub reason: String,
    /// Number of decimals in tables.
    #[serde(skip)]
    pub decimals: usize,
}

/// A pair that got worse.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WorsePair {
    pub pair_id: String,
    pub a: f64,
    pub b: f64,
    /// How much worse B is than A, in the metric's unit.
    pub loss: f64,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GateReport {
    pub a: PathBuf,
    pub b: PathBuf,
    /// Fired if any check fired; otherwise inconclusive if any check is inconclusive; otherwise passed.
    pub state: CheckState,
    pub checks: Vec<Check>,
    /// Index of the check that [`Self::worst`] belongs to: the first fired check on a metric; if
    /// none fired, the first check on a metric.
    pub worst_of: Option<usize>,
    /// The pairs with the largest losses, worst first; at most three.
    pub worst: Vec<WorsePair>,
    /// Notes that do not affect the outcome.
    pub notes: Vec<String>,
}

impl Check {
    /// A check of two methods on a dataset, not yet judged.
    fn of(limit: String, quantity: &str, against: &Against, dataset: &str) -> Self {
        Self {
            limit,
            quantity: quantity.to_owned(),
            method_a: against.a.clone(),
            method_b: against.b.clone(),
            dataset: dataset.to_owned(),
            ..Self::default()
        }
    }

    fn decided(self, state: CheckState, reason: impl Into<String>) -> Self {
        Self {
            state,
            reason: reason.into(),
            ..self
        }
    }

    /// Sets the values of A and B and the difference between them.
    fn measured(self, a: f64, b: f64, difference: f64, decimals: usize) -> Self {
        Self {
            a: Some(a),
            b: Some(b),
            difference: Some(difference),
            decimals,
            ..self
        }
    }
}

fn fired(is_beyond: bool) -> CheckState {
    if is_beyond {
        CheckState::Fired
    } else {
        CheckState::Passed
    }
}

impl GateReport {
    /// A summary such as `failed: 2 of 9 checks fired`.
    pub fn headline(&self) -> String {
        let count = |state| self.checks.iter().filter(|c| c.state == state).count();
        let of = self.checks.len();
        let mut said = match self.state {
            CheckState::Fired => {
                format!("failed: {} of {of} checks fired", count(CheckState::Fired))
            }
            CheckState::Inconclusive => format!(
                "inconclusive: {} of {of} checks cannot be decided",
                count(CheckState::Inconclusive)
            ),
            _ => format!("passed: none of {of} checks fired"),
        };
        for state in [
            CheckState::Inconclusive,
            CheckState::NotSignificant,
            CheckState::NotCompared,
        ] {
            if count(state) > 0 && state != self.state {
                said += &format!(", {} {}", count(state), state.text());
            }
        }
        said
    }

    /// The `compare` command that shows details.
    pub fn compare_command(&self) -> String {
        let methods: BTreeSet<_> = self
            .checks
            .iter()
            .map(|check| (&check.method_a, &check.method_b))
            .collect();
        let methods: String = methods
            .into_iter()
            .map(|(a, b)| format!(" --method {}", shell_word(&format!("{a}={b}"))))
            .collect();
        let [a, b] = [&self.a, &self.b].map(|run| shell_word(&run.display().to_string()));
        format!("sharp-bench compare {a} {b}{methods}")
    }
}

fn shell_word(text: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-=+:@".contains(c);
    if !text.is_empty() && text.chars().all(is_plain) {
        text.to_owned()
    } else {
        format!("'{}'", text.replace('\'', r"'\''"))
    }
}

/// Judges run B relative to run A. `methods` are pairs of labels `(in A, in B)`, as for [`compare`].
///
/// # Errors
/// If the runs cannot be compared, or a limit names a metric or a dataset that the runs do not
/// have.
///
/// Without limits, any significant loss in a metric of both runs fires.
pub fn gate(
    a: &Path,
    b: &Path,
    methods: &[(String, String)],
    config: &GateConfig,
) -> Result<GateReport, GateError> {
    let comparison = compare(a, b, methods, &Practical::default())?;
    let mut config = config.clone();
    if config.fail_if.is_empty() {
        let [of_a, of_b] = &comparison.manifests;
        let keys = of_a.metrics.iter().map(|metric| metric.info.key);
        let common = keys.filter(|key| of_b.metrics.iter().any(|m| m.info.key == *key));
        config.fail_if = common.map(Limit::any_loss).collect();
    }
    judge(&comparison, &config, [a, b])
}

#[cfg(test)]
mod tests;
