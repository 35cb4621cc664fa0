//! Compiles the shaders.
fn main() {
    let _ = shaderc::Compiler::new();
}
