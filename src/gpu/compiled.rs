//! Compiled kernels of a device.

use ash::vk;
use std::collections::HashMap;

/// Vulkan objects of a compiled kernel. The device keeps them: compilation can take longer than a frame, and renderers
/// of one program share most kernels.
#[derive(Clone, Copy, Default)]
pub(super) struct CompiledKernel {
    pub(super) set_layout: vk::DescriptorSetLayout,
    pub(super) layout: vk::PipelineLayout,
    pub(super) pipeline: vk::Pipeline,
}

/// Kernels by module and specialisation constants.
pub(super) type CompiledKernels = HashMap<(usize, Vec<u32>), CompiledKernel>;

impl CompiledKernel {
    /// Destroys the objects there are.
    ///
    /// # Safety
    /// They are of this device; no frame uses them, and nobody will.
    pub(super) unsafe fn destroy(self, device: &ash::Device) {
        // SAFETY: by the caller; null handles are ignored.
        unsafe {
            device.destroy_pipeline(self.pipeline, None);
            device.destroy_pipeline_layout(self.layout, None);
            device.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}
