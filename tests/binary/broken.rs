//! Malformed and unusual input: the required outcome of every case of the corpus.
//!
//! The corpus lies in `$ASHFALL_DATA/broken`, a folder per case. Its absence is the only reason to pass without it, and
//! is printed. A case without a line here fails, and so does a line without a case.

use ashfall::io::{dataset, obj, photo, splats};
use ashfall::scene::{Dataset, PhotoSource};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// Required outcome of a case.
enum Expect {
    /// Loads this number of views or splats, without a warning.
    Clean(usize),
    /// Loads this number of views or splats; a warning contains these words.
    Warns(usize, &'static [&'static str]),
    /// An error that names a file and contains these words.
    Fails(&'static [&'static str]),
}
use Expect::{Clean, Fails, Warns};

#[rustfmt::skip]
const CASES: &[(&str, Expect)] = &[
    ("00_good_colmap", Clean(4)),
    ("00_good_ply", Clean(100)),
    ("00_good_sog", Clean(1873)),
    ("00_good_transforms", Warns(4, &["no points"])),
    ("colmap_absolute_image_path", Fails(&["images.bin", "/etc/hostname", "refused"])),
    ("colmap_all_images_missing", Fails(&["4 of 4 photographs are missing", "0003.jpg"])),
    ("colmap_bad_track_reference", Clean(4)),
    ("colmap_cameras_truncated", Fails(&["cameras.bin", "byte"])),
    ("colmap_distorted_opencv", Clean(4)),
    ("colmap_duplicate_image_name", Fails(&["two views have the name"])),
    ("colmap_empty_bin_files", Fails(&["cameras.bin", "the file ends inside the number of cameras"])),
    ("colmap_huge_size_camera", Fails(&["cameras.bin", "8589934592 x 8589934592"])),
    ("colmap_image_1x1", Fails(&[".jpg", "1 x 1 pixels"])),
    ("colmap_image_empty", Fails(&[".jpg", "empty"])),
    ("colmap_image_is_text", Fails(&[".jpg", "neither a PNG nor a JPEG"])),
    ("colmap_image_size_differs", Fails(&[".jpg", "96 x 40", "aspect ratio", "48 x 85"])),
    ("colmap_image_truncated", Fails(&[".jpg", "cut short"])),
    ("colmap_images_half_size", Warns(4, &["4 of 4 photographs have another size", "24 x", "scaled"])),
    ("colmap_images_huge_count", Fails(&["images.bin", "1152921504606846976 images"])),
    ("colmap_images_name_unterminated", Fails(&["images.bin", "name of an image"])),
    ("colmap_images_truncated", Fails(&["images.bin", "byte"])),
    ("colmap_missing_camera_id", Fails(&["images.bin", "camera 7"])),
    ("colmap_missing_image", Warns(3, &["1 of 4 photographs are missing", "left out"])),
    ("colmap_nan_focal", Fails(&["cameras.bin", "focal", "NaN"])),
    ("colmap_nan_pose", Fails(&["images.bin", "translation", "not finite"])),
    ("colmap_negative_camera_model", Fails(&["cameras.bin", "model id -1"])),
    ("colmap_negative_focal", Fails(&["cameras.bin", "focal", "not positive"])),
    ("colmap_no_sparse_folder", Fails(&["no data set", "sparse/0/cameras.bin", "transforms.json"])),
    ("colmap_not_utf8_name", Fails(&["images.bin", "not UTF-8"])),
    ("colmap_one_image_only", Fails(&["no view is left to train on"])),
    ("colmap_path_traversal", Fails(&["images.bin", "refused", "stay inside"])),
    ("colmap_points_all_nan", Warns(4, &["80 of 80 points are not finite", "no points"])),
    ("colmap_points_huge_count", Fails(&["points3D.bin", "1099511627776 points"])),
    ("colmap_points_nan", Warns(4, &["6 of 80 points are not finite"])),
    ("colmap_points_truncated", Fails(&["points3D.bin", "byte"])),
    ("colmap_points_zero", Warns(4, &["no points"])),
    ("colmap_sparse_is_file", Fails(&["no data set", "sparse is a file"])),
    ("colmap_text_bad_number", Fails(&["cameras.txt", "line ", "\"abc\""])),
    ("colmap_text_missing_params", Fails(&["cameras.txt", "line ", "parameter 4 of the 4 of PINHOLE"])),
    ("colmap_text_short_line", Fails(&["images.txt", "line ", "ends before the translation"])),
    ("colmap_track_huge_length", Fails(&["points3D.bin", "1125899906842624 track elements"])),
    ("colmap_unknown_camera_model", Fails(&["cameras.bin", "model id 42"])),
    ("colmap_unsupported_model_thin_prism", Clean(4)),
    ("colmap_zero_focal", Fails(&["cameras.bin", "focal", "not positive"])),
    ("colmap_zero_images", Fails(&["images.bin", "no images"])),
    ("colmap_zero_quaternion", Fails(&["images.bin", "rotation", "no quaternion"])),
    ("colmap_zero_size_camera", Fails(&["cameras.bin", "0 x 0"])),
    ("compressed_ply_few_chunks", Fails(&["compressed_ply_few_chunks/scene.", "chunks of 256 splats, but"])),
    ("compressed_ply_truncated", Fails(&["compressed_ply_truncated/scene.", "rows"])),
    ("obj_bad_index", Fails(&["mesh.obj", "line 3", "no finite number"])),
    ("obj_truncated", Fails(&["mesh.obj", "line "])),
    ("ok_colmap_image_cmyk", Clean(4)),
    ("ok_colmap_image_grayscale", Clean(4)),
    ("ok_colmap_text", Clean(4)),
    ("ok_ply_comments_extra", Clean(100)),
    ("ok_ply_crlf_header", Clean(100)),
    ("ok_ply_double", Clean(40)),
    ("ok_ply_sh0", Clean(100)),
    ("ply_ascii_bad_number", Fails(&["scene.ply", "line ", "\"zero\""])),
    ("ply_ascii_short_line", Fails(&["scene.ply", "line ", "10 numbers"])),
    ("ply_count_overflow", Fails(&["scene.ply", "18446744073709551616"])),
    ("ply_count_too_large", Fails(&["scene.ply", "140 rows"])),
    ("ply_count_too_small", Warns(60, &["bytes after the last vertex were ignored"])),
    ("ply_count_wraps", Fails(&["scene.ply", "74382032555280451 rows"])),
    ("ply_duplicate_property", Fails(&["scene.ply", "\"x\"", "twice"])),
    ("ply_empty_file", Fails(&["scene.ply", "empty"])),
    ("ply_endless_header", Fails(&["scene.ply", "no end_header"])),
    ("ply_extreme_values", Clean(100)),
    ("ply_f_rest_count_7", Fails(&["scene.ply", "7 f_rest"])),
    ("ply_header_only_magic", Fails(&["scene.ply", "no end_header"])),
    ("ply_huge_count", Fails(&["scene.ply", "1099511627776 rows"])),
    ("ply_list_property", Fails(&["scene.ply", "is a list"])),
    ("ply_mesh_not_splats", Fails(&["scene.ply", "no splats"])),
    ("ply_missing_opacity", Fails(&["scene.ply", "opacity"])),
    ("ply_missing_rot_3", Fails(&["scene.ply", "rot_3"])),
    ("ply_missing_x", Fails(&["scene.ply", "properties x are missing"])),
    ("ply_nan_inf", Warns(94, &["6 of 100 splats", "not finite"])),
    ("ply_negative_count", Fails(&["scene.ply", "\"-5\""])),
    ("ply_no_end_header", Fails(&["scene.ply", "header"])),
    ("ply_not_ply", Fails(&["scene.ply", "not a PLY file"])),
    ("ply_truncated_mid_vertex", Fails(&["scene.ply", "100 rows"])),
    ("ply_unknown_format", Fails(&["scene.ply", "binary_middle_endian"])),
    ("ply_unknown_type", Fails(&["scene.ply", "quadruple"])),
    ("ply_zero_quaternion", Warns(100, &["10 of 100 splats", "no rotation"])),
    ("ply_zero_vertex", Warns(0, &["holds no splats"])),
    ("sog_count_too_large", Fails(&["scene.sog", "meta.json", "10000000 splats"])),
    ("sog_missing_texture", Fails(&["scene.sog", "no \"means_u.webp\""])),
    ("sog_path_traversal", Fails(&["scene.sog", "../../../../etc/hostname", "stay inside"])),
    ("sog_short_codebook", Fails(&["scene.sog", "scales.webp", "codebook of 5 values"])),
    ("sog_truncated_zip", Fails(&["scene.sog", "no complete ZIP archive"])),
    ("sog_unknown_version", Fails(&["scene.sog", "meta.json", "version is 99"])),
    ("splat_empty", Warns(0, &["holds no splats"])),
    ("splat_length_not_multiple_of_32", Warns(100, &["17 bytes"])),
    ("splat_nan_values", Warns(97, &["3 of 100 splats", "dropped"])),
    ("spz_bad_degree", Fails(&["scene.spz", "SH degree 9"])),
    ("spz_bad_fractional_bits", Fails(&["scene.spz", "200 fractional bits"])),
    ("spz_gzip_bomb", Warns(10, &["contents after the last splat were ignored"])),
    ("spz_huge_count", Fails(&["scene.spz", "4294967295 splats of 43 bytes", "can hold 206400 bytes"])),
    ("spz_truncated_gzip", Fails(&["scene.spz", "damaged or cut off"])),
    ("spz_unknown_version", Fails(&["scene.spz", "SPZ version 77"])),
    ("spz_v4_truncated", Fails(&["scene.spz", "positions of 50672 compressed bytes"])),
    ("spz_wrong_magic", Fails(&["scene.spz", "\"XXXX\" in place of \"NGSP\""])),
    ("transforms_deep_nesting", Fails(&["transforms.json", "JSON"])),
    ("transforms_empty_file", Fails(&["transforms.json", "JSON"])),
    ("transforms_empty_frames", Fails(&["transforms.json", "\"frames\" is empty"])),
    ("transforms_frames_wrong_type", Fails(&["transforms.json", "\"frames\" is not a list"])),
    ("transforms_missing_file_path", Fails(&["transforms.json", "frame 1", "file_path"])),
    ("transforms_missing_focal", Fails(&["transforms.json", "fl_x", "camera_angle_x"])),
    ("transforms_missing_frames", Fails(&["transforms.json", "no \"frames\""])),
    ("transforms_missing_image", Warns(3, &["1 of 4 photographs are missing"])),
    ("transforms_missing_matrix", Fails(&["transforms.json", "frame 1", "transform_matrix"])),
    ("transforms_nan_literal", Fails(&["transforms.json", "JSON"])),
    ("transforms_null_entry", Fails(&["transforms.json", "frame 1", "null"])),
    ("transforms_overflow_number", Fails(&["transforms.json", "JSON", "out of range"])),
    ("transforms_scaled_rotation", Warns(4, &["1 rotations are scaled", "frame 1"])),
    ("transforms_singular_matrix", Fails(&["transforms.json", "frame 1", "singular"])),
    ("transforms_string_focal", Fails(&["transforms.json", "fl_x", "a text"])),
    ("transforms_top_level_list", Fails(&["transforms.json", "top level", "a list"])),
    ("transforms_truncated_json", Fails(&["transforms.json", "JSON"])),
    ("transforms_unsupported_model", Fails(&["transforms.json", "SPHERICAL_PANO"])),
    ("transforms_wrong_matrix_shape", Fails(&["transforms.json", "frame 1", "4 rows"])),
    ("transforms_zero_focal", Fails(&["transforms.json", "focal", "not positive"])),
];

