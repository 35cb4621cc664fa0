//! Large photographs, trained coarse to fine.

use super::*;

#[test]
fn large_photographs_are_reduced_for_half_of_the_run_unless_told_otherwise() {
    let folder = folder();
    let made = folder.path().join("made");
    // 65,536 pixels and more are left of half the width and height.
    let size = ["--photos", "3", "--size", "600x450"];
    stdout(&[&["demo", "--data-only", "--out", word(&made)], &size[..]].concat());
    let data = made.join("data");
    let config = |name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let short = ["train", word(&data), "--out", word(&out), "--iterations", "4"];
        let output = run(&[&short[..], more].concat());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        let config = read_json(&out.join("report.json"))["config"].clone();
        (
            [config["coarse_until"].as_u64(), config["coarse_halvings"].as_u64()],
            said,
        )
    };
    let (usual, said) = config("usual", &[]);
    assert_eq!(usual, [Some(2), Some(1)]);
    assert!(
        said.contains("start at 1/2 of their width and height, and are whole from iteration 3 on"),
        "{said}"
    );
    let (whole, said) = config("whole", &["--set", "coarse_until=0"]);
    assert_eq!(whole, [Some(0), Some(1)]);
    assert!(!said.contains("coarse to fine"), "{said}");
}
