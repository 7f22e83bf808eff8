//! An open device, its faults, and the way back to the host.

use super::super::RenderError;
use super::GpuAdapter;
use std::sync::{Arc, Mutex, PoisonError, mpsc};

/// A device and its queue. wgpu reports faults by callback; [`Self::check`] turns the first one
/// into an error.
pub(super) struct Gpu {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    pub(super) adapter: String,
    /// Largest binding to use, bytes.
    pub(super) binding_limit: u64,
    /// Most workgroups along an axis.
    pub(super) groups_limit: u32,
    fault: Arc<Mutex<Option<String>>>,
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
            .map_err(|e| RenderError::Device {
                adapter: name.clone(),
                what: e.to_string(),
            })?;
        let fault = Arc::new(Mutex::new(None));
        let keep = {
            let fault = Arc::clone(&fault);
            move |what: String| {
                let mut fault = fault.lock().unwrap_or_else(PoisonError::into_inner);
                fault.get_or_insert(what);
            }
        };
        let keep_lost = keep.clone();
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| keep(e.to_string())));
        device.set_device_lost_callback(move |reason, text| {
            keep_lost(format!("device lost ({reason:?}): {text}"));
        });
        Ok(Self {
            device,
            queue,
            adapter: name,
            binding_limit: limits
                .max_storage_buffer_binding_size
                .min(limits.max_buffer_size),
            groups_limit: limits.max_compute_workgroups_per_dimension,
            fault,
        })
    }

    /// The first fault since the device was opened.
    pub(super) fn check(&self) -> Result<(), RenderError> {
        let fault = self.fault.lock().unwrap_or_else(PoisonError::into_inner);
        match &*fault {
            Some(what) => Err(self.error(what.clone())),
            None => Ok(()),
        }
    }

    pub(super) fn error(&self, what: String) -> RenderError {
        RenderError::Device {
            adapter: self.adapter.clone(),
            what,
        }
    }

    /// Submits the commands, waits, and hands `read` the bytes of each staging buffer.
    pub(super) fn finish(
        &self,
        encoder: wgpu::CommandEncoder,
        staged: &[&wgpu::Buffer],
        mut read: impl FnMut(usize, &[u8]),
    ) -> Result<(), RenderError> {
        self.queue.submit([encoder.finish()]);
        let (sender, receiver) = mpsc::channel();
        for buffer in staged {
            let sender = sender.clone();
            buffer.map_async(wgpu::MapMode::Read, .., move |result| {
                // The receiver outlives the wait below.
                let _ = sender.send(result);
            });
        }
        drop(sender);
        self.device
            .poll(wgpu::PollType::Wait {
                submission_index: None,
                timeout: None,
            })
            .map_err(|e| self.error(e.to_string()))?;
        for result in receiver {
            result.map_err(|e| self.error(e.to_string()))?;
        }
        self.check()?;
        for (index, buffer) in staged.iter().enumerate() {
            let bytes = buffer
                .get_mapped_range(..)
                .map_err(|e| self.error(e.to_string()))?;
            read(index, &bytes);
            drop(bytes);
            buffer.unmap();
        }
        Ok(())
    }
}
