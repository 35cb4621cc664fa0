//! Options of a device's creation.

use super::caps::Limits;
use super::faults::Faults;

/// How to create a device.
#[derive(Clone, Debug, Default)]
pub struct GpuOptions {
    /// Index in the list of [`devices`], or part of a name; `None`: a discrete GPU, else an integrated
    /// one, else whatever there is.
    pub device: Option<String>,
    /// Turns on the validation layer with synchronisation validation, and fills fresh buffers with NaNs.
    pub validation: bool,
    /// Most bytes of buffers; `None`: what the device has.
    pub memory_limit: Option<u64>,
    /// Failures to be had on purpose, in tests.
    pub faults: Option<Faults>,
    /// Where to stay below what the device can do.
    pub limits: Limits,
}
