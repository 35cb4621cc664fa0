//! Compute pipeline of a kernel with one set of specialisation constants.

use super::check::check;
use super::compiled::CompiledKernel;
use super::device::Gpu;
use crate::shader::{BindingKind, KernelInfo};
use crate::{Error, Result};
use ash::vk;
use rayon::prelude::*;
use std::collections::hash_map::Entry;
use std::ffi::{CStr, CString};
use std::sync::Arc;

pub(super) struct RawPipeline {
    /// Keeps `kernel`.
    _gpu: Gpu,
    pub(super) info: &'static KernelInfo,
    pub(super) kernel: CompiledKernel,
    /// Name of kernel and variant.
    pub(super) label: CString,
}

/// Compute pipeline of a kernel. The device compiles it once for each set of specialisation constants and keeps all of
/// them until it is dropped.
#[derive(Clone)]
pub struct Pipeline(pub(super) Arc<RawPipeline>);

impl std::fmt::Debug for Pipeline {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Pipeline({}.{})", self.0.info.kernel, self.0.info.variant)
    }
}

impl Pipeline {
    /// Compiles `info` with the specialisation constants `spec`, in the order of `info.specs`.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if the device does not meet a requirement of the kernel.
    pub fn new(gpu: &Gpu, info: &'static KernelInfo, spec: &[u32]) -> Result<Pipeline> {
        assert_eq!(
            spec.len(),
            info.specs.len(),
            "{}: one value per specialisation constant",
            info.kernel
        );
        let refuse = |why| Error::Unsupported {
            what: format!("kernel {} {} needs {why}", info.kernel, info.variant),
        };
        gpu.caps().supports(info).map_err(refuse)?;
        let workgroup = info.specs.iter().position(|s| s.name == "workgroup");
        let (invocations, most) = (workgroup.map_or(1, |i| spec[i]), gpu.caps().max_workgroup);
        if invocations > most {
            return Err(refuse(format!(
                "workgroups of {invocations}; this device has them up to {most}"
            )));
        }
        let label = label(info);
        let key = (info.spirv.as_ptr() as usize, spec.to_vec());
        let known = gpu.0.kernels().get(&key).copied();
        let kernel = match known {
            Some(kernel) => kernel,
            None => keep(gpu, key, compile(gpu, info, spec, &label)?),
        };
        Ok(Pipeline(Arc::new(RawPipeline {
            _gpu: gpu.clone(),
            info,
            kernel,
            label,
        })))
    }
}

/// Drivers compile kernels of several threads beside each other. A host's device is called by the caller's thread
/// alone.
impl Gpu {
    /// Kernels by `compile` of all `choices`, in their order; by several threads on an owned device.
    pub(crate) fn compile_all<C: Copy + Sync, K: Send>(
        &self,
        choices: &[C],
        compile: impl Fn(C) -> Result<K> + Sync,
    ) -> Result<Vec<K>> {
        match self.is_owned() {
            true => choices.par_iter().map(|&choice| compile(choice)).collect(),
            false => choices.iter().map(|&choice| compile(choice)).collect(),
        }
    }

    /// Kernels by both functions; by two threads on an owned device.
    #[cfg(feature = "train")]
    pub(crate) fn compile_both<A: Send, B: Send>(
        &self,
        first: impl FnOnce() -> Result<A> + Send,
        second: impl FnOnce() -> Result<B> + Send,
    ) -> Result<(A, B)> {
        let (first, second) = match self.is_owned() {
            true => rayon::join(first, second),
            false => (first(), second()),
        };
        Ok((first?, second?))
    }
}

/// Gives a kernel to the device, which may have got it from another thread meanwhile.
fn keep(gpu: &Gpu, key: (usize, Vec<u32>), kernel: CompiledKernel) -> CompiledKernel {
    match gpu.0.kernels().entry(key) {
        Entry::Vacant(entry) => *entry.insert(kernel),
        Entry::Occupied(entry) => {
            // SAFETY: it was made here and never used.
            unsafe { kernel.destroy(&gpu.0.device) };
            *entry.get()
        }
    }
}

fn compile(gpu: &Gpu, info: &'static KernelInfo, spec: &[u32], label: &CStr) -> Result<CompiledKernel> {
    let kernel = CompiledKernel::default();
    let mut compilation = Compilation { gpu, info, kernel };
    let made = compilation.create_layouts();
    let made = made.and_then(|()| compilation.create_pipeline(spec, label));
    if made.is_err() {
        // SAFETY: the objects were made here and never used.
        unsafe { compilation.kernel.destroy(&gpu.0.device) };
    }
    made.map(|()| compilation.kernel)
}

