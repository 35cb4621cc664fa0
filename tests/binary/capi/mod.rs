//! The C libraries as a package: hosts in C and C++, one of them libplacebo's, draw the bits of the Rust interface, and
//! faults are refused.

use crate::common::device::gpu;
use crate::tools::run;
use ashfall::io::splats::{read, write};
use ashfall::render::{Model, RenderOptions, Renderer, ViewOptions};
use ashfall::scene::{Camera, ScreenFilter};
use glam::{DMat3, DVec2, DVec3};
use std::path::Path;
use std::process::Command;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
const WARNINGS: [&str; 4] = ["-Wall", "-Wextra", "-pedantic", "-Werror"];

/// Installs the package below a folder, built as this test was.
fn install(prefix: &Path) {
    let executable = Path::new(env!("CARGO_BIN_EXE_ashfall"));
    let profile = executable.parent().unwrap();
    let mut command = Command::new(format!("{ROOT}/scripts/capi"));
    command.arg(prefix);
    if profile.ends_with("debug") {
        // Unoptimised: hosts draw a few frames, and compiling takes longer than they do.
        command.args(["--dev", "--config", "profile.dev.package.ashfall.opt-level=0"]);
    }
    command.env("CARGO_TARGET_DIR", profile.parent().unwrap());
    run(&mut command);
}

/// Words that pkg-config gives for packages, ours among them.
fn flags(prefix: &Path, arguments: &[&str]) -> Vec<String> {
    let mut command = Command::new("pkg-config");
    let path = prefix.join("lib/pkgconfig");
    let words = run(command.env("PKG_CONFIG_PATH", path).args(arguments));
    words.split_whitespace().map(str::to_owned).collect()
}

fn compile(compiler: &[&str], source: &str, executable: &Path, flags: &[String]) {
    let mut command = Command::new(compiler[0]);
    command
        .args(&compiler[1..])
        .args(WARNINGS)
        .arg(format!("{ROOT}/{source}"));
    command.arg("-o").arg(executable).args(flags).args(["-lvulkan", "-lm"]);
    run(&mut command);
}

/// The picture of `examples/host.c`, as its bytes.
fn expected(scene: &Path) -> Vec<u8> {
    let gpu = gpu();
    let splats = read(scene).unwrap().splats;
    let model = Model::upload(&gpu, &splats).unwrap();
    let camera = Camera {
        width: 320,
        height: 240,
        focal: DVec2::splat(240.0),
        center: DVec2::new(160.0, 120.0),
        rotation: DMat3::IDENTITY,
        position: DVec3::new(0.0, 0.0, -4.0),
    };
    let view = ViewOptions {
        background: [0.25, 0.5, 0.75],
        near: 0.0625,
        filter: splats.filter,
    };
    let mut renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    let image = renderer.render(&model, &camera, &view).unwrap();
    let covered = image.transmittance.iter().filter(|t| **t < 0.5).count();
    assert!(covered > 1000, "{covered} pixels show nothing");
    let pixels = image.rgb.iter().zip(&image.transmittance);
    let bytes = pixels.flat_map(|([r, g, b], t)| [*r, *g, *b, 1.0 - t].map(f32::to_ne_bytes).concat());
    bytes.collect()
}

fn draws(host: &Path, prefix: &Path, scene: &Path, expected: &[u8]) {
    let pixels = prefix.join("pixels");
    let _ = std::fs::remove_file(&pixels);
    let mut command = Command::new(host);
    command
        .args([scene, &pixels])
        .env("LD_LIBRARY_PATH", prefix.join("lib"));
    run(&mut command);
    assert!(
        std::fs::read(&pixels).unwrap() == expected,
        "{} draws other bits",
        host.display()
    );
}

/// Draws by a host whose device, image and queue are libplacebo's, which then renders the picture itself. A layout that
/// is stated wrongly is noticed.
fn draws_for_libplacebo(prefix: &Path, scene: &Path, expected: &[u8]) {
    let host = prefix.join("libplacebo");
    let words = flags(prefix, &["--cflags", "--libs", "ashfall", "libplacebo"]);
    compile(&["cc", "-std=c99"], "tests/binary/capi/libplacebo.c", &host, &words);
    draws(&host, prefix, scene, expected);
    let mut liar = Command::new(&host);
    liar.args([scene, &prefix.join("lie"), Path::new("lie")]);
    let output = liar.env("LD_LIBRARY_PATH", prefix.join("lib")).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.code() == Some(2) && said.contains("InvalidImageLayout"),
        "{said}"
    );
}

/// Names that a library exports.
fn symbols(library: &Path) -> Vec<String> {
    let listed = run(Command::new("nm").args(["-D", "--defined-only"]).arg(library));
    let names = listed.lines().filter_map(|line| line.split(' ').next_back());
    names.map(str::to_owned).collect()
}

#[test]
#[cfg(target_os = "linux")]
fn hosts_in_c_draw_the_bits_of_rust_by_either_library() {
    let folder = tempfile::tempdir().unwrap();
    let prefix = folder.path();
    install(prefix);

    let mut scene = crate::common::scenes::gentle(3, 400, 320, 240, 3).splats;
    scene.filter = ScreenFilter::Mip;
    let path = prefix.join("scene.ply");
    write(&path, &scene).unwrap();
    let expected = expected(&path);

    let shared = flags(prefix, &["--cflags", "--libs", "ashfall"]);
    let mut archive = flags(prefix, &["--cflags", "--libs", "--static", "ashfall"]);
    let library = prefix.join("lib/libashfall.a").to_string_lossy().into_owned();
    archive
        .iter_mut()
        .filter(|word| *word == "-lashfall")
        .for_each(|word| word.clone_from(&library));
    let c: &[&str] = &["cc", "-std=c99"];
    let cpp: &[&str] = &["c++", "-x", "c++", "-std=c++11"];
    for (name, compiler, flags) in [
        ("c_shared", c, &shared),
        ("cpp_shared", cpp, &shared),
        ("c_static", c, &archive),
    ] {
        let host = prefix.join(name);
        compile(compiler, "examples/host.c", &host, flags);
        draws(&host, prefix, &path, &expected);
    }
    draws_for_libplacebo(prefix, &path, &expected);
    let refusals = prefix.join("refusals");
    compile(c, "tests/binary/capi/refusals.c", &refusals, &shared);
    run(Command::new(&refusals).env("LD_LIBRARY_PATH", prefix.join("lib")));

    let build = prefix.join("build");
    let mut configure = Command::new("cmake");
    configure
        .arg("-S")
        .arg(format!("{ROOT}/tests/binary/capi"))
        .arg("-B")
        .arg(&build);
    run(configure.arg(format!("-DCMAKE_PREFIX_PATH={}", prefix.display())));
    run(Command::new("cmake").arg("--build").arg(&build));
    for name in ["host_shared", "host_static"] {
        draws(&build.join(name), prefix, &path, &expected);
    }

    let library = prefix.join("lib/libashfall.so");
    let exported = symbols(&library);
    let header = std::fs::read_to_string(prefix.join("include/ashfall.h")).unwrap();
    for name in &exported {
        assert!(
            name.starts_with("ashfall_") && header.contains(&format!("{name}(")),
            "{name} is exported"
        );
    }
    let functions = header
        .lines()
        .filter(|line| line.starts_with("AshfallResult ashfall_"))
        .count();
    assert_eq!(exported.len(), functions + 2, "{exported:?}");
    let dynamic = run(Command::new("readelf").arg("-d").arg(&library));
    assert!(dynamic.contains("[libashfall.so.0.1]"), "{dynamic}");
}
