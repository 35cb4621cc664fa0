//! Capabilities and limits of a device, as plain data: choices based on them can be tested without a device.

use crate::shader::{KernelInfo, Requirement};
use ash::vk;
use std::collections::BTreeSet;

/// Kind of device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeviceKind {
    /// A processor running shaders, such as lavapipe.
    Cpu,
    /// A GPU that shares the processor's memory.
    Integrated,
    /// A GPU with memory of its own.
    Discrete,
    /// Virtual or unknown.
    Other,
}

/// Limits below the device's own, for tests of frames and training steps on a simulated smaller device. The default
/// lowers nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of one binding.
    pub binding: Option<u64>,
    /// Invocations of a workgroup.
    pub workgroup: Option<u32>,
    /// No kernel may use subgroup operations.
    pub without_subgroups: bool,
}

/// Capabilities and limits of a device.
#[derive(Clone, Debug)]
pub struct Caps {
    /// The device's name.
    pub name: String,
    /// The driver's name and version.
    pub driver: String,
    /// CPU, integrated or discrete GPU.
    pub kind: DeviceKind,
    /// Vulkan version as major, minor, patch.
    pub api: (u32, u32, u32),
    /// Invocations of a subgroup, unless a kernel requires another size.
    pub subgroup_size: u32,
    /// Smallest and largest subgroup size that a kernel may require.
    pub subgroup_range: (u32, u32),
    /// Largest range of a storage buffer binding, bytes.
    pub max_storage_range: u64,
    /// Largest single allocation, bytes.
    pub max_allocation: u64,
    /// Most storage buffers of one kernel.
    pub max_storage_buffers: u32,
    /// Largest width or height of an image, pixels.
    pub max_image_side: u32,
    /// Most workgroups per dimension.
    pub max_groups: [u32; 3],
    /// Most invocations of a workgroup.
    pub max_workgroup: u32,
    /// Push constants, bytes.
    pub max_push_constants: u32,
    /// Shared memory of a workgroup, bytes.
    pub max_shared: u32,
    /// Nanoseconds of one timestamp tick; 0 where timestamps are not supported.
    pub timestamp_period_ns: f64,
    /// Size of the largest device-local heap, bytes.
    pub heap: u64,
    /// Requirements of kernels that the device meets.
    pub offers: BTreeSet<Requirement>,
}

impl Caps {
    /// `Ok` if the kernel can run on the device, else the reason.
    pub fn supports(&self, kernel: &KernelInfo) -> Result<(), String> {
        match kernel.requirements.iter().find(|need| !self.offers.contains(need)) {
            Some(need) => Err(format!("{need:?}, which {} does not offer", self.name)),
            None => Ok(()),
        }
    }

    /// True if a tile can have this number of lanes: kernels with subgroup operations need all lanes of a tile in one
    /// subgroup.
    pub fn lanes_fit(&self, kernel: &KernelInfo, lanes: u32) -> bool {
        !kernel.uses_subgroups() || lanes <= self.subgroup_size
    }

    /// True if a workgroup of this size consists of full subgroups.
    pub fn fills_subgroups(&self, workgroup: u32) -> bool {
        workgroup.is_multiple_of(self.subgroup_size.max(1))
    }