/// The corpus; `None`, with a printed notice, if there is no data.
fn corpus() -> Option<PathBuf> {
    let Some(data) = std::env::var_os("ASHFALL_DATA") else {
        println!("ASHFALL_DATA is not set: the corpus of broken files is not tested");
        return None;
    };
    let folder = Path::new(&data).join("broken");
    assert!(folder.is_dir(), "{} is not there", folder.display());
    Some(folder)
}

/// Number of loaded items, and the warnings.
type Outcome = ashfall::Result<(usize, Vec<String>)>;

/// The file of a case with one of these names.
fn file_of(case: &Path, names: &[&str]) -> Option<PathBuf> {
    names.iter().map(|name| case.join(name)).find(|path| path.is_file())
}

const SCENES: &[&str] = &[
    "scene.ply",
    "scene.compressed.ply",
    "scene.splat",
    "scene.spz",
    "scene.sog",
];

fn load(case: &Path) -> Outcome {
    if let Some(path) = file_of(case, SCENES) {
        let loaded = splats::read(&path)?;
        let all = loaded.splats.mean.as_flattened().iter();
        let all = all.chain(loaded.splats.quaternion.as_flattened());
        let all = all.chain(loaded.splats.log_scale.as_flattened());
        let mut all = all.chain(&loaded.splats.opacity_logit).chain(&loaded.splats.sh);
        assert!(all.all(|v| v.is_finite()), "every number is finite");
        return Ok((loaded.splats.len(), loaded.warnings));
    }
    if let Some(mesh) = file_of(case, &["mesh.obj"]) {
        return Ok((obj::read(&mesh)?.positions.len(), Vec::new()));
    }
    let dataset = dataset::open(case, &dataset::OpenOptions::default())?;
    check_photos(&dataset)?;
    Ok((dataset.views.len(), dataset.warnings))
}

