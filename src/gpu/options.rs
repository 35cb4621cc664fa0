//! Options for the creation of a device.

use super::caps::Limits;
use super::faults::Faults;

/// Options of [`Gpu::create`](super::Gpu::create).
#[derive(Clone, Debug, Default)]
pub struct GpuOptions {
    /// Index in the list of [`devices`](super::devices), or part of a name; `None`: a discrete GPU, else an integrated
    /// one, else any device.
    pub device: Option<String>,
    /// Enables the validation layer with synchronisation validation, and fills new buffers and images with NaNs.
    pub validation: bool,
    /// Limit of buffer and image memory in bytes; `None`: the device's largest heap.
    pub memory_limit: Option<u64>,
    /// Compiled pipelines of an earlier run, from [`Gpu::pipeline_cache`](super::Gpu::pipeline_cache). The driver
    /// ignores those of another driver or device; it trusts the bytes otherwise, so that the file must be the program's
    /// own.
    pub pipeline_cache: Vec<u8>,
    /// Fault injection for tests.
    pub faults: Option<Faults>,
    /// Limits below the device's own.
    pub limits: Limits,
}
