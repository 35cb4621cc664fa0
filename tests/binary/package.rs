//! The package: a host in a crate of its own builds the renderer from it without a compiler of C++ or of shaders, and
//! draws.

use crate::tools::run;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// Programs for linking Rust, and for the C code of dependencies.
const PROGRAMS: [&str; 9] = ["cargo", "rustc", "cc", "gcc", "as", "ld", "ar", "ranlib", "strip"];

/// Programs that compile C++ or build the compiler of shaders.
const COMPILERS: [&str; 5] = ["c++", "g++", "cmake", "python3", "glslc"];

/// Makes a folder of links to programs.
fn link_programs(folder: &Path) {
    std::fs::create_dir(folder).unwrap();
    let path = std::env::var("PATH").unwrap();
    for name in PROGRAMS {
        let found = path
            .split(':')
            .map(|folder| Path::new(folder).join(name))
            .find(|path| path.is_file());
        if let Some(found) = found {
            symlink(found, folder.join(name)).unwrap();
        }
    }
    for name in COMPILERS {
        assert!(!folder.join(name).exists());
    }
}

#[test]
#[cfg(target_os = "linux")]
fn a_host_is_built_from_the_package_without_a_compiler_of_shaders() {
    let target = Path::new(env!("CARGO_BIN_EXE_ashfall")).ancestors().nth(2).unwrap();
    let mut package = Command::new(format!("{ROOT}/scripts/package"));
    let package = run(package.env("CARGO_TARGET_DIR", target));
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    run(Command::new("tar")
        .arg("-xzf")
        .arg(package.trim())
        .arg("-C")
        .arg(folder));
    let unpacked = folder.join(format!("ashfall-{}", env!("CARGO_PKG_VERSION")));

    let host = folder.join("host");
    std::fs::create_dir_all(host.join("src")).unwrap();
    let manifest = format!(
        "[package]\nname = \"host\"\nversion = \"0.1.0\"\nedition = \"2024\"\n\n[dependencies]\nash = \"0.38\"\n\
         glam = \"0.34\"\nashfall = {{ path = \"{}\", default-features = false }}\n\n[profile.dev]\ndebug = false\nincremental = false\n",
        unpacked.display()
    );
    std::fs::write(host.join("Cargo.toml"), manifest).unwrap();
    std::fs::copy(unpacked.join("examples/embed.rs"), host.join("src/main.rs")).unwrap();
    std::fs::copy(format!("{ROOT}/Cargo.lock"), host.join("Cargo.lock")).unwrap();
    let programs = folder.join("programs");
    link_programs(&programs);
    let build = |host: &Path| {
        let mut command = Command::new(env!("CARGO"));
        command.args(["run", "--offline", "--quiet"]).current_dir(host);
        command
            .env("PATH", &programs)
            .env("CARGO_TARGET_DIR", target.join("package-host"));
        command.env_remove("SHADERC_LIB_DIR");
        command
    };
    let told = run(&mut build(&host));
    assert!(told.contains("drew 1 splats"), "{told}");

    // Compiled shaders of other sources are refused.
    let shader = unpacked.join("glsl/present.comp");
    let text = std::fs::read_to_string(&shader).unwrap();
    std::fs::write(&shader, text + "// changed\n").unwrap();
    let refused = build(&host).output().unwrap();
    let errors = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(
        !refused.status.success() && errors.contains("is of other shaders"),
        "{errors}"
    );
    std::fs::remove_dir_all(unpacked.join("spirv")).unwrap();
    let refused = build(&host).output().unwrap();
    let errors = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(
        !refused.status.success() && errors.contains("the feature `compile`"),
        "{errors}"
    );
}