fn check_photos(dataset: &Dataset) -> ashfall::Result<()> {
    for view in &dataset.views {
        let photo = photo::load(view)?;
        let size = (view.camera.width, view.camera.height);
        assert_eq!((photo.width, photo.height), size, "{}", view.name);
        assert_eq!(photo.rgba.len(), (size.0 * size.1) as usize);
        assert!(view.camera.position.is_finite() && view.camera.rotation.is_finite());
        assert!(matches!(view.photo, PhotoSource::File { .. }));
    }
    let mut numbers = dataset.points.iter().flat_map(|p| p.position);
    assert!(numbers.all(f64::is_finite), "every point is finite");
    Ok(())
}

fn judge(expect: &Expect, outcome: &Outcome) -> Result<(), String> {
    let holds = |text: &str, words: &[&str]| {
        let missing: Vec<_> = words.iter().filter(|w| !text.contains(**w)).collect();
        let said = format!("{missing:?} not in: {text}");
        if missing.is_empty() { Ok(()) } else { Err(said) }
    };
    match (expect, outcome) {
        (Clean(count), Ok((n, warnings))) if n == count && warnings.is_empty() => Ok(()),
        (Warns(count, words), Ok((n, warnings))) if n == count => holds(&warnings.join("\n"), words),
        (Fails(words), Err(error)) => {
            let text = error.to_string();
            holds(&text, words)?;
            holds(&text, &["broken"])?;
            if text.lines().count() == 1 {
                Ok(())
            } else {
                Err(format!("several lines: {text}"))
            }
        }
        (_, Ok((n, warnings))) => Err(format!("loaded {n}, warnings {warnings:?}")),
        (_, Err(error)) => Err(format!("failed: {error}")),
    }
}

