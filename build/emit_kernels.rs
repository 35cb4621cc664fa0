//! `kernels.rs`: for every kernel a module with its variants, tunables, parameters, bindings and wrapper.

use super::emit_layout::structure;
use super::kernel::{Kernel, Variant};
use super::model::{Bound, Scalar, Spec};
use super::source::At;
use std::fmt::Write;

/// The whole file.
pub(crate) fn kernels(kernels: &[Kernel]) -> String {
    let mut text = String::new();
    let mut table = String::new();
    for kernel in kernels {
        let name = &kernel.name;
        let comment = kernel
            .variants
            .first()
            .and_then(|base| base.sources.opening());
        let comment = comment.unwrap_or_else(|| format!("`{name}`"));
        let _ = writeln!(text, "/// {comment}\npub mod {name} {{\n{PRELUDE}");
        variant_enum(&mut text, kernel);
        spec(&mut text, kernel);
        choice(&mut text, kernel);
        params(&mut text, kernel);
        if WITH_GPU {
            bindings(&mut text, kernel);
            wrapper(&mut text, kernel);
        }
        for variant in &kernel.variants {
            info(&mut text, kernel, variant);
            let _ = writeln!(table, "    &{name}::{},", static_name(variant));
        }
        let _ = writeln!(text, "}}\n");
    }
    let _ = writeln!(
        text,
        "/// Every variant of every kernel.\npub static KERNELS: &[&crate::shader::KernelInfo] = &[\n{table}];"
    );
    text
}

/// Whether `crate::gpu` is there to record with.
const WITH_GPU: bool = false;

/// What every module starts with. Not every kernel has use for all of it.
const PRELUDE: &str = r#"    #[allow(unused_imports, reason = "one list for all kernels; some have no struct, no image")]
    use crate::{
        layout,
        shader::{Access, BindingInfo, BindingKind, KernelInfo, Requirement, SpecInfo},
    };
"#;

/// `subgroup_wide` as `SubgroupWide`; the base variant as `Base`.
fn camel(variant: &str) -> String {
    if variant.is_empty() {
        return "Base".to_owned();
    }
    let words = variant.split('_').map(|word| {
        let (first, rest) = word.split_at(word.len().min(1));
        first.to_uppercase() + rest
    });
    words.collect()
}

/// The `KernelInfo` of a variant.
fn static_name(variant: &Variant) -> String {
    match variant.name.as_str() {
        "" => "INFO".to_owned(),
        name => format!("INFO_{}", name.to_uppercase()),
    }
}

fn variant_enum(text: &mut String, kernel: &Kernel) {
    let mut items = String::new();
    let mut all = String::new();
    let mut infos = String::new();
    for (number, variant) in kernel.variants.iter().enumerate() {
        let name = camel(&variant.name);
        let default = if number == 0 {
            "        #[default]\n"
        } else {
            ""
        };
        let comment = match variant.name.as_str() {
            "" => "The portable one.".to_owned(),
            other => {
                let opening = variant.sources.opening();
                opening.unwrap_or_else(|| format!("`{other}`"))
            }
        };
        let _ = writeln!(items, "        /// {comment}\n{default}        {name},");
        let _ = write!(all, "Variant::{name}, ");
        let _ = writeln!(
            infos,
            "                Variant::{name} => &{},",
            static_name(variant)
        );
    }
    let _ = write!(
        text,
        r#"
    /// The files that implement this kernel.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub enum Variant {{
{items}    }}

    impl Variant {{
        /// Every variant, the portable one first.
        pub const ALL: &[Variant] = &[{all}];

        /// The part of the file name between the dots; `base` for the portable one.
        pub fn name(self) -> &'static str {{
            match self.info().variant {{
                "" => "base",
                name => name,
            }}
        }}

        /// What reflection found.
        pub fn info(self) -> &'static KernelInfo {{
            match self {{
{infos}            }}
        }}
    }}
"#
    );
}

/// `Eq` where all tunables have it.
fn eq(kernel: &Kernel) -> &'static str {
    let float = kernel.specs.iter().any(|spec| spec.scalar == Scalar::F32);
    if float { "" } else { ", Eq" }
}

fn spec(text: &mut String, kernel: &Kernel) {
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
        let _ = writeln!(
            fields,
            "        /// {}\n        pub {name}: {ty},",
            comment(spec)
        );
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
    /// The numbers that tune; their defaults are the shader's own.
    #[derive(Clone, Copy, Debug, {derive}PartialEq{eq})]
    pub struct Spec {{
{fields}    }}
{default}
    impl Spec {{
        /// Their bits, in the order of [`KernelInfo::specs`].
        pub fn values(&self) -> [u32; {count}] {{
            [{values}]
        }}
    }}
"#
    );
}

