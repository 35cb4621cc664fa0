//! Kernels made of the files in `glsl/`, and the consistency rules of their variants.

use super::compile::{Compiled, compile};
use super::model::{Bound, Module, Spec, Type};
use super::reflect::reflect;
use super::source::{At, Sources};
use super::types::rust_name;
use std::path::Path;

/// Push constant bytes that Vulkan guarantees.
const PARAMS_MAX: u32 = 128;

/// One compiled file.
pub(crate) struct Variant {
    /// The part between the dots; empty for the base variant.
    pub(crate) name: String,
    pub(crate) module: Module,
    pub(crate) spirv: Vec<u32>,
    pub(crate) sources: Sources,
}

/// A kernel: its base variant first, then the others by name.
pub(crate) struct Kernel {
    pub(crate) name: String,
    pub(crate) variants: Vec<Variant>,
    /// The tunables of all variants, by id.
    pub(crate) specs: Vec<Spec>,
}

impl Kernel {
    /// Compiles `<name>.comp` and `<name>.<variant>.comp` for each of `variants`.
    pub(crate) fn build(glsl: &Path, name: &str, variants: &[String]) -> Result<Kernel, Vec<String>> {
        let mut built = Vec::new();
        let mut faults = Vec::new();
        for variant in variants {
            let file = match variant.as_str() {
                "" => format!("{name}.comp"),
                variant => format!("{name}.{variant}.comp"),
            };
            match Variant::build(glsl, &file, variant) {
                Ok(variant) => built.push(variant),
                Err(more) => faults.extend(more),
            }
        }
        if !faults.is_empty() {
            return Err(faults);
        }
        Kernel::unite(name, built)
    }

    /// Makes one kernel of its variants, if they are consistent.
    pub(crate) fn unite(name: &str, variants: Vec<Variant>) -> Result<Kernel, Vec<String>> {
        let Some((base, others)) = variants.split_first().filter(|(base, _)| base.name.is_empty()) else {
            return Err(vec![format!(
                "glsl/{name}.comp:1: missing: a kernel needs its portable base variant"
            )]);
        };
        let mut faults = Vec::new();
        let mut specs = base.module.specs.clone();
        for other in others {
            other.compare(base, &mut faults);
            for spec in &other.module.specs {
                match specs
                    .iter()
                    .find(|known| known.id == spec.id || known.name == spec.name)
                {
                    None => specs.push(spec.clone()),
                    Some(known) if known == spec => {}
                    Some(known) => faults.push(other.sources.fault(
                        At::Spec(spec.id),
                        format_args!(
                            "differs from another variant, where constant {} is `{}` with another type or default",
                            known.id, known.name
                        ),
                    )),
                }
            }
        }
        specs.sort_by_key(|spec| spec.id);
        if !faults.is_empty() {
            return Err(faults);
        }
        Ok(Kernel {
            name: name.to_owned(),
            variants,
            specs,
        })
    }
}

impl Variant {
    fn build(glsl: &Path, file: &str, name: &str) -> Result<Variant, Vec<String>> {
        let Compiled {
            plain,
            embedded,
            sources,
        } = compile(glsl, file).map_err(|fault| vec![fault])?;
        let module = reflect(&plain, &sources)?;
        let variant = Variant {
            name: name.to_owned(),
            module,
            spirv: embedded,
            sources,
        };
        let faults = variant.check();
        if faults.is_empty() { Ok(variant) } else { Err(faults) }
    }

    /// The rules for one file.
    fn check(&self) -> Vec<String> {
        let mut faults = self.sources.check();
        let mut fault = |at, what: String| faults.push(self.sources.fault(at, what));
        let size = self.params_size();
        if size > PARAMS_MAX {
            let what = format!("{size} bytes of push constants; devices promise {PARAMS_MAX}");
            fault(At::Push, what);
        }
        if self.module.params.as_ref().is_some_and(|p| p.members.is_empty()) {
            fault(At::Push, "push constants without a member".to_owned());
        }
        if self.module.bindings.is_empty() {
            fault(At::Kernel, "a kernel without bindings has no effect".to_owned());
        }
        let mut names: Vec<&str> = self.module.bindings.iter().map(|b| b.name.as_str()).collect();
        names.sort_unstable();
        for pair in names.windows(2) {
            if let [first, second] = pair
                && first == second
            {
                fault(At::Kernel, format!("two bindings are called `{first}`"));
            }
        }
        let workgroup = self.module.specs.iter().find(|spec| spec.name == "workgroup");
        let named = workgroup.is_some_and(|spec| spec.id == 0);
        if self.sources.has_workgroup_constant() != named || (workgroup.is_some() && !named) {
            let rule = "constant 0 is `WORKGROUP` exactly where local_size_x_id = 0 is declared";
            fault(At::Spec(0), rule.to_owned());
        }
        faults
    }

    /// Variants are interchangeable: the same `Params`, the same bindings, the same access.
    fn compare(&self, base: &Variant, faults: &mut Vec<String>) {
        if self.module.params != base.module.params {
            let what = "the push constants differ from the base variant's";
            faults.push(self.sources.fault(At::Push, what));
        }
        let mut theirs = base.module.bindings.iter();
        for ours in &self.module.bindings {
            let same = theirs.next().is_some_and(|other| {
                (ours.binding, &ours.name, ours.access, &ours.bound)
                    == (other.binding, &other.name, other.access, &other.bound)
            });
            if !same {
                let what = format!("`{}` differs from the base variant's bindings", ours.name);
                faults.push(self.sources.fault(At::Binding(ours.binding), what));
            }
        }
        if let Some(missing) = theirs.next() {
            let what = format!("binding `{}` of the base variant is missing", missing.name);
            faults.push(self.sources.fault(At::Kernel, what));
        }
    }

    /// Bytes of push constants.
    pub(crate) fn params_size(&self) -> u32 {
        self.module.params.as_ref().map_or(0, super::model::Struct::size)
    }

    /// Every type of this variant's interface with the host.
    pub(crate) fn buffer_types(&self) -> impl Iterator<Item = &Type> {
        self.module.bindings.iter().filter_map(|binding| match &binding.bound {
            Bound::Buffer(element) => Some(element),
            Bound::Image | Bound::SampledImage => None,
        })
    }
}

/// The kernels among file names, each with its variants, base first.
pub(crate) fn group(mut files: Vec<String>) -> Result<Vec<(String, Vec<String>)>, Vec<String>> {
    files.sort();
    let mut kernels: Vec<(String, Vec<String>)> = Vec::new();
    let mut faults = Vec::new();
    for file in &files {
        let Some(stem) = file.strip_suffix(".comp") else {
            continue;
        };
        let (kernel, variant) = stem.split_once('.').unwrap_or((stem, ""));
        let names = rust_name(kernel).and_then(|_| match variant {
            "" => Ok(()),
            "base" | "all" => Err(format!("`{variant}` is no name for a variant")),
            variant => rust_name(variant).map(|_| ()),
        });
        if let Err(what) = names {
            faults.push(format!("glsl/{file}:1: {what}"));
            continue;
        }
        match kernels.iter_mut().find(|(name, _)| name == kernel) {
            Some((_, variants)) => variants.push(variant.to_owned()),
            None => kernels.push((kernel.to_owned(), vec![variant.to_owned()])),
        }
    }
    for (_, variants) in &mut kernels {
        variants.sort();
    }
    if faults.is_empty() { Ok(kernels) } else { Err(faults) }
}
