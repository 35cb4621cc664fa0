//! GLSL to SPIR-V 1.5 for Vulkan 1.3, with includes taken from one folder.
//!
//! Not 1.6, whose workgroup sizes from constants (`LocalSizeId`) need the device feature `maintenance4`.

use super::source::{File, Sources};
use rspirv::binary::Assemble;
use rspirv::dr::{Operand, load_words};
use rspirv::spirv::LoopControl;
use shaderc::{
    CompileOptions, Compiler, EnvVersion, OptimizationLevel, ResolvedInclude, ShaderKind, SpirvVersion, TargetEnv,
};
use std::cell::RefCell;
use std::path::Path;

/// Optimisation of the embedded modules: a software device then takes about half the time for them. It costs the names
/// that debuggers show.
const EMBEDDED: OptimizationLevel = OptimizationLevel::Performance;

/// The attribute of loops that drivers unroll.
const UNROLL: &str = "[[unroll]]";

/// Stands for it while the module is optimised. The optimiser unrolls loops with that attribute itself, and its copies
/// of `precise` operations are not decorated with `NoContraction`.
const UNROLL_LATER: &str = "[[dependency_infinite]]";

/// One kernel file, compiled.
pub(crate) struct Compiled {
    /// Unoptimised, with every name and every declared binding: for reflection.
    pub(crate) plain: Vec<u32>,
    /// Embedded in the crate.
    pub(crate) embedded: Vec<u32>,
    /// The file and its includes.
    pub(crate) sources: Sources,
}

/// Compiles `glsl/<file>`; an error is the compiler's own message, which names file and line.
pub(crate) fn compile(glsl: &Path, file: &str) -> Result<Compiled, String> {
    let shown = format!("glsl/{file}");
    let text = read(glsl, file).map_err(|error| format!("{shown}: {error}"))?;
    let included = RefCell::new(Vec::new());
    let compiler = Compiler::new().map_err(|error| error.to_string())?;
    let run = |level, unroll: &str| -> Result<Vec<u32>, String> {
        included.borrow_mut().clear();
        let mut options = CompileOptions::new().map_err(|error| error.to_string())?;
        options.set_target_env(TargetEnv::Vulkan, EnvVersion::Vulkan1_3 as u32);
        options.set_target_spirv(SpirvVersion::V1_5);
        options.set_optimization_level(level);
        options.set_warnings_as_errors();
        options.set_include_callback(|name, _, from, _| {
            let content = read(glsl, name).map_err(|error| format!("{name}: {error}"))?;
            let resolved_name = format!("glsl/{name}");
            if resolved_name == from {
                return Err(format!("{name} includes itself"));
            }
            included.borrow_mut().push(File::new(&resolved_name, &content));
            let content = content.replace(UNROLL, unroll);
            Ok(ResolvedInclude { resolved_name, content })
        });
        let text = text.replace(UNROLL, unroll);
        let result = compiler.compile_into_spirv(&text, ShaderKind::Compute, &shown, "main", Some(&options));
        Ok(result.map_err(|error| error.to_string())?.as_binary().to_vec())
    };
    let plain = run(OptimizationLevel::Zero, UNROLL)?;
    let embedded = unrolled(&run(EMBEDDED, UNROLL_LATER)?)?;
    let mut files = vec![File::new(&shown, &text)];
    files.append(&mut included.borrow_mut());
    Ok(Compiled {
        plain,
        embedded,
        sources: Sources::new(files),
    })
}

/// The module with the loop control of [`UNROLL_LATER`] replaced by that of [`UNROLL`].
fn unrolled(words: &[u32]) -> Result<Vec<u32>, String> {
    let mut module = load_words(words).map_err(|error| error.to_string())?;
    let operands = module.all_inst_iter_mut().flat_map(|line| &mut line.operands);
    for operand in operands {
        if *operand == Operand::LoopControl(LoopControl::DEPENDENCY_INFINITE) {
            *operand = Operand::LoopControl(LoopControl::UNROLL);
        }
    }
    Ok(module.assemble())
}

/// Reads a file below the folder; refuses paths outside it.
fn read(glsl: &Path, name: &str) -> Result<String, String> {
    if name.split('/').any(|part| part == "..") || name.starts_with('/') {
        return Err("includes are named from glsl/ downward".to_owned());
    }
    std::fs::read_to_string(glsl.join(name)).map_err(|error| error.to_string())
}
