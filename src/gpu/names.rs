//! Names of objects and labels of dispatches in debuggers (VK_EXT_debug_utils).

use ash::ext::debug_utils;
use ash::vk;
use std::ffi::{CStr, CString};

/// The extension's functions, if the instance has it enabled.
pub(super) struct Names(Option<debug_utils::Device>);

impl Names {
    pub(super) fn new(instance: &ash::Instance, device: &ash::Device, is_enabled: bool) -> Names {
        Names(is_enabled.then(|| debug_utils::Device::new(instance, device)))
    }

    /// Names an object.
    pub(super) fn name<T: vk::Handle>(&self, object: T, name: &str) {
        let Some(utils) = &self.0 else { return };
        // Names come from this crate, and have no zero in them.
        let Ok(name) = CString::new(format!("ashfall {name}")) else {
            return;
        };
        let info = vk::DebugUtilsObjectNameInfoEXT::default()
            .object_handle(object)
            .object_name(&name);
        // SAFETY: the object is alive and new, so that no other thread uses it. A name that does not take is no loss.
        let _ = unsafe { utils.set_debug_utils_object_name(&info) };
    }

    /// Begins a labelled region.
    pub(super) fn begin(&self, commands: vk::CommandBuffer, label: &CStr) {
        if let Some(utils) = &self.0 {
            let label = vk::DebugUtilsLabelEXT::default().label_name(label);
            // SAFETY: the commands are being recorded.
            unsafe { utils.cmd_begin_debug_utils_label(commands, &label) };
        }
    }

    /// Ends the region.
    pub(super) fn end(&self, commands: vk::CommandBuffer) {
        if let Some(utils) = &self.0 {
            // SAFETY: the commands are being recorded, and a region was begun in them.
            unsafe { utils.cmd_end_debug_utils_label(commands) };
        }
    }
}
