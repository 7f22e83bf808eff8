//! Exit codes of commands.

use sharp_datasets::DatasetError;
use sharp_metrics::SelectionError;
use sharp_metrics::weights::UnknownBackbone;

use crate::config::ConfigError;
use crate::evaluate::EvaluateError;
use crate::methods::SpecError;
use crate::pairs::{OpenDataset, PairError};
use crate::report::ReportError;
use crate::scale::ScaleError;
use crate::train::TrainError;

/// Outcome of a command that completed or can be resumed; all other outcomes are errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outcome {
    /// Exit code 0.
    Done,
    /// A gate fired: exit code 3.
    GateFired,
    /// Completed, but with recorded failures or findings: exit code 4.
    RecordedFailures,
    /// No limit of a gate fired, but one cannot be decided: exit code 5.
    GateInconclusive,
    /// Stopped early; the same command continues: exit code 75.
    Resumable,
}

impl Outcome {
    /// Replaces `Done` with `RecordedFailures` if scenes or views are missing from the results because their files are
    /// broken or incomplete.
    pub(super) fn with_scenes_of(self, datasets: &[OpenDataset]) -> Self {
        let broken = datasets
            .iter()
            .any(|dataset| dataset.broken().next().is_some() || dataset.unreadable_views() > 0);
        self.or(Self::of_problems(broken))
    }

    /// `other` if `self` is `Done`, else `self`.
    pub(super) fn or(self, other: Self) -> Self {
        if self == Self::Done { other } else { self }
    }

    pub(super) fn of_problems(problems: bool) -> Self {
        if problems {
            Self::RecordedFailures
        } else {
            Self::Done
        }
    }

    pub(super) fn exit_code(self) -> u8 {
        match self {
            Self::Done => 0,
            Self::GateFired => 3,
            Self::RecordedFailures => 4,
            Self::GateInconclusive => 5,
            Self::Resumable => 75,
        }
    }
}

/// Options on the command line that contradict each other, independently of files.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(super) struct UsageError(pub(super) String);

/// Whether the mistake is in the command line rather than in files, so that the exit code is 2.
pub(super) fn is_usage(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        cause.is::<UsageError>()
            || cause.downcast_ref().is_some_and(ConfigError::is_usage)
            || cause.is::<SelectionError>()
            || cause.is::<UnknownBackbone>()
            || matches!(cause.downcast_ref(), Some(ScaleError::Refused { .. }))
            || matches!(cause.downcast_ref(), Some(TrainError::NotHeldOut { .. }))
            || matches!(
                cause.downcast_ref::<SpecError>(),
                Some(SpecError::UnknownKind { .. } | SpecError::Malformed { .. })
            )
            || matches!(cause.downcast_ref(), Some(EvaluateError::NoOutput))
            || matches!(
                cause.downcast_ref::<ReportError>(),
                Some(ReportError::NotOneMethod)
            )
            || dataset_error(cause).is_some_and(|e| {
                matches!(
                    e,
                    DatasetError::Spec { .. } | DatasetError::UnknownFormat { .. }
                )
            })
    })
}

/// Whether a signal or the time budget stopped the command. The exit code is then 75, and the same command continues.
pub(super) fn is_stopped(error: &anyhow::Error) -> bool {
    let of_evaluation =
        |error: &EvaluateError| matches!(error, EvaluateError::Pairs(PairError::Stopped));
    error.chain().any(|cause| {
        matches!(cause.downcast_ref(), Some(PairError::Stopped))
            || cause.downcast_ref().is_some_and(of_evaluation)
            || match cause.downcast_ref() {
                Some(TrainError::Pairs(error)) => matches!(error, PairError::Stopped),
                Some(TrainError::Evaluate(error)) => of_evaluation(error),
                _ => false,
            }
    })
}

/// The dataset error in `cause`; `None` if it neither is nor wraps one.
fn dataset_error<'a>(cause: &'a (dyn std::error::Error + 'static)) -> Option<&'a DatasetError> {
    let of_pairs = |error: &'a PairError| match error {
        PairError::Dataset(error) => Some(error),
        _ => None,
    };
    match cause.downcast_ref::<EvaluateError>() {
        Some(EvaluateError::Pairs(error)) => of_pairs(error),
        _ => match (cause.downcast_ref(), cause.downcast_ref()) {
            (Some(error), _) | (_, Some(ConfigError::Pairs(error))) => of_pairs(error),
            _ => cause.downcast_ref(),
        },
    }
}
