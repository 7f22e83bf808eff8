//! Reused scratch memory, and the distribution of tasks over threads.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

/// A cache line, which also aligns vectors of 16 lanes.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
struct Line([f32; 16]);

/// A zero-initialised vector of f32, aligned to cache lines.
#[derive(Debug, Clone, Default)]
pub(crate) struct Aligned {
    lines: Vec<Line>,
    len: usize,
}

impl Aligned {
    pub(crate) fn zeros(len: usize) -> Self {
        let mut new = Self::default();
        new.grow(len);
        new
    }

    /// Grows to at least `len` elements; existing content is kept.
    pub(crate) fn grow(&mut self, len: usize) {
        if len > self.len {
            self.lines.resize(len.div_ceil(16), Line::zeroed());
            self.len = len;
        }
    }
}

impl std::ops::Deref for Aligned {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        &bytemuck::cast_slice(&self.lines)[..self.len]
    }
}

impl std::ops::DerefMut for Aligned {
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut bytemuck::cast_slice_mut(&mut self.lines)[..self.len]
    }
}

/// Runs `task(index, scratch)` for every index below `count` on the current rayon pool. `scratch`
/// has `scratch_len` floats of arbitrary content, aligned to cache lines.
///
/// The assignment of tasks to threads varies, so tasks must write to disjoint memory. Scratch memory is kept for the
/// next call and grows to the largest size needed: between a few hundred kilobytes and a few megabytes per thread, for
/// each concurrent call.
pub(crate) fn run_tasks(count: usize, scratch_len: usize, task: impl Fn(usize, &mut [f32]) + Sync) {
    static IDLE: Mutex<Vec<Aligned>> = Mutex::new(Vec::new());
    let idle = || IDLE.lock().unwrap_or_else(PoisonError::into_inner);
    let mut scratch = idle().pop().unwrap_or_default();
    let scratch_len = scratch_len.next_multiple_of(16).max(16);
    let workers = rayon::current_num_threads().min(count).max(1);
    scratch.grow(workers * scratch_len);
    let next = AtomicUsize::new(0);
    scratch[..workers * scratch_len]
        .par_chunks_mut(scratch_len)
        .with_max_len(1)
        .for_each(|scratch| {
            loop {
                let index = next.fetch_add(1, Ordering::Relaxed);
                if index >= count {
                    break;
                }
                task(index, scratch);
            }
        });
    idle().push(scratch);
}

/// A slice to which several tasks write, each to its own elements.
#[derive(Clone, Copy)]
pub(crate) struct SharedOut<'a> {
    start: *mut f32,
    len: usize,
    _life: std::marker::PhantomData<&'a mut [f32]>,
}

// SAFETY: access is through `slice` and `pointer`, whose callers guarantee that no two threads access the same
// elements.
unsafe impl Send for SharedOut<'_> {}
// SAFETY: access is through `slice` and `pointer`, whose callers guarantee that no two threads
// access the same elements.
unsafe impl Sync for SharedOut<'_> {}

impl<'a> SharedOut<'a> {
    pub(crate) fn new(slice: &'a mut [f32]) -> Self {
        Self {
            start: slice.as_mut_ptr(),
            len: slice.len(),
            _life: std::marker::PhantomData,
        }
    }

    /// Pointer to element `start`, after checking that `len` elements from there are in bounds.
    #[inline(always)]
    pub(crate) fn pointer(&self, start: usize, len: usize) -> *mut f32 {
        assert!(start <= self.len && len <= self.len - start);
        // SAFETY: in bounds by the assertion.
        unsafe { self.start.add(start) }
    }

    /// Elements `start..start + len`.
    ///
    /// # Safety
    /// While the result lives, no other code may read or write these elements.
    #[allow(clippy::mut_from_ref, reason = "disjointness is the caller's promise")]
    #[inline(always)]
    pub(crate) unsafe fn slice(&self, start: usize, len: usize) -> &'a mut [f32] {
        let start = self.pointer(start, len);
        // SAFETY: in bounds; unaliased by the caller's contract.
        unsafe { std::slice::from_raw_parts_mut(start, len) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_task_runs_once_with_aligned_scratch() {
        let mut out = vec![0.0; 1000];
        let shared = SharedOut::new(&mut out);
        run_tasks(1000, 33, |index, scratch| {
            assert_eq!(scratch.as_ptr() as usize % 64, 0);
            assert!(scratch.len() >= 33);
            // SAFETY: every index is a separate element.
            unsafe { shared.slice(index, 1)[0] += index as f32 };
        });
        assert!(out.iter().enumerate().all(|(i, &v)| v == i as f32));
    }

    #[test]
    #[should_panic(expected = "start <= self.len")]
    fn slices_outside_are_refused() {
        let mut out = vec![0.0; 4];
        let shared = SharedOut::new(&mut out);
        // SAFETY: no other code has the slice.
        let _ = unsafe { shared.slice(2, 3) };
    }

    #[test]
    fn growing_keeps_what_is_there() {
        let mut aligned = Aligned::zeros(3);
        aligned[2] = 5.0;
        aligned.grow(100);
        aligned.grow(10);
        assert_eq!(aligned.len(), 100);
        assert_eq!(aligned[2], 5.0);
        assert_eq!(aligned[99], 0.0);
    }
}
