//! Interface of one compiled kernel, in terms common to GLSL and Rust.
//!
//! The layout is scalar: members follow each other without padding, so that `[f32; 3]` is `vec3`. `reflect` refuses any
//! other layout.

use super::shader::{Access, Requirement};

/// A 32-bit number; other widths are not supported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scalar {
    F32,
    U32,
    I32,
}

impl Scalar {
    /// The name in Rust.
    pub(crate) fn rust(self) -> &'static str {
        match self {
            Scalar::F32 => "f32",
            Scalar::U32 => "u32",
            Scalar::I32 => "i32",
        }
    }
}

/// The type of a member.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Type {
    Scalar(Scalar),
    Vector(Scalar, u32),
    /// Columns of `f32`, each `rows` long.
    Matrix {
        columns: u32,
        rows: u32,
    },
    Array(Box<Type>, u32),
    Struct(Struct),
}

impl Type {
    /// Bytes, without padding.
    pub(crate) fn size(&self) -> u32 {
        match self {
            Type::Scalar(_) => 4,
            Type::Vector(_, count) => 4 * count,
            Type::Matrix { columns, rows } => 4 * columns * rows,
            Type::Array(element, count) => element.size() * count,
            Type::Struct(inner) => inner.size(),
        }
    }

    /// The type in Rust; structs are looked up in the module `path` (`""` or `"layout::"`).
    pub(crate) fn rust(&self, path: &str) -> String {
        match self {
            Type::Scalar(scalar) => scalar.rust().to_owned(),
            Type::Vector(scalar, count) => format!("[{}; {count}]", scalar.rust()),
            Type::Matrix { columns, rows } => format!("[[f32; {rows}]; {columns}]"),
            Type::Array(element, count) => format!("[{}; {count}]", element.rust(path)),
            Type::Struct(inner) => format!("{path}{}", inner.name),
        }
    }

    /// Calls `visit` for every struct inside, innermost first.
    pub(crate) fn each_struct<'a>(&'a self, visit: &mut dyn FnMut(&'a Struct)) {
        match self {
            Type::Array(element, _) => element.each_struct(visit),
            Type::Struct(inner) => {
                inner.each_member_struct(visit);
                visit(inner);
            }
            Type::Scalar(_) | Type::Vector(..) | Type::Matrix { .. } => {}
        }
    }

    /// True for arrays of more than 32 elements, which have no `Default`.
    pub(crate) fn has_long_array(&self) -> bool {
        match self {
            Type::Array(element, count) => *count > 32 || element.has_long_array(),
            _ => false,
        }
    }
}

/// A struct or the contents of a block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Struct {
    pub(crate) name: String,
    pub(crate) members: Vec<Member>,
}

impl Struct {
    /// Bytes, without padding.
    pub(crate) fn size(&self) -> u32 {
        self.members.iter().map(|member| member.ty.size()).sum()
    }

    /// Calls `visit` for every struct among the members, innermost first; not for itself.
    pub(crate) fn each_member_struct<'a>(&'a self, visit: &mut dyn FnMut(&'a Struct)) {
        for member in &self.members {
            member.ty.each_struct(visit);
        }
    }
}

/// One member of a struct.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Member {
    pub(crate) name: String,
    /// Bytes from the start of the struct.
    pub(crate) offset: u32,
    pub(crate) ty: Type,
}

/// Contents of a binding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Bound {
    /// A storage buffer of this element type.
    Buffer(Type),
    /// A storage image.
    Image,
    SampledImage,
}

/// One binding of descriptor set 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Binding {
    pub(crate) binding: u32,
    /// The block's one member, or the image.
    pub(crate) name: String,
    /// Name of the block, the key to its comment; the image's name for an image.
    pub(crate) block: String,
    pub(crate) access: Access,
    pub(crate) bound: Bound,
}

/// A specialisation constant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Spec {
    pub(crate) id: u32,
    /// In lower case.
    pub(crate) name: String,
    pub(crate) scalar: Scalar,
    /// The default's bits.
    pub(crate) default: u32,
}

/// One compiled kernel variant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Module {
    /// In ascending order of binding.
    pub(crate) bindings: Vec<Binding>,
    /// The push constant block.
    pub(crate) params: Option<Struct>,
    /// In ascending order of id.
    pub(crate) specs: Vec<Spec>,
    /// Sorted, each once.
    pub(crate) requirements: Vec<Requirement>,
}
