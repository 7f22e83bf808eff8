//! An open device, its error state, and transfers to the host.

use super::super::RenderError;
use super::GpuAdapter;
use super::memory::{GpuBuffer, Memory};
use std::sync::{Arc, Mutex, PoisonError, mpsc};

/// Maximum size in bytes of a sub-frame's largest binding, even if the adapter allows more. This
/// limits device memory to about half a gigabyte for a picture of any size.
const WINDOW: u64 = 128 << 20;

/// A device and its queue. wgpu reports errors by callback; [`Self::check`] returns the most severe
/// error.
pub(super) struct Gpu {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    pub(super) adapter: String,
    /// Maximum size of a binding, in bytes.
    pub(super) binding_limit: u64,
    /// Maximum number of workgroups along an axis.
    pub(super) groups_limit: u32,
    pub(super) memory: Arc<Memory>,
    fault: Arc<Mutex<Option<DeviceFault>>>,
}

/// An error that the device reported; ordered from least to most severe.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
enum DeviceFault {
    Other(String),
    Memory(String),
    Lost(String),
}

impl From<wgpu::Error> for DeviceFault {
    fn from(error: wgpu::Error) -> Self {
        let what = error.to_string();
        match error {
            wgpu::Error::OutOfMemory { .. } => Self::Memory(what),
            wgpu::Error::Validation { .. } | wgpu::Error::Internal { .. } => Self::Other(what),
        }
    }
}

impl DeviceFault {
    fn at(self, adapter: &str) -> RenderError {
        let adapter = adapter.to_owned();
        match self {
            Self::Other(what) => RenderError::Device { adapter, what },
            Self::Memory(what) => RenderError::OutOfMemory { adapter, what },
            Self::Lost(what) => RenderError::DeviceLost { adapter, what },
        }
    }
}

impl Gpu {
    pub(super) fn open(adapter: &GpuAdapter) -> Result<Self, RenderError> {
        let name = adapter.to_string();
        let limits = adapter.adapter.limits();
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("renderer"),
            required_limits: limits.clone(),
            memory_hints: wgpu::MemoryHints::MemoryUsage,
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.adapter.request_device(&descriptor))
            .map_err(|e| DeviceFault::Other(e.to_string()).at(&name))?;
        let fault = Arc::new(Mutex::new(None));
        let keep = {
            let fault = Arc::clone(&fault);
            move |found: DeviceFault| {
                let mut fault = fault.lock().unwrap_or_else(PoisonError::into_inner);
                // Keeps the first error of the most severe kind, because later errors are usually
                // its consequences.
                if fault.as_ref().is_none_or(|known| {
                    std::mem::discriminant(known) != std::mem::discriminant(&found)
                        && *known < found
                }) {
                    *fault = Some(found);
                }
            }
        };
        let keep_lost = keep.clone();
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| keep(e.into())));
        device.set_device_lost_callback(move |reason, text| {
            keep_lost(DeviceFault::Lost(format!("{reason:?}: {text}")));
        });
        Ok(Self {
            device,
            queue,
            adapter: name,
            binding_limit: limits
                .max_storage_buffer_binding_size
                .min(limits.max_buffer_size),
            groups_limit: limits.max_compute_workgroups_per_dimension,
            memory: Arc::default(),
            fault,
        })
    }

    /// Maximum size of a sub-frame's largest binding, in bytes.
    pub(super) fn window(&self) -> u64 {
        self.binding_limit.min(WINDOW)
    }

    /// Fails with the most severe error since the device was opened, if any.
    pub(super) fn check(&self) -> Result<(), RenderError> {
        let fault = self.fault.lock().unwrap_or_else(PoisonError::into_inner);
        match &*fault {
            Some(fault) => Err(fault.clone().at(&self.adapter)),
            None => Ok(()),
        }
    }

    /// Error for a failed call: the error that a callback reported, if any, else `what`.
    fn error(&self, what: &dyn std::error::Error) -> RenderError {
        let said = DeviceFault::Other(what.to_string()).at(&self.adapter);
        self.check().err().unwrap_or(said)
    }

    pub(super) fn no_room(&self, what: String) -> RenderError {
        DeviceFault::Memory(what).at(&self.adapter)
    }

    /// Submits the commands, waits, and reads back staging buffers. `staged` lists each buffer with
    /// the number of bytes to read from its start; `read` receives each buffer's index in `staged`
    /// and its bytes.
    pub(super) fn finish(
        &self,
        encoder: wgpu::CommandEncoder,
        staged: &[(&GpuBuffer, u64)],
        mut read: impl FnMut(usize, &[u8]),
    ) -> Result<(), RenderError> {
        self.queue.submit([encoder.finish()]);
        let (sender, receiver) = mpsc::channel();
        for (buffer, bytes) in staged {
            let sender = sender.clone();
            buffer.map_async(wgpu::MapMode::Read, ..*bytes, move |result| {
                // Sending cannot fail, because the receiver outlives the wait below.
                let _ = sender.send(result);
            });
        }
        drop(sender);
        self.device
            .poll(wgpu::PollType::Wait {
                submission_index: None,
                timeout: None,
            })
            .map_err(|e| self.error(&e))?;
        for result in receiver {
            result.map_err(|e| self.error(&e))?;
        }
        self.check()?;
        for (index, (buffer, bytes)) in staged.iter().enumerate() {
            let range = buffer
                .get_mapped_range(..*bytes)
                .map_err(|e| self.error(&e))?;
            read(index, &range);
            drop(range);
            buffer.unmap();
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_become_errors_that_callers_can_tell_apart() {
        let text = || "text".to_owned();
        let source = || Box::new(std::fmt::Error);
        let memory = DeviceFault::from(wgpu::Error::OutOfMemory { source: source() });
        assert!(matches!(
            memory.clone().at("a"),
            RenderError::OutOfMemory { .. }
        ));
        let refused = DeviceFault::from(wgpu::Error::Validation {
            source: source(),
            description: text(),
        });
        assert!(matches!(
            refused.clone().at("a"),
            RenderError::Device { .. }
        ));
        let lost = DeviceFault::Lost(text());
        assert!(refused < memory && memory < lost);
        let error = lost.at("some GPU");
        assert_eq!(error.to_string(), "some GPU was lost: text");
        assert!(error.is_device_fault());
        assert!(!RenderError::TooMany(1).is_device_fault());
    }
}
