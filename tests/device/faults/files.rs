//! Files as other programs write them, longer than the catalogue's small tests in `tests/device/stability`; arbitrary
//! bytes are tested in `tests/slow/fuzz`, a corpus of damaged files in `tests/binary/broken.rs`.

use ashfall::io::colmap::{self, Files};
use ashfall::io::{LoadedSplats, Source, ply};
use std::path::Path;

fn splats(text: &[u8]) -> ashfall::Result<LoadedSplats> {
    ply::read(Source::bytes(Path::new("scene.ply"), text))
}

const NAMES: &str = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";

fn text(names: &str, kind: &str, rows: &[[f32; 14]]) -> String {
    let properties: String = names
        .split(' ')
        .map(|name| format!("property {kind} {name}\n"))
        .collect();
    let row = |row: &[f32; 14]| row.map(|v| v.to_string()).join(" ") + "\n";
    let body: String = rows.iter().map(row).collect();
    let count = rows.len();
    format!("ply\nformat ascii 1.0\nelement vertex {count}\n{properties}end_header\n{body}")
}

/// A row with a NaN is dropped alone; the warning gives its number.
#[test]
fn f097_a_row_that_is_none_is_dropped_alone() {
    let row = |first: f32| {
        [
            first, 2.0, 3.0, 0.1, 0.2, 0.3, 0.5, -1.0, -2.0, -3.0, 1.0, 0.0, 0.0, 0.0,
        ]
    };
    let file = text(NAMES, "float", &[row(1.0), row(f32::NAN), row(3.0)]);
    let loaded = splats(file.as_bytes()).unwrap();
    let first: Vec<f32> = loaded.splats.mean.iter().map(|mean| mean[0]).collect();
    assert_eq!(first, [1.0, 3.0]);
    assert!(loaded.warnings[0].contains("1 of 3 splats"), "{:?}", loaded.warnings);
    assert!(
        loaded.warnings[0].contains("number 1 (counted from 0)"),
        "{:?}",
        loaded.warnings
    );
    // Any order of the properties, any number type, and Windows line ends.
    let swapped = NAMES.replace("x y z", "z y x");
    let file = text(&swapped, "double", &[row(1.0)]).replace('\n', "\r\n");
    assert_eq!(splats(file.as_bytes()).unwrap().splats.mean, [[3.0, 2.0, 1.0]]);
    // A file truncated anywhere in its rows is an error, never fewer splats.
    let file = text(NAMES, "float", &[row(1.0), row(2.0)]);
    let second = file.trim_end().rfind('\n').unwrap();
    for length in 0..second {
        assert!(splats(&file.as_bytes()[..length]).is_err(), "{length} bytes");
    }
}

/// Images without 2D points have an empty line, which is neither the end nor a blank line to skip.
#[test]
fn f098_empty_lines_of_points_do_not_shift_images() {
    let read = |images: &str, points: &str| {
        let source = |name: &'static str, bytes| Source::bytes(Path::new(name), bytes);
        let files = Files {
            binary: false,
            cameras: source("cameras.txt", b"7 PINHOLE 8 6 9 9 4 3\n"),
            images: source("images.txt", images.as_bytes()),
            points: Some(source("points3D.txt", points.as_bytes())),
            rigs: None,
        };
        colmap::read_files(&files, Path::new("images")).unwrap()
    };
    let pose = "1 0 0 0 0 0 1 7";
    let images = format!("1 {pose} a b.png\n\n5 {pose} c.png\n1 2 -1\n9 {pose} d.png\n");
    let listing = read(&images, "3 0 0 1 255 0 0 0.1\n1 -nan(ind) 0 1 0 0 0 0.1\n");
    let names: Vec<&str> = listing.views.iter().map(|view| view.name.as_str()).collect();
    assert_eq!(names, ["a b.png", "c.png", "d.png"]);
    // Points are sorted by id; a NaN position is kept for the data set to count.
    assert!(listing.points[0].position[0].is_nan());
    assert_eq!(listing.points[1].color, [1.0, 0.0, 0.0]);
    assert_eq!(read(&images, "").points, []);
}

/// Atomic float sums differ from run to run even on a software device: no kernel that renders or trains has any. The
/// baseline_16x16 kernels do, for comparison only, and here show that the check finds them.
#[test]
fn f111_no_kernel_adds_floats_by_atomics() {
    let adds = |info: &&&ashfall::shader::KernelInfo| {
        let mut words = info.spirv[5..].iter();
        let mut found = false;
        while let Some(&word) = words.next() {
            // OpAtomicFAddEXT, of SPV_EXT_shader_atomic_float_add.
            found |= word & 0xffff == 6035;
            let operands = (word >> 16).max(1) - 1;
            words.by_ref().take(operands as usize).for_each(drop);
        }
        found
    };
    let mut names = ashfall::kernels::KERNELS.iter().filter(adds).map(|info| info.kernel);
    assert_eq!(names.next(), Some("baseline_16x16_backward"));
    assert_eq!(names.next(), None);
}
