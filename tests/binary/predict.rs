//! `ashfall info --predict` from the command line.

use ashfall::lab::synth::{self, Kind, SynthOptions};
use serde_json::Value;
use std::process::{Command, Output};

fn run(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ashfall"));
    command.args(arguments).output().unwrap()
}

/// Standard output of a command that must succeed.
#[track_caller]
fn stdout(arguments: &[&str]) -> String {
    let output = run(arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}\n{errors}");
    String::from_utf8(output.stdout).unwrap()
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

#[test]
fn info_predicts_memory() {
    let of = |more: &[&str]| {
        let common = ["info", "--predict", "--json", "--splats", "50000"];
        json(&stdout(&[&common, more].concat()))
    };
    let bytes = |value: &Value, name: &str| {
        let buffers = value["buffers"].as_array().cloned().unwrap_or_default();
        let found = buffers.iter().find(|buffer| buffer["name"] == name);
        found.and_then(|buffer| buffer["bytes"].as_u64())
    };
    let drawn = of(&["--size", "480x270"]);
    assert_eq!(bytes(&drawn, "image"), Some(16 * 480 * 270));
    assert_eq!(bytes(&drawn, "moment1"), None);
    let size = ["--photos", "7", "--size", "480x270"];
    let trained = of(&[&size[..], &["--sh-degree", "0"]].concat());
    // Three planes of geometry and one of colour.
    assert_eq!(bytes(&trained, "moment1"), Some(50_000 * 16 * 4));
    assert_eq!(bytes(&trained, "photo"), Some(7 * 4 * 480 * 270));
    let sum = |value: &Value| -> u64 {
        let buffers = value["buffers"].as_array().cloned().unwrap_or_default();
        buffers.iter().filter_map(|b| b["bytes"].as_u64()).sum()
    };
    assert_eq!(trained["bytes"], sum(&trained));
    // Without memory for photographs, they are uploaded step by step.
    let streamed = of(&[&size[..], &["--set", "photo_share=0"]].concat());
    assert_eq!(bytes(&streamed, "photo ring"), Some(2 * 4 * 480 * 270));
    let folder = tempfile::tempdir().unwrap();
    let options = SynthOptions {
        views: 12,
        width: 45,
        height: 34,
        samples: 1,
        points: 300,
        ..SynthOptions::default()
    };
    let made = synth::scene(Kind::Demo).dataset(&options);
    synth::save(&made, folder.path()).unwrap();
    let data = folder.path().to_str().unwrap();
    let text = stdout(&["info", "--predict", data, "--test-every", "4"]);
    assert!(
        text.starts_with("training 300 splats of degree 3 on 9 photographs of 45×34"),
        "{text}"
    );
    assert!(text.contains("further 1,000"), "{text}");
    // Within a memory limit photographs are drawn in bands, which runs that draw whole ones refuse.
    let banded = stdout(&[
        "info",
        "--predict",
        data,
        "--size",
        "1000x4000",
        "--memory-limit",
        "200MiB",
    ]);
    assert!(
        banded.contains("of 1000×4000 in ") && !banded.contains("too little"),
        "{banded}"
    );
    let out = folder.path().join("out");
    let train = ["train", data, "--parsimony", "--memory-limit", "300KiB", "--out"];
    let refused = run(&[&train[..], &[out.to_str().unwrap()]].concat());
    let message = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!((refused.status.code(), out.exists()), (Some(1), false), "{message}");
    let last = message.lines().last().unwrap_or_default();
    assert!(
        last.contains("--parsimony draws whole photographs") && last.contains("45x34"),
        "{message}"
    );
    let ignored = run(&["info", "--iterations", "5"]);
    assert_eq!(ignored.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&ignored.stderr).contains("--predict"));
    let bad = run(&["info", "--predict", "--size", "big"]);
    assert_eq!(bad.status.code(), Some(2));
}
