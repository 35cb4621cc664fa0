//! Features, extensions and limits required of a device; published for hosts.

/// Version, features, extensions and limits that the crate requires of a device; published for hosts.
#[derive(Clone, Copy, Debug)]
pub struct Requirements {
    /// Lowest Vulkan version, as major and minor.
    pub api: (u32, u32),
    /// Features that must be enabled, by their names in the Vulkan specification.
    pub features: &'static [&'static str],
    /// Features that are used if enabled.
    pub optional_features: &'static [&'static str],
    /// Required device extensions.
    pub extensions: &'static [&'static str],
    /// Bytes of push constants.
    pub push_constant_bytes: u32,
    /// Storage buffers of one kernel.
    pub storage_buffers: u32,
    /// Bytes of shared memory of a workgroup.
    pub shared_bytes: u32,
}

/// Requirements of this crate.
pub const REQUIRED: Requirements = Requirements {
    api: (1, 3),
    features: &["scalarBlockLayout", "timelineSemaphore", "synchronization2"],
    optional_features: &["subgroupSizeControl"],
    extensions: &[],
    push_constant_bytes: 128,
    storage_buffers: 14,
    shared_bytes: 16_384,
};
