//! The `Variant`, `Spec` and `Choice` types of a kernel's module.

use super::emit_kernels::static_name;
use super::kernel::Kernel;
use super::model::{Scalar, Spec};
use super::source::At;
use std::fmt::Write;

/// `subgroup_wide` as `SubgroupWide`; the base variant as `Base`.
pub(crate) fn camel(variant: &str) -> String {
    if variant.is_empty() {
        return "Base".to_owned();
    }
    let words = variant.split('_').map(|word| {
        let (first, rest) = word.split_at(word.len().min(1));
        first.to_uppercase() + rest
    });
    words.collect()
}

pub(crate) fn variant_enum(text: &mut String, kernel: &Kernel) {
    let mut items = String::new();
    let mut all = String::new();
    let mut infos = String::new();
    for (number, variant) in kernel.variants.iter().enumerate() {
        let name = camel(&variant.name);
        let default = if number == 0 { "        #[default]\n" } else { "" };
        let comment = match variant.name.as_str() {
            "" => "Portable variant.".to_owned(),
            other => {
                let opening = variant.sources.opening();
                opening.unwrap_or_else(|| format!("`{other}`"))
            }
        };
        let _ = writeln!(items, "        /// {comment}\n{default}        {name},");
        let _ = write!(all, "Variant::{name}, ");
        let _ = writeln!(infos, "                Variant::{name} => &{},", static_name(variant));
    }
    let _ = write!(
        text,
        r#"
    /// Implementations of this kernel, one file each.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub enum Variant {{
{items}    }}

    impl Variant {{
        /// All variants, the portable one first.
        pub const ALL: &[Variant] = &[{all}];

        /// Part of the file name between the dots; `base` for the portable variant.
        pub fn name(self) -> &'static str {{
            match self.info().variant {{
                "" => "base",
                name => name,
            }}
        }}

        /// Reflection of the variant's SPIR-V.
        pub fn info(self) -> &'static KernelInfo {{
            match self {{
{infos}            }}
        }}
    }}
"#
    );
}

/// `Eq`, unless a tunable is a float.
fn eq(kernel: &Kernel) -> &'static str {
    let float = kernel.specs.iter().any(|spec| spec.scalar == Scalar::F32);
    if float { "" } else { ", Eq" }
}

pub(crate) fn spec(text: &mut String, kernel: &Kernel) {
    let comment = |spec: &Spec| {
        let mut comments = kernel.variants.iter();
        let found = comments.find_map(|variant| variant.sources.comment(At::Spec(spec.id)));
        found.unwrap_or_else(|| format!("`{}` of the shader.", spec.name.to_uppercase()))
    };
    let eq = eq(kernel);
    let mut fields = String::new();
    let mut defaults = String::new();
    let mut values = String::new();
    for spec in &kernel.specs {
        let Spec { name, default, .. } = spec;
        let ty = spec.scalar.rust();
        let (default, value) = match spec.scalar {
            Scalar::U32 => (default.to_string(), format!("self.{name}")),
            Scalar::I32 => (
                default.cast_signed().to_string(),
                format!("self.{name}.cast_unsigned()"),
            ),
            Scalar::F32 => (
                format!("f32::from_bits({default:#x})"),
                format!("self.{name}.to_bits()"),
            ),
        };
        let _ = writeln!(fields, "        /// {}\n        pub {name}: {ty},", comment(spec));
        let _ = writeln!(defaults, "                {name}: {default},");
        let _ = write!(values, "{value}, ");
    }
    let count = kernel.specs.len();
    let (derive, default) = if count == 0 {
        ("Default, ", String::new())
    } else {
        let default = format!(
            r#"
    impl Default for Spec {{
        fn default() -> Spec {{
            Spec {{
{defaults}            }}
        }}
    }}
"#
        );
        ("", default)
    };
    let _ = write!(
        text,
        r#"
    /// Specialisation constants; the defaults are the shader's.
    #[derive(Clone, Copy, Debug, {derive}PartialEq{eq})]
    pub struct Spec {{
{fields}    }}
{default}
    impl Spec {{
        /// Bits of the constants, in the order of [`KernelInfo::specs`].
        pub fn values(&self) -> [u32; {count}] {{
            [{values}]
        }}
    }}
"#
    );
}

pub(crate) fn choice(text: &mut String, kernel: &Kernel) {
    let _ = write!(
        text,
        r#"
    /// Variant and specialisation constants.
    #[derive(Clone, Copy, Debug, Default, PartialEq{eq})]
    pub struct Choice {{
        /// Implementation.
        pub variant: Variant,
        /// Specialisation constants.
        pub spec: Spec,
    }}

"#,
        eq = eq(kernel)
    );
}
