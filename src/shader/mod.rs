//! Reflection of compiled kernels: the facts that `build.rs` reads out of their SPIR-V.
//!
//! Shared by the build script, which writes tables of these, and by `gpu`, which turns one into a
//! pipeline. Knows neither Vulkan handles nor splats.

/// Access of a kernel to a binding, from `readonly` / `writeonly`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Only read.
    Read,
    /// Only written.
    Write,
    /// Read and written.
    ReadWrite,
}

/// Kind of a binding's resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BindingKind {
    /// A storage buffer.
    Buffer,
    /// A storage image without a declared format.
    StorageImage,
    /// An image that is read texel by texel, without a sampler.
    SampledImage,
}

/// One binding of descriptor set 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BindingInfo {
    /// `layout(binding = …)`; bindings are listed in ascending order.
    pub binding: u32,
    /// The name of the block's one member, e.g. `tile_from_isect`.
    pub name: &'static str,
    /// Kind of the resource.
    pub kind: BindingKind,
    /// Access of the kernel.
    pub access: Access,
}

/// A specialisation constant: a number that tunes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpecInfo {
    /// `layout(constant_id = …)`; listed in ascending order.
    pub id: u32,
    /// Lower-case name, e.g. `workgroup`.
    pub name: &'static str,
    /// The shader's own default.
    pub default: u32,
}

/// Something a device must offer for a kernel to run, from `OpCapability`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Requirement {
    /// `subgroupElect`, ids (in the Vulkan 1.3 baseline).
    SubgroupBasic,
    /// `subgroupAll`, `subgroupAny`.
    SubgroupVote,
    /// Reductions and scans.
    SubgroupArithmetic,
    /// `subgroupBallot` and friends.
    SubgroupBallot,
    /// `subgroupShuffle`, `subgroupShuffleXor`.
    SubgroupShuffle,
    /// `subgroupShuffleUp`, `subgroupShuffleDown`.
    SubgroupShuffleRelative,
    /// 64-bit integers.
    Int64,
    /// 16-bit floats in arithmetic.
    Float16,
    /// 16-bit types in storage buffers.
    Storage16,
    /// `atomicAdd` on floats in storage buffers.
    AtomicFloatAdd,
}

impl Requirement {
    /// Whether it is an operation among the invocations of a subgroup, whose number then matters.
    pub fn is_of_subgroups(self) -> bool {
        matches!(
            self,
            Requirement::SubgroupVote
                | Requirement::SubgroupArithmetic
                | Requirement::SubgroupBallot
                | Requirement::SubgroupShuffle
                | Requirement::SubgroupShuffleRelative
        )
    }
}

/// Static facts of one compiled variant of a kernel.
#[derive(Debug)]
pub struct KernelInfo {
    /// The part of the file name before the first dot: `rasterize`.
    pub kernel: &'static str,
    /// The part between the dots, empty for the base variant: `subgroup`.
    pub variant: &'static str,
    /// The module.
    pub spirv: &'static [u32],
    /// Set 0.
    pub bindings: &'static [BindingInfo],
    /// Bytes of push constants, 0 for none.
    pub params_size: u32,
    /// Tunables. The one named `workgroup` is the workgroup's size in x.
    pub specs: &'static [SpecInfo],
    /// Features that the device must offer.
    pub requirements: &'static [Requirement],
}

impl KernelInfo {
    /// Whether its invocations exchange values within a subgroup.
    pub fn uses_subgroups(&self) -> bool {
        let mut needs = self.requirements.iter();
        needs.any(|need| need.is_of_subgroups())
    }
}
