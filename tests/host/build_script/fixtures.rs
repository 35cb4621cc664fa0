//! Small shader folders as input of the generator.

use crate::build_script::generator::kernel::Kernel;
use crate::build_script::generator::model::Module;
use std::path::Path;

pub(crate) const PRELUDE: &str = "#extension GL_EXT_scalar_block_layout : require\n";
/// For loops to unroll.
const ATTRIBUTES: &str = "#extension GL_EXT_control_flow_attributes : require\n";
/// The first five lines of most test kernels; the rest starts at line 6.
pub(crate) const OPEN: &str = "#version 460
#include \"shared/prelude.glsl\"
layout(constant_id = 0) const uint WORKGROUP = 64;
layout(local_size_x_id = 0) in;
layout(set = 0, binding = 0, scalar) buffer Data { uint data[]; };
";
pub(crate) const MAIN: &str = "void main() { data[0] = 1; }\n";

/// A `glsl` folder with these files and a prelude.
pub(crate) fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    std::fs::create_dir(dir.path().join("shared")).unwrap();
    std::fs::write(dir.path().join("shared/prelude.glsl"), [PRELUDE, ATTRIBUTES].concat()).unwrap();
    for (name, text) in files {
        std::fs::write(dir.path().join(name), text).unwrap();
    }
    dir
}

pub(crate) fn build(text: &str) -> Result<Kernel, Vec<String>> {
    let dir = folder(&[("test.comp", text)]);
    Kernel::build(dir.path(), "test", &[String::new()])
}

pub(crate) fn build_pair(base: &str, wide: &str) -> Result<Kernel, Vec<String>> {
    let dir = folder(&[("test.comp", base), ("test.wide.comp", wide)]);
    Kernel::build(dir.path(), "test", &[String::new(), "wide".to_owned()])
}

/// Reflection of the base variant.
pub(crate) fn module(text: &str) -> Module {
    let kernel = build(text).unwrap();
    kernel.variants.first().unwrap().module.clone()
}

/// The instructions of a SPIR-V module.
pub(crate) fn instructions(module: &[u32]) -> Vec<&[u32]> {
    let (_, mut rest) = module.split_at(5);
    let mut lines = Vec::new();
    while let Some(first) = rest.first() {
        let (line, next) = rest.split_at((first >> 16) as usize);
        lines.push(line);
        rest = next;
    }
    lines
}

/// The texts of `layout.rs` and `kernels.rs`.
pub(crate) fn generate(glsl: &Path) -> Result<(String, String), Vec<String>> {
    let out = tempfile::tempdir().unwrap();
    crate::build_script::generator::generate(glsl, out.path())?;
    let read = |name| std::fs::read_to_string(out.path().join(name)).unwrap();
    Ok((read("layout.rs"), read("kernels.rs")))
}

/// Asserts that a kernel is rejected at a line for a reason.
pub(crate) fn refused(text: &str, line: u32, reason: &str) {
    let faults = build(text).err().expect("should be refused");
    let place = format!("glsl/test.comp:{line}:");
    assert!(
        faults
            .iter()
            .any(|fault| fault.contains(&place) && fault.contains(reason)),
        "expected `{place} …{reason}…`, got {faults:#?}"
    );
}

pub(crate) fn assert_contains(text: &str, all: &[&str]) {
    for expected in all {
        assert!(text.contains(expected), "no `{expected}` in\n{text}");
    }
}
