//! Which errors are mistakes of the command line itself.

use sharp_datasets::DatasetError;
use sharp_metrics::SelectionError;
use sharp_metrics::weights::UnknownBackbone;

use crate::evaluate::EvaluateError;
use crate::pairs::PairError;

/// A command line that asks for something that cannot be, whatever the files say.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(super) struct UsageError(pub(super) String);

/// True where another command line is needed, not another file: exit code 2.
pub fn is_usage(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        cause.is::<UsageError>()
            || cause.is::<SelectionError>()
            || cause.is::<UnknownBackbone>()
            || dataset_error(cause).is_some_and(|e| {
                matches!(
                    e,
                    DatasetError::Spec { .. } | DatasetError::UnknownFormat { .. }
                )
            })
    })
}

/// The error of a dataset, also where others pass it on as their own.
fn dataset_error<'a>(cause: &'a (dyn std::error::Error + 'static)) -> Option<&'a DatasetError> {
    let of_pairs = |error: &'a PairError| match error {
        PairError::Dataset(error) => Some(error),
        _ => None,
    };
    match cause.downcast_ref::<EvaluateError>() {
        Some(EvaluateError::Pairs(error)) => of_pairs(error),
        _ => match cause.downcast_ref::<PairError>() {
            Some(error) => of_pairs(error),
            None => cause.downcast_ref(),
        },
    }
}
