//! The adapters of this machine.

use std::fmt;

/// A GPU, or a program that pretends to be one.
#[derive(Clone)]
pub struct GpuAdapter {
    pub(super) adapter: wgpu::Adapter,
}

impl GpuAdapter {
    /// All adapters of this machine: discrete ones first, software last.
    pub fn all() -> Vec<Self> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let found = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY));
        let mut adapters: Vec<Self> = found.into_iter().map(|adapter| Self { adapter }).collect();
        adapters.sort_by_key(|a| match a.adapter.get_info().device_type {
            wgpu::DeviceType::DiscreteGpu => 0,
            wgpu::DeviceType::IntegratedGpu => 1,
            wgpu::DeviceType::VirtualGpu => 2,
            wgpu::DeviceType::Other => 3,
            wgpu::DeviceType::Cpu => 4,
        });
        adapters
    }

    /// The first adapter that is real hardware. A software adapter has to be asked for: the CPU
    /// backend is many times faster.
    pub fn best() -> Option<Self> {
        Self::all().into_iter().find(|a| !a.is_software())
    }

    /// True for lavapipe, WARP, SwiftShader and their kind.
    pub fn is_software(&self) -> bool {
        self.adapter.get_info().device_type == wgpu::DeviceType::Cpu
    }
}

/// Name, driver and interface, as records keep them.
impl fmt::Display for GpuAdapter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let info = self.adapter.get_info();
        write!(
            f,
            "{} ({:?}, {} {})",
            info.name, info.backend, info.driver, info.driver_info
        )?;
        if self.is_software() {
            f.write_str(" [software]")?;
        }
        Ok(())
    }
}
