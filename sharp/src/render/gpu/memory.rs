//! Tracking of the memory of device buffers.

use std::ops::Deref;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Current and peak bytes of the buffers of one device.
#[derive(Debug, Default)]
pub(super) struct Memory {
    now: AtomicU64,
    peak: AtomicU64,
}

impl Memory {
    /// Maximum total size of simultaneously allocated buffers, in bytes.
    pub(super) fn peak(&self) -> u64 {
        self.peak.load(Ordering::Relaxed)
    }

    /// Tracks a buffer until it is dropped.
    pub(super) fn count(self: &Arc<Self>, buffer: wgpu::Buffer) -> GpuBuffer {
        let now = self.now.fetch_add(buffer.size(), Ordering::Relaxed) + buffer.size();
        self.peak.fetch_max(now, Ordering::Relaxed);
        GpuBuffer {
            buffer,
            memory: Arc::clone(self),
        }
    }
}

/// A buffer tracked by a [`Memory`].
pub(super) struct GpuBuffer {
    buffer: wgpu::Buffer,
    memory: Arc<Memory>,
}

impl Deref for GpuBuffer {
    type Target = wgpu::Buffer;

    fn deref(&self) -> &wgpu::Buffer {
        &self.buffer
    }
}

impl Drop for GpuBuffer {
    fn drop(&mut self) {
        self.memory
            .now
            .fetch_sub(self.buffer.size(), Ordering::Relaxed);
    }
}
