//! `layout.rs`: Rust types of the structs shared by shaders and host.

use super::kernel::Kernel;
use super::model::Struct;
use super::source::{At, Sources};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Every struct reachable from a binding or push constants, once; conflicting declarations of two kernels are added to
/// `faults`.
pub(crate) fn structs<'k>(kernels: &'k [Kernel], faults: &mut Vec<String>) -> String {
    let mut known: BTreeMap<&'k str, (&'k Struct, &'k Sources)> = BTreeMap::new();
    for variant in kernels.iter().flat_map(|kernel| &kernel.variants) {
        let mut visit = |found: &'k Struct| {
            let name = found.name.as_str();
            let (first, _) = *known.entry(name).or_insert((found, &variant.sources));
            if first != found {
                let what = format!("`{name}` has other members in another kernel");
                faults.push(variant.sources.fault(At::Struct(name), what));
            }
        };
        for ty in variant.buffer_types() {
            ty.each_struct(&mut visit);
        }
        if let Some(params) = &variant.module.params {
            params.each_member_struct(&mut visit);
        }
    }
    let mut text = String::new();
    for (name, (found, sources)) in known {
        let comment = sources.comment(At::Struct(name));
        let comment = comment.unwrap_or_else(|| format!("`{name}` of the shaders."));
        structure(&mut text, found, name, "", &comment, sources);
    }
    text
}

/// One struct with its assertions. `rust` is its name here, `path` the module path of the structs it contains.
pub(crate) fn structure(text: &mut String, found: &Struct, rust: &str, path: &str, comment: &str, sources: &Sources) {
    // `Default` of arrays ends at 32 elements; longer ones are zeroed by other means.
    let long = found.members.iter().any(|member| member.ty.has_long_array());
    let default = if long { "" } else { "Default, " };
    let _ = writeln!(
        text,
        "/// {comment}\n#[repr(C)]\n#[derive(Clone, Copy, Debug, {default}PartialEq, bytemuck::Pod, bytemuck::Zeroable)]\npub struct {rust} {{"
    );
    for member in &found.members {
        let name = &member.name;
        let comment = sources.member_comment(&found.name, name);
        let comment = comment.unwrap_or_else(|| format!("`{name}` of the shaders."));
        let _ = writeln!(text, "    /// {comment}\n    pub {name}: {},", member.ty.rust(path));
    }
    let _ = writeln!(text, "}}");
    if long {
        let _ = writeln!(
            text,
            "impl Default for {rust} {{\n    fn default() -> {rust} {{\n        bytemuck::Zeroable::zeroed()\n    }}\n}}"
        );
    }
    let _ = writeln!(
        text,
        "const _: () = {{\n    assert!(core::mem::size_of::<{rust}>() == {});",
        found.size()
    );
    for member in &found.members {
        let _ = writeln!(
            text,
            "    assert!(core::mem::offset_of!({rust}, {}) == {});",
            member.name, member.offset
        );
    }
    let _ = writeln!(text, "}};\n");
}
