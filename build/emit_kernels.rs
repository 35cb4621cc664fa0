//! `kernels.rs`: for every kernel a module with its variants, tunables, parameters, bindings and wrapper.

use super::emit_choice::{camel, choice, spec, variant_enum};
use super::emit_layout::structure;
use super::kernel::{Kernel, Variant};
use super::model::{Binding, Bound, Spec};
use super::source::At;
use std::fmt::Write;

/// The whole file.
pub(crate) fn kernels(kernels: &[Kernel]) -> String {
    let mut text = String::new();
    let mut table = String::new();
    for kernel in kernels {
        let name = &kernel.name;
        let comment = kernel.variants.first().and_then(|base| base.sources.opening());
        let comment = comment.unwrap_or_else(|| format!("`{name}`"));
        let _ = writeln!(text, "/// {comment}\npub mod {name} {{\n{PRELUDE}");
        variant_enum(&mut text, kernel);
        spec(&mut text, kernel);
        choice(&mut text, kernel);
        params(&mut text, kernel);
        bindings(&mut text, kernel);
        wrapper(&mut text, kernel);
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

/// Imports of every module; not every kernel needs all of them.
const PRELUDE: &str = r#"    #[allow(unused_imports, reason = "one list for all kernels; some have no struct, no image")]
    use crate::{
        error::Result,
        gpu::{Buffer, Gpu, Groups, Image, Pipeline, Recorder, Slot},
        layout,
        shader::{Access, BindingInfo, BindingKind, KernelInfo, Requirement, SpecInfo},
    };
"#;

/// The `KernelInfo` of a variant.
pub(crate) fn static_name(variant: &Variant) -> String {
    match variant.name.as_str() {
        "" => "INFO".to_owned(),
        name => format!("INFO_{}", name.to_uppercase()),
    }
}

fn params(text: &mut String, kernel: &Kernel) {
    let Some(base) = kernel.variants.first() else {
        return;
    };
    if let Some(params) = &base.module.params {
        let comment = "Push constants: parameters of one dispatch.";
        structure(text, params, "Params", "layout::", comment, &base.sources);
    }
}

fn bindings(text: &mut String, kernel: &Kernel) {
    let Some(base) = kernel.variants.first() else {
        return;
    };
    let _ = writeln!(
        text,
        "    /// Buffers and images of one dispatch.\n    #[derive(Clone, Copy)]\n    pub struct Bindings<'a> {{"
    );
    for binding in &base.module.bindings {
        let ty = match &binding.bound {
            Bound::Buffer(element) => format!("Buffer<{}>", element.rust("layout::")),
            Bound::Image | Bound::SampledImage => "Image".to_owned(),
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

/// The type of the pipeline, named after the kernel.
fn wrapper(text: &mut String, kernel: &Kernel) {
    let Some(base) = kernel.variants.first() else {
        return;
    };
    let (kernel_name, name) = (&kernel.name, camel(&kernel.name));
    let (argument, bytes) = match base.module.params {
        Some(_) => ("params: Params, ", "bytemuck::bytes_of(&params)"),
        None => ("", "&[]"),
    };
    let slots: Vec<String> = base.module.bindings.iter().map(slot).collect();
    let sized = kernel.specs.iter().any(|spec| spec.name == "workgroup");
    let (field, value, groups) = match sized {
        true => (FIELD, "workgroup: choice.spec.workgroup,", GROUPS),
        false => ("", "", ""),
    };
    let _ = write!(
        text,
        r#"
    /// Compute pipeline of `{kernel_name}`.
    #[derive(Debug)]
    pub struct {name} {{
        pipeline: Pipeline,{field}
    }}

    impl {name} {{
        /// Creates the pipeline.
        ///
        /// # Errors
        ///
        /// If the device cannot run the chosen variant, or Vulkan fails.
        pub fn new(gpu: &Gpu, choice: Choice) -> Result<{name}> {{
            let pipeline = Pipeline::new(gpu, choice.variant.info(), &choice.spec.values())?;
            Ok({name} {{ pipeline, {value} }})
        }}
{groups}
        /// Records one dispatch, preceded by a barrier if its bindings need one.
        pub fn record(&self, rec: &mut Recorder<'_>, io: Bindings<'_>, {argument}groups: Groups<'_>) {{
            rec.dispatch(&self.pipeline, &[{slots}], {bytes}, groups);
        }}
    }}
"#,
        slots = slots.join(", "),
    );
    kernel_trait(text, kernel_name, &name, sized);
}

/// Implementation of `kernels::Kernel`.
fn kernel_trait(text: &mut String, kernel_name: &str, name: &str, sized: bool) {
    let _ = write!(
        text,
        r#"
    impl crate::kernels::Kernel for {name} {{
        type Choice = Choice;
        const NAME: &'static str = {kernel_name:?};

        fn choices(workgroup: u32) -> Vec<Choice> {{
            let choice = |&variant: &Variant| {{
                {tuned}Choice {{ variant, spec: Spec::default() }}{end}
            }};
            Variant::ALL.iter().map(choice).collect()
        }}

        fn info(choice: &Choice) -> &'static KernelInfo {{
            choice.variant.info()
        }}

        fn compile(gpu: &Gpu, choice: Choice) -> Result<{name}> {{
            {name}::new(gpu, choice)
        }}
    }}
"#,
        tuned = if sized {
            "let mut choice = "
        } else {
            "let _ = workgroup;\n                "
        },
        end = if sized {
            ";\n                choice.spec.workgroup = workgroup;\n                choice"
        } else {
            ""
        },
    );
}

/// Field of kernels with a tunable workgroup.
const FIELD: &str = r"
        /// Invocations of a workgroup.
        pub workgroup: u32,";

/// Method of kernels with a tunable workgroup.
const GROUPS: &str = r"
        /// Workgroups of a dispatch with one invocation per element.
        pub fn groups(&self, elements: usize) -> Groups<'static> {
            Groups::Count((elements as u32).div_ceil(self.workgroup))
        }
";

fn slot(binding: &Binding) -> String {
    format!("Slot::from(io.{})", binding.name)
}

fn info(text: &mut String, kernel: &Kernel, variant: &Variant) {
    let mut bindings = String::new();
    for binding in &variant.module.bindings {
        let kind = match binding.bound {
            Bound::Buffer(_) => "Buffer",
            Bound::Image => "StorageImage",
            Bound::SampledImage => "SampledImage",
        };
        let _ = writeln!(
            bindings,
            "            BindingInfo {{ binding: {}, name: {:?}, kind: BindingKind::{kind}, access: Access::{:?} }},",
            binding.binding, binding.name, binding.access
        );
    }
    let mut specs = String::new();
    for Spec { id, name, default, .. } in &kernel.specs {
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
