//! Reads out of SPIR-V what a kernel declares: its interface, its tunables, what it needs of a device.
//!
//! Refuses what the host has no words for, with the file and line of the declaration at fault.

use super::model::{Binding, Bound, Member, Module, Scalar, Spec, Struct, Type};
use super::shader::{Access, Requirement};
use super::source::{At, Sources};
use super::spirv::{Globals, Index, bits};
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
            Op::Variable => match variable(&index, line, id) {
                Ok(Some(Global::Binding(binding))) => found.bindings.push(binding),
                Ok(Some(Global::Params(params))) => found.params = Some(params),
                Ok(None) => {}
                Err((at, what)) => faults.push(sources.fault(at, what)),
            },
            Op::SpecConstant | Op::SpecConstantTrue | Op::SpecConstantFalse => {
                match spec_constant(&index, line, id) {
                    Ok(spec) => found.specs.extend(spec),
                    Err((at, what)) => faults.push(sources.fault(at, what)),
                }
            }
            _ => {}
        }
    }
    found.requirements.sort();
    found.requirements.dedup();
    found.bindings.sort_by_key(|binding| binding.binding);
    found.specs.sort_by_key(|spec| spec.id);
    for pair in found.bindings.windows(2) {
        if let [first, second] = pair
            && first.binding == second.binding
        {
            let what = format!("`{}` and `{}` share a binding", first.name, second.name);
            faults.push(sources.fault(At::Binding(first.binding), what));
        }
    }
    if faults.is_empty() {
        Ok(found)
    } else {
        Err(faults)
    }
}

/// What a capability asks of a device; nothing for the ones that every Vulkan device has.
fn requirement(line: &Instruction) -> Result<Option<Requirement>, String> {
    let Some(Operand::Capability(capability)) = line.operands.first() else {
        return Err("OpCapability without a capability".to_owned());
    };
    Ok(Some(match capability {
        Capability::Shader | Capability::Matrix | Capability::ImageQuery => return Ok(None),
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
        Capability::StorageImageWriteWithoutFormat => Requirement::StorageImageWriteWithoutFormat,
        other => {
            return Err(format!(
                "needs the SPIR-V capability {other:?}, which no `shader::Requirement` stands for yet"
            ));
        }
    }))
}

/// A fault and where it is.
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
    let (
        Op::TypeImage,
        [
            _,
            Operand::Dim(dim),
            _,
            arrayed,
            samples,
            sampled,
            format,
            ..,
        ],
    ) = sort
    else {
        return Err("only storage buffers and storage images are bound".to_owned());
    };
    let flat = *dim == Dim::Dim2D && bits(arrayed) == 0 && bits(samples) == 0;
    if !flat || bits(sampled) != 2 || *format != Operand::ImageFormat(ImageFormat::Unknown) {
        return Err("images are `writeonly uniform image2D` without a format".to_owned());
    }
    let no = |what| index.is(id, None, what);
    Ok(Binding {
        binding: number,
        name: rust_name(index.name(id))?,
        block: index.name(id).to_owned(),
        access: access(no(Decoration::NonWritable), no(Decoration::NonReadable))?,
        bound: Bound::Image,
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

fn structure(index: &Index<'_>, id: u32) -> Result<Struct, String> {
    let name = index.name(id).to_owned();
    let mut members = Vec::new();
    let mut end = 0;
    for (number, operand) in (0u32..).zip(&index.definition(id)?.operands) {
        let member_name = rust_name(index.member_name(id, number))?;
        let ty = type_of(index, bits(operand))?;
        let offset = index.value(id, Some(number), Decoration::Offset);
        if index.is(id, Some(number), Decoration::RowMajor) {
            return Err(format!("`{name}.{member_name}` is row_major"));
        }
        let stride = index.value(id, Some(number), Decoration::MatrixStride);
        let unpadded = match ty {
            Type::Matrix { rows, .. } => stride == Some(4 * rows),
            _ => true,
        };
        if offset != Some(end) || !unpadded {
            return Err(format!(
                "`{name}.{member_name}` is padded: declare its block with layout(…, scalar)"
            ));
        }
        let size = ty.size();
        members.push(Member {
            name: member_name,
            offset: end,
            ty,
        });
        end += size;
    }
    Ok(Struct { name, members })
}

fn type_of(index: &Index<'_>, id: u32) -> Result<Type, String> {
    let line = index.definition(id)?;
    let operand = |at: usize| line.operands.get(at).map(bits).unwrap_or_default();
    match line.class.opcode {
        Op::TypeFloat if operand(0) == 32 => Ok(Type::Scalar(Scalar::F32)),
        Op::TypeInt if operand(0) == 32 && operand(1) == 0 => Ok(Type::Scalar(Scalar::U32)),
        Op::TypeInt if operand(0) == 32 => Ok(Type::Scalar(Scalar::I32)),
        Op::TypeVector => match type_of(index, operand(0))? {
            Type::Scalar(scalar) => Ok(Type::Vector(scalar, operand(1))),
            _ => Err("a vector of something other than numbers".to_owned()),
        },
        Op::TypeMatrix => match type_of(index, operand(0))? {
            Type::Vector(Scalar::F32, rows) => Ok(Type::Matrix {
                columns: operand(1),
                rows,
            }),
            _ => Err("only matrices of float are shared with the host".to_owned()),
        },
        Op::TypeArray => {
            let element = type_of(index, operand(0))?;
            check_stride(index, id, &element)?;
            let count = index.constant(operand(1))?;
            Ok(Type::Array(Box::new(element), count))
        }
        Op::TypeStruct => structure(index, id).map(Type::Struct),
        Op::TypeRuntimeArray => Err("an unsized array stands alone in its block".to_owned()),
        other => Err(format!(
            "{other:?} has no layout that the host shares: use 32-bit numbers, vectors, matrices, arrays, structs"
        )),
    }
}

fn check_stride(index: &Index<'_>, array: u32, element: &Type) -> Result<(), String> {
    match index.value(array, None, Decoration::ArrayStride) {
        Some(stride) if stride == element.size() => Ok(()),
        _ => Err("its elements are padded: declare the block with layout(…, scalar)".to_owned()),
    }
}

fn spec_constant(index: &Index<'_>, line: &Instruction, id: u32) -> Result<Option<Spec>, Fault> {
    // The workgroup's size is a second, nameless constant of the same id.
    let (Some(number), name) = (
        index.value(id, None, Decoration::SpecId),
        index.name(id).to_owned(),
    ) else {
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

/// Words that GLSL allows as names and Rust does not.
const RESERVED: &[&str] = &[
    "abstract", "as", "async", "await", "become", "box", "crate", "dyn", "enum", "extern", "final",
    "fn", "gen", "impl", "let", "loop", "macro", "match", "mod", "move", "mut", "override", "priv",
    "pub", "ref", "self", "static", "super", "trait", "try", "type", "typeof", "unsafe", "unsized",
    "use", "virtual", "where", "yield",
];

/// Checks that a name is one in Rust's style.
pub(crate) fn rust_name(name: &str) -> Result<String, String> {
    let snake = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    if name.is_empty() || name.starts_with(|c: char| !c.is_ascii_lowercase()) {
        return Err(format!("`{name}` must start with a small letter"));
    }
    if !name.chars().all(snake) {
        return Err(format!("`{name}` must be in snake_case"));
    }
    if RESERVED.contains(&name) {
        return Err(format!("`{name}` is a keyword of Rust"));
    }
    Ok(name.to_owned())
}
