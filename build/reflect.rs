//! Reflection of SPIR-V: a kernel's interface, tunables and device requirements.
//!
//! Declarations without a Rust counterpart are refused, with their file and line.

use super::model::{Binding, Bound, Module, Spec, Struct, Type};
use super::shader::{Access, Requirement};
use super::source::{At, Sources};
use super::spirv::{Globals, Index, bits};
use super::types::{check_stride, rust_name, structure, type_of};
use rspirv::dr::{Instruction, Operand};
use rspirv::spirv::{Capability, Decoration, Dim, ImageFormat, Op, StorageClass};

/// Reflects an unoptimised module; the errors carry their place.
pub(crate) fn reflect(words: &[u32], sources: &Sources) -> Result<Module, Vec<String>> {
    let globals = Globals::parse(words).map_err(|error| vec![sources.fault(At::Kernel, error)])?;
    let index = Index::new(&globals);
    let mut faults = Vec::new();
    let mut found = Module {
        bindings: Vec::new(),
        params: None,
        specs: Vec::new(),
        requirements: Vec::new(),
    };
    for line in globals.lines() {
        let id = line.result_id.unwrap_or_default();
        match line.class.opcode {
            Op::Capability => match requirement(line) {
                Ok(needed) => found.requirements.extend(needed),
                Err(what) => faults.push(sources.fault(At::Kernel, what)),
            },
            Op::ExecutionModeId => faults.push(sources.fault(At::Kernel, LOCAL_SIZE_ID)),
            Op::Variable => match variable(&index, line, id) {
                Ok(Some(Global::Binding(binding))) => found.bindings.push(binding),
                Ok(Some(Global::Params(params))) => found.params = Some(params),
                Ok(None) => {}
                Err((at, what)) => faults.push(sources.fault(at, what)),
            },
            Op::SpecConstant | Op::SpecConstantTrue | Op::SpecConstantFalse => match spec_constant(&index, line, id) {
                Ok(spec) => found.specs.extend(spec),
                Err((at, what)) => faults.push(sources.fault(at, what)),
            },
            _ => {}
        }
    }
    found.requirements.sort();
    found.requirements.dedup();
    // Views follow the bindings that they view.
    found
        .bindings
        .sort_by_key(|binding| (binding.binding, binding.name.len()));
    found.specs.sort_by_key(|spec| spec.id);
    found.bindings.dedup_by(|second, first| is_view(second, first));
    for pair in found.bindings.windows(2) {
        if let [first, second] = pair
            && first.binding == second.binding
        {
            let what = format!("`{}` and `{}` share a binding", first.name, second.name);
            faults.push(sources.fault(At::Binding(first.binding), what));
        }
    }
    if faults.is_empty() { Ok(found) } else { Err(faults) }
}

/// Refusal of a workgroup size by id, which some compilers write for constants even in SPIR-V 1.5.
const LOCAL_SIZE_ID: &str = "OpExecutionModeId, for which a device needs the feature maintenance4";

/// True if a binding is a view of another one as vectors of four, for access to four numbers at a time. The host binds
/// the numbers. The access of both must be read-only or write-only, so that a read through one view never needs a write
/// through the other.
fn is_view(binding: &Binding, of: &Binding) -> bool {
    let fours = |scalar| Bound::Buffer(Type::Vector(scalar, 4));
    binding.binding == of.binding
        && binding.name == format!("{}_by_four", of.name)
        && binding.access == of.access
        && of.access != Access::ReadWrite
        && matches!(of.bound, Bound::Buffer(Type::Scalar(scalar)) if binding.bound == fours(scalar))
}

/// Device requirement of a capability; `None` if every Vulkan device has it.
fn requirement(line: &Instruction) -> Result<Option<Requirement>, String> {
    let Some(Operand::Capability(capability)) = line.operands.first() else {
        return Err("OpCapability without a capability".to_owned());
    };
    Ok(Some(match capability {
        Capability::Shader | Capability::Matrix | Capability::ImageQuery => return Ok(None),
        // Vulkan 1.3 permits it to every shader; the format of the bound image decides.
        Capability::StorageImageWriteWithoutFormat => return Ok(None),
        Capability::GroupNonUniform => Requirement::SubgroupBasic,
        Capability::GroupNonUniformVote => Requirement::SubgroupVote,
        Capability::GroupNonUniformArithmetic => Requirement::SubgroupArithmetic,
        Capability::GroupNonUniformBallot => Requirement::SubgroupBallot,
        Capability::GroupNonUniformShuffle => Requirement::SubgroupShuffle,
        Capability::GroupNonUniformShuffleRelative => Requirement::SubgroupShuffleRelative,
        Capability::Int64 => Requirement::Int64,
        Capability::Float16 => Requirement::Float16,
        Capability::StorageBuffer16BitAccess => Requirement::Storage16,
        Capability::AtomicFloat32AddEXT => Requirement::AtomicFloatAdd,
        other => {
            return Err(format!(
                "needs the SPIR-V capability {other:?}, which no `shader::Requirement` stands for yet"
            ));
        }
    }))
}

