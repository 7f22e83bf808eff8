//! GPU adapters of this machine.

use std::fmt;

/// A GPU, or a software renderer with the same interface.
#[derive(Clone)]
pub struct GpuAdapter {
    pub(super) adapter: wgpu::Adapter,
    info: wgpu::AdapterInfo,
}

/// Kind of an adapter, best first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum AdapterKind {
    /// A GPU with its own memory.
    Discrete,
    /// A GPU that shares the processor's memory.
    Integrated,
    /// A partition of a GPU, assigned to a virtual machine.
    Virtual,
    /// The driver does not report the kind.
    Other,
    /// A software renderer: lavapipe, WARP, SwiftShader. Many times slower than
    /// [`CpuRenderer`](super::super::CpuRenderer), and therefore only selected by name.
    Software,
}

impl fmt::Display for AdapterKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Discrete => "discrete",
            Self::Integrated => "integrated",
            Self::Virtual => "virtual",
            Self::Other => "other",
            Self::Software => "software",
        })
    }
}

impl GpuAdapter {
    /// All adapters of this machine: discrete GPUs first, software last.
    pub fn all() -> Vec<Self> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let found = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY));
        let mut adapters: Vec<Self> = found
            .into_iter()
            .map(|adapter| Self {
                info: adapter.get_info(),
                adapter,
            })
            .collect();
        adapters.sort_by_key(Self::kind);
        adapters
    }

    /// The first hardware adapter. Software adapters must be selected by name, because the CPU backend is many times
    /// faster.
    pub fn best() -> Option<Self> {
        Self::all().into_iter().find(|a| !a.is_software())
    }

    /// The first adapter whose description (its `Display`) contains `text`, case-insensitive.
    pub fn find(text: &str) -> Option<Self> {
        let text = text.to_lowercase();
        let fits = |a: &Self| a.to_string().to_lowercase().contains(&text);
        Self::all().into_iter().find(fits)
    }

    /// Name reported by the driver: `NVIDIA H200`, `llvmpipe (LLVM 15.0.6, 256 bits)`.
    pub fn name(&self) -> &str {
        &self.info.name
    }

    pub fn kind(&self) -> AdapterKind {
        match self.info.device_type {
            wgpu::DeviceType::DiscreteGpu => AdapterKind::Discrete,
            wgpu::DeviceType::IntegratedGpu => AdapterKind::Integrated,
            wgpu::DeviceType::VirtualGpu => AdapterKind::Virtual,
            wgpu::DeviceType::Other => AdapterKind::Other,
            wgpu::DeviceType::Cpu => AdapterKind::Software,
        }
    }

    /// Name and version of the driver as reported; empty if not reported.
    pub fn driver(&self) -> String {
        let text = format!("{} {}", self.info.driver, self.info.driver_info);
        text.trim().to_owned()
    }

    /// Graphics API of the adapter: `vulkan`, `metal` or `dx12`.
    pub fn interface(&self) -> &'static str {
        self.info.backend.to_str()
    }

    /// True for lavapipe, WARP, SwiftShader and the like.
    pub fn is_software(&self) -> bool {
        self.kind() == AdapterKind::Software
    }
}

/// Name, API and driver, in the form used in records.
impl fmt::Display for GpuAdapter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}", self.name(), self.interface())?;
        let driver = self.driver();
        if !driver.is_empty() {
            write!(f, ", {driver}")?;
        }
        f.write_str(")")?;
        if self.is_software() {
            f.write_str(" [software]")?;
        }
        Ok(())
    }
}

impl fmt::Debug for GpuAdapter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "GpuAdapter({self})")
    }
}
