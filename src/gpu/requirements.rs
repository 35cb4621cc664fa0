//! Features, extensions and limits that a device must have; published for hosts.

/// What a device must have enabled for this crate to run on it; published for hosts.
#[derive(Clone, Copy, Debug)]
pub struct Requirements {
    /// Lowest Vulkan version, as major and minor.
    pub api: (u32, u32),
    /// Features that must be enabled, by their names in the Vulkan specification.
    pub features: &'static [&'static str],
    /// Features that are used where enabled: presenting to a host's image needs the first.
    pub optional_features: &'static [&'static str],
    /// Device extensions.
    pub extensions: &'static [&'static str],
    /// Bytes of push constants.
    pub push_constant_bytes: u32,
    /// Storage buffers one kernel binds.
    pub storage_buffers: u32,
    /// Bytes of shared memory.
    pub shared_bytes: u32,
}

/// What this crate asks of a device.
pub const REQUIRED: Requirements = Requirements {
    api: (1, 3),
    features: &[
        "scalarBlockLayout",
        "timelineSemaphore",
        "synchronization2",
        "maintenance4",
    ],
    optional_features: &[
        "shaderStorageImageWriteWithoutFormat",
        "subgroupSizeControl",
    ],
    extensions: &[],
    push_constant_bytes: 128,
    storage_buffers: 14,
    shared_bytes: 16_384,
};
