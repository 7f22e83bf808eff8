//! Buffers and dispatches in one line each.

use super::device::Gpu;
use wgpu::{Buffer, BufferUsages, CommandEncoder, ComputePipeline};

impl Gpu {
    /// Storage of `bytes` bytes, zeroed; a binding may not be empty.
    pub(super) fn storage(&self, label: &str, bytes: u64) -> Buffer {
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: bytes.max(16),
            usage: BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        })
    }

    /// Storage filled with `data`.
    pub(super) fn filled<T: bytemuck::NoUninit>(&self, label: &str, data: &[T]) -> Buffer {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let buffer = self.storage(label, bytes.len() as u64);
        self.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }

    /// A uniform with these words.
    pub(super) fn uniform(&self, label: &str, words: &[u32]) -> Buffer {
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: (words.len() * 4) as u64,
            usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.queue
            .write_buffer(&buffer, 0, bytemuck::cast_slice(words));
        buffer
    }

    /// Copies the first `bytes` bytes after `offset` to a buffer that the host can map.
    pub(super) fn stage(
        &self,
        encoder: &mut CommandEncoder,
        from: &Buffer,
        offset: u64,
        bytes: u64,
    ) -> Buffer {
        let staging = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("staging"),
            size: bytes,
            usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        encoder.copy_buffer_to_buffer(from, offset, &staging, 0, bytes);
        staging
    }

    pub(super) fn encoder(&self) -> CommandEncoder {
        self.device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor { label: None })
    }

    /// Dispatches at least `groups` workgroups, over two axes where one cannot hold them.
    pub(super) fn run(
        &self,
        encoder: &mut CommandEncoder,
        pipeline: &ComputePipeline,
        buffers: &[&Buffer],
        groups: u32,
    ) {
        let x = groups.min(self.groups_limit).max(1);
        self.run_grid(encoder, pipeline, buffers, (x, groups.div_ceil(x).max(1)));
    }

    /// Dispatches a grid of workgroups; the buffers are bindings 0, 1, ….
    pub(super) fn run_grid(
        &self,
        encoder: &mut CommandEncoder,
        pipeline: &ComputePipeline,
        buffers: &[&Buffer],
        (x, y): (u32, u32),
    ) {
        let entries: Vec<_> = buffers
            .iter()
            .enumerate()
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                // A handful.
                binding: binding as u32,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        let group = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: None,
            timestamp_writes: None,
        });
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(x, y, 1);
    }
}
