//! Photographs without poses: refusals, and the course of a capture with a stand-in for COLMAP.

use super::*;

fn photographs(folder: &Path) -> PathBuf {
    let photos = folder.join("photos");
    fs::create_dir(&photos).unwrap();
    for entry in fs::read_dir(data().join("images")).unwrap() {
        let path = entry.unwrap().path();
        fs::copy(&path, photos.join(path.file_name().unwrap())).unwrap();
    }
    photos
}

/// The line of an error of a command with a search path.
fn refused(path: &Path, arguments: &[&str]) -> String {
    let output = ashfall(arguments).env("PATH", path).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{arguments:?}");
    String::from_utf8_lossy(&output.stderr)
        .lines()
        .last()
        .unwrap_or_default()
        .to_string()
}

#[test]
fn what_is_missing_is_named_with_its_package_and_nothing_is_written() {
    let folder = folder();
    let photos = photographs(folder.path());
    let (nothing, out) = (folder.path().join("nothing"), folder.path().join("out"));
    let capture = |source: &Path| refused(&nothing, &["capture", word(source), "--out", word(&out)]);
    let message = capture(&photos);
    assert!(
        message.contains("colmap is not installed: `apt install colmap`"),
        "{message}"
    );
    let message = capture(&folder.path().join("gone"));
    assert!(message.contains("gone"), "{message}");
    assert!(!out.exists());
    let tools = tools(folder.path(), "exit 0");
    let message = refused(
        &tools,
        &["capture", word(&photos.join("0000.png")), "--out", word(&out)],
    );
    assert!(
        message.contains("ffmpeg is not installed: `apt install ffmpeg`"),
        "{message}"
    );
    let message = refused(&tools, &["capture", word(&photos), "--out", word(&out)]);
    assert!(message.contains("does not answer -h as COLMAP does"), "{message}");
    fs::remove_file(photos.join("0003.png")).unwrap();
    fs::write(photos.join("0003.png"), "no picture").unwrap();
    let message = refused(&tools, &["capture", word(&photos), "--out", word(&out)]);
    assert!(message.contains("0003.png"), "{message}");
    let empty = folder.path().join("empty");
    fs::create_dir(&empty).unwrap();
    let message = refused(&tools, &["capture", word(&empty), "--out", word(&out)]);
    assert!(message.contains("has 0 photographs"), "{message}");
    assert!(!out.exists());
}

#[test]
fn training_on_photographs_without_poses_names_the_command() {
    let folder = folder();
    let photos = photographs(folder.path());
    let out = folder.path().join("run");
    for source in [photos.as_path(), photos.parent().unwrap()] {
        let message = error(&["train", word(source), "--out", word(&out)]);
        assert_eq!(message.contains("ashfall capture"), source == photos, "{message}");
    }
    assert!(!out.exists());
}

/// Folder with a script in COLMAP's place.
fn tools(folder: &Path, script: &str) -> PathBuf {
    use std::os::unix::fs::PermissionsExt;
    let tools = folder.join("tools");
    fs::create_dir_all(&tools).unwrap();
    let path = tools.join("colmap");
    fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    tools
}

#[test]
fn a_capture_goes_on_where_it_stopped_and_tells_what_has_no_pose() {
    let folder = folder();
    let photos = photographs(folder.path());
    let made = folder.path().join("made");
    let size = ["--photos", "12", "--size", "45x34", "--perturb", "none"];
    stdout(&[&["demo", "--data-only", "--out", word(&made)][..], &size].concat());
    let (model, out) = (made.join("data/sparse/0"), folder.path().join("out"));
    fs::copy(photos.join("0000.png"), photos.join("extra.png")).unwrap();
    // The mapper fails the first time, and then has a small model before the large one.
    let script = format!(
        "PATH=/usr/bin:/bin\ncase $1 in\n-h) echo 'COLMAP 3.8 -- stand-in';;\nmapper)\n  \
         [ -e {failed} ] || {{ touch {failed}; echo 'no luck' >&2; exit 1; }}\n  \
         mkdir -p {out}/sparse/0 && cp {model}/* {out}/sparse/0\n  echo 'Registering image #1 (1)';;\n\
         *) echo \"Processed file [1/13] $*\";;\nesac",
        failed = folder.path().join("failed").display(),
        out = out.display(),
        model = model.display(),
    );
    let tools = tools(folder.path(), &script);
    let capture = ["capture", word(&photos), "--out", word(&out)];
    let message = refused(&tools, &capture);
    assert!(
        message.contains("colmap mapper failed") && message.contains("no luck"),
        "{message}"
    );
    let output = ashfall(&capture).env("PATH", &tools).output().unwrap();
    let (text, lines) = (
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr),
    );
    assert_eq!(output.status.code(), Some(0), "{lines}");
    assert!(text.contains("12 of 13 photographs have poses"), "{text}");
    assert!(text.contains("without: extra.png (likely too little overlap"), "{text}");
    assert!(
        lines.contains("colmap mapper") && !lines.contains("feature_extractor"),
        "only the rest: {lines}"
    );
    let log = fs::read_to_string(out.join("capture.log")).unwrap();
    assert!(
        log.contains("--SiftExtraction.use_gpu 0") && log.contains("exhaustive_matcher"),
        "{log}"
    );
    assert!(stdout(&["info", word(&out)]).contains("views:    12"));
    // Again: nothing left to do. Other options: all anew, if asked for.
    let again = ashfall(&capture).env("PATH", &tools).output().unwrap();
    assert!(!String::from_utf8_lossy(&again.stderr).contains('$'));
    let other = [&capture[..], &["--pairs", "neighbours"]].concat();
    let message = refused(&tools, &other);
    assert!(message.contains("--overwrite begins anew"), "{message}");
    let other = [&other[..], &["--overwrite", "--json"]].concat();
    let output = ashfall(&other).env("PATH", &tools).output().unwrap();
    let events: Vec<Value> = String::from_utf8_lossy(&output.stdout).lines().map(json).collect();
    assert_eq!(events.iter().filter(|event| event["event"] == "command").count(), 3);
    assert_eq!(events.last().map(|event| event["registered"].clone()), Some(12.into()));
    let foreign = made.join("data");
    let message = refused(&tools, &["capture", word(&photos), "--out", word(&foreign)]);
    assert!(message.contains("not of `ashfall capture`"), "{message}");
}
