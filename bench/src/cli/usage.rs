//! Which errors are mistakes of the command line itself.

use sharp_datasets::DatasetError;
use sharp_metrics::SelectionError;
use sharp_metrics::weights::UnknownBackbone;

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
            || cause.downcast_ref::<DatasetError>().is_some_and(|e| {
                matches!(
                    e,
                    DatasetError::Spec { .. } | DatasetError::UnknownFormat { .. }
                )
            })
    })
}
