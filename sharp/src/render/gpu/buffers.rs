//! Helpers to create buffers and dispatch passes.

use super::device::Gpu;
use super::memory::GpuBuffer;
use wgpu::{BufferUsages, CommandEncoder, ComputePipeline};

impl Gpu {
    fn buffer(&self, label: &str, bytes: u64, usage: BufferUsages) -> GpuBuffer {
        self.memory
            .count(self.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                // Bindings must not be empty.
                size: bytes.max(16).next_multiple_of(4),
                usage,
                mapped_at_creation: false,
            }))
    }

    /// Creates a zeroed storage buffer of `bytes` bytes.
    pub(super) fn storage(&self, label: &str, bytes: u64) -> GpuBuffer {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        self.buffer(label, bytes, usage)
    }

    /// Creates a storage buffer filled with `data`.
    pub(super) fn filled<T: bytemuck::NoUninit>(&self, label: &str, data: &[T]) -> GpuBuffer {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let buffer = self.storage(label, bytes.len() as u64);
        self.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }

    pub(super) fn uniform<T: bytemuck::NoUninit>(&self, label: &str, value: &T) -> GpuBuffer {
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let buffer = self.buffer(label, size_of::<T>() as u64, usage);
        let bytes = bytemuck::bytes_of(value);
        self.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }

    /// Creates a buffer of `bytes` bytes that the host can map.
    pub(super) fn staging(&self, bytes: u64) -> GpuBuffer {
        let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
        self.buffer("staging", bytes, usage)
    }

    /// Copies the first `bytes` bytes to a new staging buffer.
    pub(super) fn stage(
        &self,
        encoder: &mut CommandEncoder,
        from: &GpuBuffer,
        bytes: u64,
    ) -> GpuBuffer {
        let staging = self.staging(bytes);
        encoder.copy_buffer_to_buffer(from, 0, &staging, 0, bytes);
        staging
    }

    pub(super) fn encoder(&self) -> CommandEncoder {
        self.device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor { label: None })
    }

    /// Dispatches at least `groups` workgroups, along two axes if one axis cannot hold
    /// them.
    pub(super) fn run(
        &self,
        encoder: &mut CommandEncoder,
        pass: &ComputePipeline,
        buffers: &[&GpuBuffer],
        groups: u32,
    ) {
        let x = groups.min(self.groups_limit).max(1);
        self.run_grid(encoder, pass, buffers, (x, groups.div_ceil(x).max(1)));
    }

    /// Dispatches a grid of workgroups; the buffers are bindings 0, 1, ….
    pub(super) fn run_grid(
        &self,
        encoder: &mut CommandEncoder,
        pass: &ComputePipeline,
        buffers: &[&GpuBuffer],
        (x, y): (u32, u32),
    ) {
        let entries: Vec<_> = buffers
            .iter()
            .enumerate()
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                // There are only a few bindings, so this cannot overflow.
                binding: binding as u32,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        let group = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pass.get_bind_group_layout(0),
            entries: &entries,
        });
        let mut dispatch = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        dispatch.set_pipeline(pass);
        dispatch.set_bind_group(0, &group, &[]);
        dispatch.dispatch_workgroups(x, y, 1);
    }
}
