//! How long each pass takes on the device, by timestamp queries.

use std::sync::{Mutex, PoisonError};

/// Time that the device spent in one pass of a frame, all its dispatches together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassTime {
    /// The pass: the name of its file.
    pub pass: &'static str,
    /// How often it ran.
    pub dispatches: u32,
    /// On the device's clock.
    pub seconds: f64,
}

/// Dispatches that one submission can time; a frame's have fewer.
const CAPACITY: u32 = 512;

/// The queries of one device, which adapters need not have.
pub(super) struct Timer {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    staging: wgpu::Buffer,
    seconds_per_tick: f64,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    /// Dispatches of the commands that are being recorded.
    open: Vec<&'static str>,
    sums: Vec<PassTime>,
}

impl Timer {
    pub(super) fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Option<Self> {
        if !device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            return None;
        }
        let buffer = |label, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: u64::from(CAPACITY) * 16,
                usage,
                mapped_at_creation: false,
            })
        };
        Some(Self {
            queries: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("passes"),
                ty: wgpu::QueryType::Timestamp,
                count: CAPACITY * 2,
            }),
            resolved: buffer(
                "times",
                wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            ),
            staging: buffer(
                "times staging",
                wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            ),
            seconds_per_tick: f64::from(queue.get_timestamp_period()) * 1e-9,
            state: Mutex::default(),
        })
    }

    fn with<T>(&self, f: impl FnOnce(&mut State) -> T) -> T {
        f(&mut self.state.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Forgets all times: a frame begins.
    pub(super) fn reset(&self) {
        self.with(|state| *state = State::default());
    }

    /// The times of the frame so far, in the order in which the passes first ran.
    pub(super) fn times(&self) -> Vec<PassTime> {
        self.with(|state| state.sums.clone())
    }

    /// Where the next dispatch, one of `pass`, has to leave its times.
    pub(super) fn next(&self, pass: &'static str) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        let slot = self.with(|state| {
            let slot = state.open.len() as u32;
            (slot < CAPACITY).then(|| state.open.push(pass))?;
            Some(slot * 2)
        })?;
        Some(wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(slot),
            end_of_pass_write_index: Some(slot + 1),
        })
    }

    /// Ends the commands: the buffer to map, and how much of it, for [`Self::add`].
    pub(super) fn resolve(
        &self,
        encoder: &mut wgpu::CommandEncoder,
    ) -> Option<(&wgpu::Buffer, u64)> {
        let count = self.with(|state| state.open.len() as u32);
        if count == 0 {
            return None;
        }
        let bytes = u64::from(count) * 16;
        encoder.resolve_query_set(&self.queries, 0..count * 2, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.staging, 0, bytes);
        Some((&self.staging, bytes))
    }

    /// Adds what the device left in the buffer of [`Self::resolve`].
    pub(super) fn add(&self, bytes: &[u8]) {
        self.with(|state| {
            let times = bytes.as_chunks::<16>().0;
            for (pass, both) in state.open.drain(..).zip(times) {
                let [start, end]: [u64; 2] = bytemuck::pod_read_unaligned(both);
                let seconds = end.saturating_sub(start) as f64 * self.seconds_per_tick;
                match state.sums.iter_mut().find(|sum| sum.pass == pass) {
                    Some(sum) => {
                        sum.dispatches += 1;
                        sum.seconds += seconds;
                    }
                    None => state.sums.push(PassTime {
                        pass,
                        dispatches: 1,
                        seconds,
                    }),
                }
            }
        });
    }
}
