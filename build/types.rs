//! Interface types of a module, packed, of 32-bit numbers.

use super::model::{Member, Scalar, Struct, Type};
use super::spirv::{Index, bits};
use rspirv::spirv::{Decoration, Op};

/// A struct or block; padding is refused.
pub(crate) fn structure(index: &Index<'_>, id: u32) -> Result<Struct, String> {
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

/// The type of that id.
pub(crate) fn type_of(index: &Index<'_>, id: u32) -> Result<Type, String> {
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

/// Refuses arrays with padded elements.
pub(crate) fn check_stride(index: &Index<'_>, array: u32, element: &Type) -> Result<(), String> {
    match index.value(array, None, Decoration::ArrayStride) {
        Some(stride) if stride == element.size() => Ok(()),
        _ => Err("its elements are padded: declare the block with layout(…, scalar)".to_owned()),
    }
}

/// Rust keywords that are valid names in GLSL.
const RESERVED: &[&str] = &[
    "abstract", "as", "async", "await", "become", "box", "crate", "dyn", "enum", "extern", "final", "fn", "gen",
    "impl", "let", "loop", "macro", "match", "mod", "move", "mut", "override", "priv", "pub", "ref", "self", "static",
    "super", "trait", "try", "type", "typeof", "unsafe", "unsized", "use", "virtual", "where", "yield",
];

/// Checks for a name in Rust's style.
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