    pub(super) fn query(instance: &ash::Instance, physical: vk::PhysicalDevice) -> Caps {
        let mut driver = vk::PhysicalDeviceDriverProperties::default();
        let mut subgroup = vk::PhysicalDeviceSubgroupProperties::default();
        let mut sizes = vk::PhysicalDeviceSubgroupSizeControlProperties::default();
        let mut v11 = vk::PhysicalDeviceMaintenance3Properties::default();
        let mut properties = vk::PhysicalDeviceProperties2::default()
            .push_next(&mut driver)
            .push_next(&mut subgroup)
            .push_next(&mut sizes)
            .push_next(&mut v11);
        // SAFETY: `physical` belongs to `instance`, and the chain holds structures of Vulkan 1.3.
        unsafe { instance.get_physical_device_properties2(physical, &mut properties) };
        let base = properties.properties;
        // SAFETY: as above.
        let memory = unsafe { instance.get_physical_device_memory_properties(physical) };
        let heap = memory.memory_heaps_as_slice().iter();
        let local = heap.filter(|heap| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL));
        let limits = &base.limits;
        let mut caps = Caps {
            name: text(base.device_name_as_c_str()),
            driver: format!(
                "{} {}",
                text(driver.driver_name_as_c_str()),
                text(driver.driver_info_as_c_str())
            ),
            kind: match base.device_type {
                vk::PhysicalDeviceType::CPU => DeviceKind::Cpu,
                vk::PhysicalDeviceType::INTEGRATED_GPU => DeviceKind::Integrated,
                vk::PhysicalDeviceType::DISCRETE_GPU => DeviceKind::Discrete,
                _ => DeviceKind::Other,
            },
            api: (
                vk::api_version_major(base.api_version),
                vk::api_version_minor(base.api_version),
                vk::api_version_patch(base.api_version),
            ),
            subgroup_size: subgroup.subgroup_size,
            subgroup_range: (sizes.min_subgroup_size, sizes.max_subgroup_size),
            max_storage_range: u64::from(limits.max_storage_buffer_range),
            max_allocation: v11.max_memory_allocation_size,
            max_storage_buffers: limits
                .max_per_stage_descriptor_storage_buffers
                .min(limits.max_descriptor_set_storage_buffers),
            max_image_side: limits.max_image_dimension2_d,
            max_groups: limits.max_compute_work_group_count,
            max_workgroup: limits
                .max_compute_work_group_invocations
                .min(limits.max_compute_work_group_size[0]),
            max_push_constants: limits.max_push_constants_size,
            max_shared: limits.max_compute_shared_memory_size,
            timestamp_period_ns: match limits.timestamp_compute_and_graphics {
                vk::TRUE => f64::from(limits.timestamp_period),
                _ => 0.0,
            },
            heap: local.map(|heap| heap.size).max().unwrap_or(0),
            offers: offers(instance, physical, &subgroup),
        };
        let stages = sizes.required_subgroup_size_stages;
        if !stages.contains(vk::ShaderStageFlags::COMPUTE) {
            caps.without_size_control();
        }
        caps
    }

    /// Bytes of the largest array that a kernel can bind.
    pub fn reach(&self) -> u64 {
        self.max_storage_range.min(self.max_allocation)
    }

    /// Reduces the capabilities to those without subgroup size control: a device with varying subgroup sizes loses the
    /// subgroup operations, since kernels that use them rely on a fixed size.
    pub(super) fn without_size_control(&mut self) {
        let (least, most) = self.subgroup_range;
        if least < most {
            self.offers.retain(|&need| !need.is_of_subgroups());
        }
        self.subgroup_range = (self.subgroup_size, self.subgroup_size);
    }

    /// Reduces the capabilities to `limits`.
    pub(super) fn lower(&mut self, limits: &Limits) {
        let binding = limits.binding.unwrap_or(u64::MAX);
        self.max_storage_range = self.max_storage_range.min(binding);
        let workgroup = limits.workgroup.unwrap_or(u32::MAX);
        self.max_workgroup = self.max_workgroup.min(workgroup);
        if limits.without_subgroups {
            self.offers.retain(|&need| !need.is_of_subgroups());
        }
    }
}

fn offers(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    subgroup: &vk::PhysicalDeviceSubgroupProperties<'_>,
) -> BTreeSet<Requirement> {
    let atomic_float_add = atomic_float_add(instance, physical);
    let is_compute = subgroup.supported_stages.contains(vk::ShaderStageFlags::COMPUTE);
    let in_compute = |flag| is_compute && subgroup.supported_operations.contains(flag);
    use vk::SubgroupFeatureFlags as Flags;
    [
        (Requirement::AtomicFloatAdd, atomic_float_add),
        (Requirement::SubgroupBasic, in_compute(Flags::BASIC)),
        (Requirement::SubgroupVote, in_compute(Flags::VOTE)),
        (Requirement::SubgroupArithmetic, in_compute(Flags::ARITHMETIC)),
        (Requirement::SubgroupBallot, in_compute(Flags::BALLOT)),
        (Requirement::SubgroupShuffle, in_compute(Flags::SHUFFLE)),
        (
            Requirement::SubgroupShuffleRelative,
            in_compute(Flags::SHUFFLE_RELATIVE),
        ),
    ]
    .into_iter()
    .filter_map(|(need, offered)| offered.then_some(need))
    .collect()
}

/// True if the device supports atomic addition of floats in storage buffers (VK_EXT_shader_atomic_float).
fn atomic_float_add(instance: &ash::Instance, physical: vk::PhysicalDevice) -> bool {
    // SAFETY: `physical` belongs to `instance`.
    let extensions = unsafe { instance.enumerate_device_extension_properties(physical) };
    let name = ash::ext::shader_atomic_float::NAME;
    let mut extensions = extensions.unwrap_or_default().into_iter();
    if !extensions.any(|extension| extension.extension_name_as_c_str() == Ok(name)) {
        return false;
    }
    let mut floats = vk::PhysicalDeviceShaderAtomicFloatFeaturesEXT::default();
    let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut floats);
    // SAFETY: as above; the device has the extension of the chained structure.
    unsafe { instance.get_physical_device_features2(physical, &mut features) };
    floats.shader_buffer_float32_atomic_add == vk::TRUE
}

fn text(name: Result<&std::ffi::CStr, std::ffi::FromBytesUntilNulError>) -> String {
    name.map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}
