//! Section 10b of the catalogue: device-dependent arithmetic and guarantees. Lost devices and exhausted memory are
//! tested in tests/device/faults.
//!
//! * 112: no sum here is compensated, so reassociation has no effect; expressions with a fixed order are `precise`.

use crate::common::scenes;
use crate::stability::lab::{Lesson, apart, difference, image_bound, lab, percentile, rows, same, within};
use crate::stability::props::{OPAQUE, Prop, place, stage, with_copy};
use ashfall::kernels::KERNELS;
use ashfall::reference::loss::Target;
use ashfall::reference::{Options, loss_gradient};
use ashfall::shader::Requirement;
use std::fs;
use std::path::{Path, PathBuf};

/// The text of every shader, without comments.
fn shaders() -> Vec<(PathBuf, String)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("glsl");
    let mut files = Vec::new();
    for folder in [folder.join("shared"), folder] {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            // Baselines follow other implementations; only benchmarks run them.
            let baseline = path
                .file_name()
                .is_some_and(|n| n.to_string_lossy().starts_with("baseline_16x16"));
            if path.is_file() && !baseline {
                let text = fs::read_to_string(&path).unwrap();
                let code = text.lines().map(|line| line.split("//").next().unwrap_or_default());
                files.push((path.clone(), code.collect::<Vec<_>>().join("\n")));
            }
        }
    }
    assert!(files.len() > 25, "{} shaders", files.len());
    files
}

/// Whole steps and frames in sequence under synchronisation validation: no message.
#[test]
fn f108_synchronisation() {
    let lab = lab();
    let scene = scenes::hard(1008, 54, 40, 33, 3);
    let lesson = Lesson::photo(&scene, 0.2);
    for _ in 0..3 {
        lab.step(&scene, &lesson);
        lab.draw(&scene);
    }
    // Dropping the lab checks the validation messages; tests/device/embed checks that a wrong image state is reported.
    assert_eq!(lab.gpu().validation_messages(), Vec::<String>::new());
}

/// Fresh memory is filled with NaNs here, so that reads of unwritten memory are found.
#[test]
fn f109_fresh_memory_is_poisoned() {
    let lab = lab();
    for len in [1usize, 63, 4096, 100_003] {
        let fresh = lab.gpu().buffer::<u32>("fresh", len).unwrap();
        let words = lab.gpu().download(&fresh, 0..len).unwrap();
        assert!(words.iter().all(|&w| w == 0x7FC0_DEAD), "{len} words");
    }
}

/// Every kernel has a variant without optional device features.
#[test]
fn f110_portable_forms() {
    // The baseline_16x16 kernels are run by benchmarks only.
    for info in KERNELS.iter().filter(|info| !info.kernel.starts_with("baseline_16x16")) {
        let base = KERNELS.iter().find(|k| k.kernel == info.kernel && k.variant.is_empty());
        let base = base.unwrap_or_else(|| panic!("{} has no portable form", info.kernel));
        for requirement in base.requirements {
            let is_allowed = *requirement == Requirement::SubgroupBasic;
            assert!(is_allowed, "{} needs {requirement:?}", base.kernel);
        }
    }
}

/// Atomic additions are of integer counts only, never of floats.
#[test]
fn f111_no_float_atomics() {
    let mut seen = 0;
    for (path, code) in shaders() {
        for (at, _) in code.match_indices("atomic") {
            let call: String = code[at..].chars().take_while(|&c| c != ';').collect();
            seen += 1;
            let integers = ["counts[", "digit", "shared_count", "table"];
            assert!(
                integers.iter().any(|name| call.contains(name)),
                "{}: {call}",
                path.display()
            );
        }
        assert!(!code.contains("shader_atomic_float"), "{}", path.display());
    }
    assert!(seen > 0, "no atomic at all: this test looks at the wrong files");
}

