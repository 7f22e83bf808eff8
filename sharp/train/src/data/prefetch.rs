//! Samples prepared in the background while the training computes.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use super::{DataError, Source};

/// Samples first, first + 1, … of a source, prepared in order on a separate thread before they are
/// needed. The results do not depend on timing. When dropped, the thread finishes at most its
/// current sample.
#[derive(Debug)]
pub struct Prefetcher<T> {
    /// Receives the samples; `None` only while the prefetcher is being dropped.
    made: Option<Receiver<Result<T, DataError>>>,
    maker: Option<JoinHandle<()>>,
}

impl<T: Send + 'static> Prefetcher<T> {
    /// Starts to prepare samples, beginning with `first`. Up to `ahead` samples (at least 1) are
    /// buffered. The source runs on a single thread, so that all other threads are free for
    /// training.
    ///
    /// # Errors
    /// [`DataError::Start`] if the thread cannot be started.
    pub fn start(
        source: impl Source<T> + 'static,
        first: u64,
        ahead: usize,
    ) -> Result<Self, DataError> {
        let failed = |e: &dyn std::fmt::Display| DataError::Start(e.to_string());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let pool = pool.map_err(|e| failed(&e))?;
        // `ahead` samples wait in the channel, and the thread prepares one more.
        let (sender, made) = sync_channel(ahead.max(1));
        let maker = std::thread::Builder::new()
            .name("training data".to_owned())
            .spawn(move || pool.install(move || make(&source, first, &sender)))
            .map_err(|e| failed(&e))?;
        Ok(Self {
            made: Some(made),
            maker: Some(maker),
        })
    }

    /// Waits for the next sample. After an error, the next call returns the sample that follows.
    ///
    /// # Errors
    /// Any error of the source; [`DataError::Stopped`] if the source panicked.
    pub fn fetch(&mut self) -> Result<T, DataError> {
        let made = self.made.as_ref();
        made.and_then(|made| made.recv().ok())
            .unwrap_or(Err(DataError::Stopped))
    }
}

/// Prepares samples until the receiver is dropped.
fn make<T>(source: &impl Source<T>, first: u64, sender: &SyncSender<Result<T, DataError>>) {
    for k in first.. {
        if sender.send(source.get(k)).is_err() {
            return;
        }
    }
}

impl<T> Drop for Prefetcher<T> {
    fn drop(&mut self) {
        // The thread ends when it next tries to send a sample. If it panicked, that has already
        // been reported.
        drop(self.made.take());
        if let Some(maker) = self.maker.take() {
            let _ = maker.join();
        }
    }
}