struct Compilation<'a> {
    gpu: &'a Gpu,
    info: &'static KernelInfo,
    kernel: CompiledKernel,
}

impl Compilation<'_> {
    fn create_layouts(&mut self) -> Result<()> {
        let device = &self.gpu.0.device;
        let bindings: Vec<_> = self
            .info
            .bindings
            .iter()
            .map(|binding| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(binding.binding)
                    .descriptor_type(descriptor_type(binding.kind))
                    .descriptor_count(1)
                    .stage_flags(vk::ShaderStageFlags::COMPUTE)
            })
            .collect();
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        self.gpu.0.creating("vkCreateDescriptorSetLayout")?;
        // SAFETY: the bindings come from the module's reflection.
        let layout = unsafe { device.create_descriptor_set_layout(&info, None) };
        self.kernel.set_layout = check("vkCreateDescriptorSetLayout", layout)?;
        let sets = [self.kernel.set_layout];
        let ranges = [vk::PushConstantRange::default()
            .stage_flags(vk::ShaderStageFlags::COMPUTE)
            .size(self.info.params_size)];
        let mut info = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets);
        if self.info.params_size > 0 {
            info = info.push_constant_ranges(&ranges);
        }
        self.gpu.0.creating("vkCreatePipelineLayout")?;
        // SAFETY: the set layout was just made; the range is within the guaranteed 128 bytes.
        self.kernel.layout = check("vkCreatePipelineLayout", unsafe {
            device.create_pipeline_layout(&info, None)
        })?;
        Ok(())
    }

    fn create_pipeline(&mut self, spec: &[u32], label: &CStr) -> Result<()> {
        let device = &self.gpu.0.device;
        let entries: Vec<_> = self
            .info
            .specs
            .iter()
            .enumerate()
            .map(|(i, spec)| {
                vk::SpecializationMapEntry::default()
                    .constant_id(spec.id)
                    .offset(4 * i as u32)
                    .size(4)
            })
            .collect();
        let specialization = vk::SpecializationInfo::default()
            .map_entries(&entries)
            .data(bytemuck::cast_slice(spec));
        self.gpu.0.creating("vkCreateShaderModule")?;
        let module_info = vk::ShaderModuleCreateInfo::default().code(self.info.spirv);
        // SAFETY: the words were validated when the crate was built.
        let module = check("vkCreateShaderModule", unsafe {
            device.create_shader_module(&module_info, None)
        })?;
        // On devices with varying subgroup sizes, kernels with subgroup operations require the size in `Caps`.
        let caps = self.gpu.caps();
        let mut size =
            vk::PipelineShaderStageRequiredSubgroupSizeCreateInfo::default().required_subgroup_size(caps.subgroup_size);
        let mut stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(c"main")
            .specialization_info(&specialization);
        if self.info.uses_subgroups() && caps.subgroup_range.0 < caps.subgroup_range.1 {
            stage = stage.push_next(&mut size);
        }
        let info = vk::ComputePipelineCreateInfo::default()
            .stage(stage)
            .layout(self.kernel.layout);
        let call = "vkCreateComputePipelines";
        let made = self.gpu.0.creating(call).and_then(|()| {
            let cache = self.gpu.0.pipeline_cache;
            // SAFETY: every object that `info` refers to is alive.
            let made = unsafe { device.create_compute_pipelines(cache, &[info], None) };
            check(call, made.map_err(|(_, code)| code))
        });
        // SAFETY: a pipeline does not need its module once made.
        unsafe { device.destroy_shader_module(module, None) };
        self.kernel.pipeline = made?[0];
        let name = label.to_string_lossy();
        self.gpu.0.names.name(self.kernel.pipeline, &name);
        Ok(())
    }
}

/// `kernel` or `kernel.variant`.
fn label(info: &KernelInfo) -> CString {
    let name = match info.variant {
        "" => info.kernel.to_owned(),
        variant => format!("{}.{variant}", info.kernel),
    };
    // File names have no zero in them.
    CString::new(name).unwrap_or_default()
}

pub(super) fn descriptor_type(kind: BindingKind) -> vk::DescriptorType {
    match kind {
        BindingKind::Buffer => vk::DescriptorType::STORAGE_BUFFER,
        BindingKind::StorageImage => vk::DescriptorType::STORAGE_IMAGE,
        BindingKind::SampledImage => vk::DescriptorType::SAMPLED_IMAGE,
    }
}
