//! Device features by the structures of a host's `pNext` chain.

use super::caps::Caps;
use super::requirements::Requirements;
use crate::{Error, Result};
use ash::vk;
use std::ffi::c_void;

/// Features and extensions that a host has enabled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HostFeatures {
    /// `scalarBlockLayout`, required.
    pub scalar_block_layout: bool,
    /// `timelineSemaphore`, required.
    pub timeline_semaphore: bool,
    /// `synchronization2`, required.
    pub synchronization2: bool,
    /// `subgroupSizeControl`; without it, devices with varying subgroup sizes run the kernel variants without subgroup
    /// operations.
    pub subgroup_size_control: bool,
    /// The device extension `VK_EXT_memory_budget`: allocations then stay within the budget of the largest device-local
    /// heap, which other users of the device share.
    pub memory_budget: bool,
    /// The instance extension `VK_EXT_debug_utils`: objects then have names, and each dispatch a label.
    pub debug_utils: bool,
}

/// A feature without a structure in a chain, and the structure to add for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MissingStruct {
    /// Name of the feature in the Vulkan specification.
    pub feature: &'static str,
    /// Type of the structure that has this feature alone, for chains without the one of its Vulkan version.
    pub structure: vk::StructureType,
}

const SCALAR: &str = "scalarBlockLayout";
const TIMELINE: &str = "timelineSemaphore";
const SYNCHRONIZATION: &str = "synchronization2";
const SIZE_CONTROL: &str = "subgroupSizeControl";

/// Structures of one feature each.
const STRUCTURES: [MissingStruct; 3] = [
    MissingStruct {
        feature: SCALAR,
        structure: vk::StructureType::PHYSICAL_DEVICE_SCALAR_BLOCK_LAYOUT_FEATURES,
    },
    MissingStruct {
        feature: TIMELINE,
        structure: vk::StructureType::PHYSICAL_DEVICE_TIMELINE_SEMAPHORE_FEATURES,
    },
    MissingStruct {
        feature: SYNCHRONIZATION,
        structure: vk::StructureType::PHYSICAL_DEVICE_SYNCHRONIZATION_2_FEATURES,
    },
];

