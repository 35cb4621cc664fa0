//! Generator behind `build.rs`: derives Rust from the shaders' declarations.
//!
//! `compile` makes SPIR-V, `reflect` turns it into a `model`, `kernel` checks the consistency of variants, `emit_*`
//! write Rust. `source` supplies line numbers for messages and comments for the documentation, which SPIR-V lacks.

mod compile;
mod constants;
mod emit_choice;
mod emit_kernels;
mod emit_layout;
pub(crate) mod kernel;
pub(crate) mod model;
pub(crate) mod reflect;
#[path = "../src/shader/mod.rs"]
#[allow(
    dead_code,
    unreachable_pub,
    reason = "the crate's own module; here only its small enums are used"
)]
pub(crate) mod shader;
pub(crate) mod source;
mod spirv;
mod types;

use kernel::Kernel;
use std::panic::resume_unwind;
use std::path::Path;
use std::thread;

/// Compiles every `*.comp` in `glsl` and writes `layout.rs`, `kernels.rs` and the modules into `out`.
///
/// # Errors
///
/// All faults, one `file:line: message` each.
pub(crate) fn generate(glsl: &Path, out: &Path) -> Result<(), Vec<String>> {
    let lone = |error: std::io::Error| vec![format!("{}: {error}", glsl.display())];
    let mut files = Vec::new();
    for entry in std::fs::read_dir(glsl).map_err(lone)? {
        files.push(entry.map_err(lone)?.file_name().to_string_lossy().into_owned());
    }
    let mut kernels = Vec::new();
    let mut faults = Vec::new();
    for built in build_all(glsl, &kernel::group(files)?) {
        match built {
            Ok(kernel) => kernels.push(kernel),
            Err(more) => faults.extend(more),
        }
    }
    let layout = layout(glsl, &kernels, &mut faults)?;
    if !faults.is_empty() {
        return Err(faults);
    }
    let write = |name: &str, bytes: &[u8]| {
        let path = out.join(name);
        std::fs::write(&path, bytes).map_err(|error| vec![format!("{}: {error}", path.display())])
    };
    for kernel in &kernels {
        for variant in &kernel.variants {
            let bytes: Vec<u8> = variant.spirv.iter().flat_map(|w| w.to_le_bytes()).collect();
            write(&emit_kernels::spirv_file(kernel, variant), &bytes)?;
        }
    }
    write("layout.rs", layout.as_bytes())?;
    write("kernels.rs", emit_kernels::kernels(&kernels).as_bytes())
}

/// Builds each kernel in a thread of its own, since cargo compiles the crate only after all of them.
fn build_all(glsl: &Path, names: &[(String, Vec<String>)]) -> Vec<Result<Kernel, Vec<String>>> {
    thread::scope(|scope| {
        let build = |(name, variants): &(String, Vec<String>)| Kernel::build(glsl, name, variants);
        let threads: Vec<_> = names.iter().map(|name| scope.spawn(move || build(name))).collect();
        let join = |thread: thread::ScopedJoinHandle<'_, _>| thread.join().unwrap_or_else(|panic| resume_unwind(panic));
        threads.into_iter().map(join).collect()
    })
}

fn layout(glsl: &Path, kernels: &[Kernel], faults: &mut Vec<String>) -> Result<String, Vec<String>> {
    const CONSTANTS: &str = "shared/constants.glsl";
    let constants = match std::fs::read_to_string(glsl.join(CONSTANTS)) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
        Err(error) => return Err(vec![format!("glsl/{CONSTANTS}: {error}")]),
    };
    let constants = source::File::new(&format!("glsl/{CONSTANTS}"), &constants);
    Ok(constants::emit(&constants, faults) + "\n" + &emit_layout::structs(kernels, faults))
}