/// Results do not depend on numbers that a device may flush to zero.
#[test]
fn f113_denormals() {
    let lab = lab();
    let scene = scenes::gentle(1013, 12, 33, 25, 0);
    let tiny = |log: f32| with_copy(&scene, |splats, i| splats.log_scale[i] = [log; 3]);
    // exp(−80) is normal, exp(−95) subnormal or zero: both are far less than a pixel.
    assert!(
        same(&lab.draw(&tiny(-80.0)), &lab.draw(&tiny(-95.0))),
        "a scale of 1e-35 shows"
    );
    let dim = |value: f32| {
        with_copy(&scene, |splats, i| {
            let stride = splats.sh_stride();
            splats.sh[i * stride..].fill(value);
        })
    };
    assert!(
        same(&lab.draw(&dim(1e-40)), &lab.draw(&dim(0.0))),
        "a colour of 1e-40 shows"
    );
    // The squares of a quaternion of 1e-20 underflow.
    let short = with_copy(&scene, |splats, i| {
        splats.quaternion[i] = splats.quaternion[i].map(|q| q * 2f32.powi(-55))
    });
    let usual = with_copy(&scene, |_, _| {});
    assert!(same(&lab.draw(&short), &lab.draw(&usual)));
}

/// At the alpha threshold, bounds from a logarithm are wide enough.
#[test]
fn f114_bounds_at_the_cut() {
    let lab = lab();
    for sigma in [0.1, 5.0, 200.0] {
        for excess in [1e-3, 1e-4, 1e-5] {
            let mut scene = stage(40, 33);
            scene.camera.center = glam::DVec2::new(20.5, 16.5);
            let opacity: f64 = (1.0 + excess) / 255.0;
            let logit = (opacity / (1.0 - opacity)).ln() as f32;
            place(&mut scene, &Prop::ball([20.5, 16.5], sigma, logit));
            let image = lab.draw(&scene);
            assert!(
                image.transmittance[16 * 40 + 20] < 1.0,
                "σ {sigma}, {excess:e} over the cut: not drawn"
            );
            let error = apart(&scene, &image, 1e-5);
            within(
                "rasterize",
                "114",
                &format!("σ {sigma} px, {excess:.0e} over the cut"),
                error,
                image_bound(40, 0.55, 1, 1.0),
            );
        }
    }
    let mut opaque = stage(40, 33);
    place(&mut opaque, &Prop::ball([20.0, 16.0], 3.0, OPAQUE));
    assert!(difference(&lab.draw(&opaque), &lab.draw(&stage(40, 33))) > 0.9);
}

/// Every gradient of a difficult scene, through compiler and driver, against the exact one.
#[test]
fn f115_parity_of_every_gradient() {
    let lab = lab();
    let groups = [
        ("mean", 0..3),
        ("quaternion", 3..7),
        ("log-scale", 7..10),
        ("opacity", 10..11),
        ("harmonics", 11..59),
    ];
    let scene = scenes::hard(1015, 90, 56, 44, 3);
    let lesson = Lesson::photo(&scene, 0.2);
    let stepped = lab.step(&scene, &lesson);
    let options = Options {
        near: f64::from(stepped.near),
        ..scene.options
    };
    let photo = scenes::photo_values(&scenes::photo(7, 56, 44));
    let target = Target {
        lambda: f64::from(lesson.lambda),
        ..Target::new(56, &photo)
    };
    let exact = rows(&loss_gradient(&scene.splats, &scene.camera, &options, &target).d_splats);
    for (name, range) in groups {
        let square: f64 = exact.iter().flat_map(|row| &row[range.clone()]).map(|g| g * g).sum();
        let floor = 0.01 * (square / (90 * range.len()) as f64).sqrt();
        let mut errors = Vec::new();
        for (i, row) in exact.iter().enumerate() {
            for (found, exact) in stepped.row(i)[range.clone()].iter().zip(&row[range.clone()]) {
                errors.push((found - exact).abs() / exact.abs().max(floor));
            }
        }
        // Bound of the engine: relative to the gradient, or to 1 % of its group where the gradient is less.
        within(
            "gradient",
            "115",
            &format!("{name}, 99 %"),
            percentile(&mut errors, 0.99),
            1e-3,
        );
    }
}