/// Calls `found` with every feature of a chain that this crate knows, by name.
///
/// # Safety
/// Every structure of the chain is valid for writes and begins with type and next pointer.
unsafe fn each_feature(first: *mut c_void, mut found: impl FnMut(&'static str, &mut vk::Bool32)) {
    use vk::StructureType as Type;
    let mut next = first.cast::<vk::BaseOutStructure<'_>>();
    while !next.is_null() {
        // SAFETY: a structure of the chain, as the caller says.
        let (kind, after) = unsafe { ((*next).s_type, (*next).p_next) };
        match kind {
            Type::PHYSICAL_DEVICE_VULKAN_1_2_FEATURES => {
                // SAFETY: of this type by its tag.
                let all = unsafe { &mut *next.cast::<vk::PhysicalDeviceVulkan12Features<'_>>() };
                found(SCALAR, &mut all.scalar_block_layout);
                found(TIMELINE, &mut all.timeline_semaphore);
            }
            Type::PHYSICAL_DEVICE_VULKAN_1_3_FEATURES => {
                // SAFETY: of this type by its tag.
                let all = unsafe { &mut *next.cast::<vk::PhysicalDeviceVulkan13Features<'_>>() };
                found(SYNCHRONIZATION, &mut all.synchronization2);
                found(SIZE_CONTROL, &mut all.subgroup_size_control);
            }
            Type::PHYSICAL_DEVICE_SCALAR_BLOCK_LAYOUT_FEATURES => {
                // SAFETY: of this type by its tag.
                let one = unsafe { &mut *next.cast::<vk::PhysicalDeviceScalarBlockLayoutFeatures<'_>>() };
                found(SCALAR, &mut one.scalar_block_layout);
            }
            Type::PHYSICAL_DEVICE_TIMELINE_SEMAPHORE_FEATURES => {
                // SAFETY: of this type by its tag.
                let one = unsafe { &mut *next.cast::<vk::PhysicalDeviceTimelineSemaphoreFeatures<'_>>() };
                found(TIMELINE, &mut one.timeline_semaphore);
            }
            Type::PHYSICAL_DEVICE_SYNCHRONIZATION_2_FEATURES => {
                // SAFETY: of this type by its tag.
                let one = unsafe { &mut *next.cast::<vk::PhysicalDeviceSynchronization2Features<'_>>() };
                found(SYNCHRONIZATION, &mut one.synchronization2);
            }
            Type::PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_FEATURES => {
                // SAFETY: of this type by its tag.
                let one = unsafe { &mut *next.cast::<vk::PhysicalDeviceSubgroupSizeControlFeatures<'_>>() };
                found(SIZE_CONTROL, &mut one.subgroup_size_control);
            }
            _ => {}
        }
        next = after;
    }
}

impl HostFeatures {
    /// Features that a chain enables or, filled by a query, offers. Extensions are false.
    ///
    /// # Safety
    /// Every structure of the chain is valid and begins with type and next pointer.
    pub unsafe fn of_chain(chain: &vk::PhysicalDeviceFeatures2<'_>) -> HostFeatures {
        let mut features = HostFeatures::default();
        let see = |name: &str, value: &mut vk::Bool32| {
            let is_on = *value == vk::TRUE;
            match name {
                SCALAR => features.scalar_block_layout |= is_on,
                TIMELINE => features.timeline_semaphore |= is_on,
                SYNCHRONIZATION => features.synchronization2 |= is_on,
                _ => features.subgroup_size_control |= is_on,
            }
        };
        // SAFETY: as the caller says; nothing is written.
        unsafe { each_feature(chain.p_next, see) };
        features
    }

    /// Names of the required features that are off.
    pub(super) fn missing(&self) -> impl Iterator<Item = &'static str> + use<> {
        let required = [
            (SCALAR, self.scalar_block_layout),
            (TIMELINE, self.timeline_semaphore),
            (SYNCHRONIZATION, self.synchronization2),
        ];
        required
            .into_iter()
            .filter_map(|(name, is_on)| (!is_on).then_some(name))
    }
}

impl Requirements {
    /// Enables the required features in the structures that the chain has; no other value is changed. Returns the
    /// structures to add for the others. Subgroup size control is the host's choice.
    ///
    /// # Safety
    /// Every structure of the chain is valid for writes and begins with type and next pointer.
    pub unsafe fn enable(&self, chain: &mut vk::PhysicalDeviceFeatures2<'_>) -> Vec<MissingStruct> {
        let mut enabled = Vec::new();
        let enable = |name: &'static str, value: &mut vk::Bool32| {
            if self.features.contains(&name) {
                *value = vk::TRUE;
                enabled.push(name);
            }
        };
        // SAFETY: as the caller says.
        unsafe { each_feature(chain.p_next, enable) };
        let missing = STRUCTURES.into_iter();
        missing.filter(|s| !enabled.contains(&s.feature)).collect()
    }

    /// Version and limits that a device does not meet, one text each.
    pub fn unmet(&self, caps: &Caps) -> Vec<String> {
        let (major, minor) = self.api;
        let mut unmet = Vec::new();
        if caps.api < (major, minor, 0) {
            unmet.push(version(self, (caps.api.0, caps.api.1)));
        }
        let limits = [
            (
                "storage buffers of a kernel",
                caps.max_storage_buffers,
                self.storage_buffers,
            ),
            (
                "bytes of push constants",
                caps.max_push_constants,
                self.push_constant_bytes,
            ),
            ("bytes of shared memory", caps.max_shared, self.shared_bytes),
        ];
        for (name, found, wanted) in limits {
            if found < wanted {
                unmet.push(format!("{wanted} {name} ({found} offered)"));
            }
        }
        unmet
    }
}

/// Text of an unmet version.
pub(super) fn version(required: &Requirements, (major, minor): (u32, u32)) -> String {
    format!("Vulkan {}.{} ({major}.{minor} offered)", required.api.0, required.api.1)
}

/// Refusal of a device that lacks all of these.
pub(super) fn refuse_unmet(device: &str, unmet: &[String]) -> Result<()> {
    match unmet {
        [] => Ok(()),
        _ => Err(Error::Unsupported {
            what: format!("{device} lacks {}", unmet.join("; ")),
        }),
    }
}

/// Texts of missing features, for the same list as [`Requirements::unmet`].
pub(super) fn missing_texts(features: &HostFeatures) -> impl Iterator<Item = String> + use<> {
    features.missing().map(|name| format!("the feature {name}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::REQUIRED;

    #[test]
    fn features_are_enabled_in_the_chain_as_it_is() {
        let mut v12 = vk::PhysicalDeviceVulkan12Features::default().descriptor_indexing(true);
        let mut maintenance = vk::PhysicalDeviceMaintenance4Features::default();
        let mut chain = vk::PhysicalDeviceFeatures2::default()
            .push_next(&mut v12)
            .push_next(&mut maintenance);
        // SAFETY: the structures are alive.
        let (missing, found) = unsafe { (REQUIRED.enable(&mut chain), HostFeatures::of_chain(&chain)) };
        assert_eq!(missing, STRUCTURES[2..]);
        assert!(found.missing().eq(["synchronization2"]));
        assert_eq!((v12.scalar_block_layout, v12.timeline_semaphore), (vk::TRUE, vk::TRUE));
        assert_eq!(
            (v12.descriptor_indexing, maintenance.maintenance4),
            (vk::TRUE, vk::FALSE)
        );

        let mut scalar = vk::PhysicalDeviceScalarBlockLayoutFeatures::default();
        let mut timeline = vk::PhysicalDeviceTimelineSemaphoreFeatures::default();
        let mut synchronization = vk::PhysicalDeviceSynchronization2Features::default();
        let mut sizes = vk::PhysicalDeviceSubgroupSizeControlFeatures::default().subgroup_size_control(true);
        let mut chain = vk::PhysicalDeviceFeatures2::default()
            .push_next(&mut scalar)
            .push_next(&mut timeline)
            .push_next(&mut synchronization)
            .push_next(&mut sizes);
        // SAFETY: as above.
        let (missing, found) = unsafe { (REQUIRED.enable(&mut chain), HostFeatures::of_chain(&chain)) };
        assert_eq!(missing, []);
        assert_eq!(found.missing().count(), 0);
        assert!(found.subgroup_size_control);
        // SAFETY: as above.
        let none = unsafe { REQUIRED.enable(&mut vk::PhysicalDeviceFeatures2::default()) };
        assert_eq!(none, STRUCTURES);
        let names: Vec<&str> = STRUCTURES.iter().map(|s| s.feature).collect();
        assert_eq!(names, REQUIRED.features);
    }
}