/// A fault and its place.
type Fault = (At<'static>, String);

enum Global {
    Binding(Binding),
    Params(Struct),
}

fn variable(index: &Index<'_>, line: &Instruction, id: u32) -> Result<Option<Global>, Fault> {
    let Some(Operand::StorageClass(class)) = line.operands.first() else {
        return Ok(None);
    };
    let pointer = line.result_type.unwrap_or_default();
    let pointee = || -> Result<u32, String> {
        let operands = &index.definition(pointer)?.operands;
        Ok(operands.get(1).map(bits).unwrap_or_default())
    };
    match class {
        StorageClass::PushConstant => pointee()
            .and_then(|block| structure(index, block))
            .map(|block| Some(Global::Params(block)))
            .map_err(|what| (At::Push, what)),
        StorageClass::StorageBuffer | StorageClass::UniformConstant | StorageClass::Uniform => {
            let number = index.value(id, None, Decoration::Binding);
            let number = number.ok_or_else(|| {
                let what = format!("`{}` has no layout(binding = …)", index.name(id));
                (At::Kernel, what)
            })?;
            let place = |what| (At::Binding(number), what);
            if index.value(id, None, Decoration::DescriptorSet) != Some(0) {
                return Err(place("only descriptor set 0 is used".to_owned()));
            }
            let pointee = pointee().map_err(place)?;
            let binding = match class {
                StorageClass::StorageBuffer => buffer(index, pointee, number),
                StorageClass::UniformConstant => image(index, pointee, id, number),
                _ => Err("uniform blocks are not used: push constants or a buffer are".to_owned()),
            };
            binding.map(|b| Some(Global::Binding(b))).map_err(place)
        }
        _ => Ok(None),
    }
}

fn buffer(index: &Index<'_>, block: u32, number: u32) -> Result<Binding, String> {
    let [member] = index.definition(block)?.operands.as_slice() else {
        return Err(format!(
            "block `{}` must have exactly one member: it names the binding",
            index.name(block)
        ));
    };
    let content = index.definition(bits(member))?;
    let element = match (content.class.opcode, content.operands.first()) {
        (Op::TypeRuntimeArray, Some(element)) => {
            let ty = type_of(index, bits(element))?;
            check_stride(index, bits(member), &ty)?;
            ty
        }
        _ => type_of(index, bits(member))?,
    };
    if index.is(block, Some(0), Decoration::RowMajor) {
        return Err("row_major matrices have no Rust type here".to_owned());
    }
    let no = |what| index.is(block, Some(0), what);
    Ok(Binding {
        binding: number,
        name: rust_name(index.member_name(block, 0))?,
        block: index.name(block).to_owned(),
        access: access(no(Decoration::NonWritable), no(Decoration::NonReadable))?,
        bound: Bound::Buffer(element),
    })
}

fn image(index: &Index<'_>, ty: u32, id: u32, number: u32) -> Result<Binding, String> {
    let line = index.definition(ty)?;
    let sort = (line.class.opcode, line.operands.as_slice());
    let (Op::TypeImage, [_, Operand::Dim(dim), _, arrayed, samples, sampled, format, ..]) = sort else {
        return Err("only storage buffers and storage images are bound".to_owned());
    };
    let flat = *dim == Dim::Dim2D && bits(arrayed) == 0 && bits(samples) == 0;
    let is_sampled = bits(sampled) == 1;
    if !flat || bits(sampled) == 0 || *format != Operand::ImageFormat(ImageFormat::Unknown) {
        return Err("images are `writeonly uniform image2D` without a format, or `uniform texture2D`".to_owned());
    }
    let no = |what| index.is(id, None, what);
    Ok(Binding {
        binding: number,
        name: rust_name(index.name(id))?,
        block: index.name(id).to_owned(),
        access: access(is_sampled || no(Decoration::NonWritable), no(Decoration::NonReadable))?,
        bound: if is_sampled { Bound::SampledImage } else { Bound::Image },
    })
}

fn access(readonly: bool, writeonly: bool) -> Result<Access, String> {
    match (readonly, writeonly) {
        (true, false) => Ok(Access::Read),
        (false, true) => Ok(Access::Write),
        (false, false) => Ok(Access::ReadWrite),
        (true, true) => Err("a binding that is neither read nor written".to_owned()),
    }
}

fn spec_constant(index: &Index<'_>, line: &Instruction, id: u32) -> Result<Option<Spec>, Fault> {
    // The workgroup size is a second, nameless constant of the same id.
    let (Some(number), name) = (index.value(id, None, Decoration::SpecId), index.name(id).to_owned()) else {
        return Ok(None);
    };
    if name.is_empty() {
        return Ok(None);
    }
    let place = |what| (At::Spec(number), what);
    let ty = type_of(index, line.result_type.unwrap_or_default());
    let (Ok(Type::Scalar(scalar)), Some(default)) = (ty, line.operands.first().map(bits)) else {
        let what = format!("`{name}` must be a uint, an int or a float");
        return Err(place(what));
    };
    if name != name.to_uppercase() {
        return Err(place(format!("`{name}` is a constant: IN_CAPITALS")));
    }
    Ok(Some(Spec {
        id: number,
        name: rust_name(&name.to_lowercase()).map_err(place)?,
        scalar,
        default,
    }))
}
