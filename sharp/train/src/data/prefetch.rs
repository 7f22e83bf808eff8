//! Samples made in the background while the training computes.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use super::{DataError, Source};

/// Samples first, first + 1, … of a source, made in order on a thread of their own, some of them
/// ahead of the one that is asked for. What comes does not depend on timing. Dropped, it finishes at
/// most the sample that it is at.
#[derive(Debug)]
pub struct Prefetcher<T> {
    /// `None` only while it is dropped.
    made: Option<Receiver<Result<T, DataError>>>,
    maker: Option<JoinHandle<()>>,
}

impl<T: Send + 'static> Prefetcher<T> {
    /// Starts with sample `first`; up to `ahead` samples, at least 1, wait to be fetched. The thread
    /// leaves the others of the processor to the training, also where a source could use them.
    ///
    /// # Errors
    /// [`DataError::Start`] when the system gives no thread.
    pub fn start(
        source: impl Source<T> + 'static,
        first: u64,
        ahead: usize,
    ) -> Result<Self, DataError> {
        let failed = |e: &dyn std::fmt::Display| DataError::Start(e.to_string());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let pool = pool.map_err(|e| failed(&e))?;
        // One more is made while these wait.
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

    /// The next sample, as soon as it is made. After an error comes the sample that follows it.
    ///
    /// # Errors
    /// The source's; [`DataError::Stopped`] when it panicked.
    pub fn fetch(&mut self) -> Result<T, DataError> {
        let made = self.made.as_ref();
        made.and_then(|made| made.recv().ok())
            .unwrap_or(Err(DataError::Stopped))
    }
}

/// Makes samples until nobody asks for more.
fn make<T>(source: &impl Source<T>, first: u64, sender: &SyncSender<Result<T, DataError>>) {
    for k in first.. {
        if sender.send(source.get(k)).is_err() {
            return;
        }
    }
}

impl<T> Drop for Prefetcher<T> {
    fn drop(&mut self) {
        // The thread ends at its next attempt to hand on a sample; if it panicked, it said so.
        drop(self.made.take());
        if let Some(maker) = self.maker.take() {
            let _ = maker.join();
        }
    }
}