#[test]
fn every_case_ends_as_expected() {
    let Some(corpus) = corpus() else { return };
    let mut there: BTreeSet<String> = std::fs::read_dir(&corpus)
        .unwrap()
        .map(|entry| entry.unwrap())
        .filter(|entry| entry.path().is_dir())
        .map(|entry| entry.file_name().into_string().unwrap())
        .collect();
    let mut faults = Vec::new();
    for (case, expect) in CASES {
        if !there.remove(*case) {
            faults.push(format!("{case}: there is no such folder"));
            continue;
        }
        if let Err(what) = judge(expect, &load(&corpus.join(case))) {
            faults.push(format!("{case}: {what}"));
        }
    }
    faults.extend(there.iter().map(|case| format!("{case}: nothing is expected of it")));
    assert!(faults.is_empty(), "{} cases:\n{}", faults.len(), faults.join("\n"));
}

/// Runs the binary on a case: scenes are rendered, meshes and data sets trained on.
fn run(corpus: &Path, case: &Path, out: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ashfall"));
    command.stdin(Stdio::null());
    if let Some(scene) = file_of(case, SCENES) {
        let cameras = corpus.join("00_good_transforms");
        command
            .arg("render")
            .arg(scene)
            .arg("--cameras")
            .arg(cameras)
            .args(["--split", "test"]);
    } else {
        command
            .arg("train")
            .args(["--iterations", "1", "--set", "sh_degree=0", "--set"]);
        command.arg("init.random_count=200");
        match file_of(case, &["mesh.obj"]) {
            Some(mesh) => command.arg(corpus.join("00_good_colmap")).arg("--init").arg(mesh),
            None => command.arg(case),
        };
    }
    command.arg("--validate").arg("--out").arg(out).output().unwrap()
}

/// Compares the end of the binary's run with the required outcome; the error is the difference.
fn judge_run(expect: &Expect, output: &Output, out: &Path) -> Result<(), String> {
    let said = String::from_utf8_lossy(&output.stderr);
    let (code, written) = (output.status.code(), out.exists());
    let fails = matches!(expect, Fails(_));
    let sound = match fails {
        true => code == Some(1) && said.contains("error: ") && !written,
        false => code == Some(0) && written,
    };
    if sound && !said.contains("panicked") {
        return Ok(());
    }
    Err(format!("code {code:?}, output written: {written}, said: {said}"))
}

#[test]
fn the_binary_refuses_every_broken_case_and_leaves_nothing() {
    let Some(corpus) = corpus() else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut faults = Vec::new();
    for (case, expect) in CASES {
        let out = folder.path().join(case);
        let output = run(&corpus, &corpus.join(case), &out);
        if let Err(what) = judge_run(expect, &output, &out) {
            faults.push(format!("{case}: {what}"));
        }
    }
    assert!(faults.is_empty(), "{} cases:\n{}", faults.len(), faults.join("\n"));
}

#[test]
fn a_wrong_expectation_is_noticed() {
    let fine: Outcome = Ok((3, vec!["a word".into()]));
    let failed: Outcome = Err(ashfall::Error::file("broken/x", "a word"));
    assert!(judge(&Warns(3, &["word"]), &fine).is_ok());
    assert!(judge(&Clean(3), &fine).is_err(), "a warning is noticed");
    assert!(judge(&Warns(4, &["word"]), &fine).is_err(), "the count is compared");
    assert!(judge(&Warns(3, &["other"]), &fine).is_err(), "the words are compared");
    assert!(judge(&Fails(&["word"]), &fine).is_err(), "success is no failure");
    assert!(judge(&Fails(&["word"]), &failed).is_ok());
    assert!(judge(&Fails(&["other"]), &failed).is_err(), "the words are compared");
    assert!(judge(&Clean(0), &failed).is_err(), "failure is no success");
}