fn choice(text: &mut String, kernel: &Kernel) {
    let _ = write!(
        text,
        r#"
    /// A variant and its tuning.
    #[derive(Clone, Copy, Debug, Default, PartialEq{eq})]
    pub struct Choice {{
        /// Which file.
        pub variant: Variant,
        /// Tuned how.
        pub spec: Spec,
    }}

"#,
        eq = eq(kernel)
    );
}

fn params(text: &mut String, kernel: &Kernel) {
    let Some(base) = kernel.variants.first() else {
        return;
    };
    if let Some(params) = &base.module.params {
        let comment = "What changes from one dispatch to the next: the push constants.";
        structure(text, params, "Params", "layout::", comment, &base.sources);
    }
}

fn bindings(text: &mut String, kernel: &Kernel) {
    let Some(base) = kernel.variants.first() else {
        return;
    };
    let _ = writeln!(
        text,
        "    /// What one dispatch reads and writes.\n    #[derive(Clone, Copy)]\n    pub struct Bindings<'a> {{"
    );
    for binding in &base.module.bindings {
        let ty = match &binding.bound {
            Bound::Buffer(element) => format!("Buffer<{}>", element.rust("layout::")),
            Bound::Image => "Image".to_owned(),
        };
        let at = At::Binding(binding.binding);
        let comment = base.sources.member_comment(&binding.block, &binding.name);
        let comment = comment.or_else(|| base.sources.comment(at));
        let comment = comment.unwrap_or_else(|| format!("`{}` of the shader.", binding.name));
        let name = &binding.name;
        let _ = writeln!(text, "        /// {comment}\n        pub {name}: &'a {ty},");
    }
    let _ = writeln!(text, "    }}");
}

fn wrapper(text: &mut String, kernel: &Kernel) {
    let Some(base) = kernel.variants.first() else {
        return;
    };
    let name = &kernel.name;
    let (argument, bytes) = match base.module.params {
        Some(_) => ("params: Params, ", "bytemuck::bytes_of(&params)"),
        None => ("", "&[]"),
    };
    let slots: Vec<String> = base.module.bindings.iter().map(slot).collect();
    let _ = write!(
        text,
        r#"
    /// `{name}`, ready to be dispatched.
    #[derive(Debug)]
    pub struct Kernel(Pipeline);

    impl Kernel {{
        /// Makes the pipeline.
        ///
        /// # Errors
        ///
        /// When the device cannot run the chosen variant, or Vulkan fails.
        pub fn new(gpu: &Gpu, choice: Choice) -> Result<Kernel> {{
            Ok(Kernel(Pipeline::new(gpu, choice.variant.info(), &choice.spec.values())?))
        }}

        /// Records one dispatch, after the barriers that its bindings call for.
        pub fn record(&self, rec: &mut Recorder<'_>, io: Bindings<'_>, {argument}groups: Groups<'_>) {{
            rec.dispatch(&self.0, &[{slots}], {bytes}, groups);
        }}
    }}
"#,
        slots = slots.join(", ")
    );
}

fn slot(binding: &super::model::Binding) -> String {
    format!("Slot::from(io.{})", binding.name)
}

fn info(text: &mut String, kernel: &Kernel, variant: &Variant) {
    let mut bindings = String::new();
    for binding in &variant.module.bindings {
        let kind = match binding.bound {
            Bound::Buffer(_) => "Buffer",
            Bound::Image => "StorageImage",
        };
        let _ = writeln!(
            bindings,
            "            BindingInfo {{ binding: {}, name: {:?}, kind: BindingKind::{kind}, access: Access::{:?} }},",
            binding.binding, binding.name, binding.access
        );
    }
    let mut specs = String::new();
    for Spec {
        id, name, default, ..
    } in &kernel.specs
    {
        let _ = writeln!(
            specs,
            "            SpecInfo {{ id: {id}, name: {name:?}, default: {default:#x} }},"
        );
    }
    let mut requirements = String::new();
    for requirement in &variant.module.requirements {
        let _ = write!(requirements, "Requirement::{requirement:?}, ");
    }
    let _ = write!(
        text,
        r#"
    pub(super) static {name}: KernelInfo = KernelInfo {{
        kernel: {kernel:?},
        variant: {variant:?},
        spirv: {{
            static WORDS: [u32; {count}] =
                super::words(include_bytes!(concat!(env!("OUT_DIR"), "/{file}")));
            &WORDS
        }},
        bindings: &[
{bindings}        ],
        params_size: {params},
        specs: &[
{specs}        ],
        requirements: &[{requirements}],
    }};
"#,
        name = static_name(variant),
        kernel = kernel.name,
        variant = variant.name,
        count = variant.spirv.len(),
        file = spirv_file(kernel, variant),
        params = variant.params_size(),
    );
}

/// The name of a variant's module among the build's outputs.
pub(crate) fn spirv_file(kernel: &Kernel, variant: &Variant) -> String {
    match variant.name.as_str() {
        "" => format!("{}.spv", kernel.name),
        name => format!("{}.{name}.spv", kernel.name),
    }
}
