//! Splats of the sky.

use super::*;

/// Made photographs, with more arguments of the demo.
fn made(folder: &Path, more: &[&str]) -> PathBuf {
    let out = folder.join("demo");
    let size = ["--photos", "17", "--size", "64x48", "--seed", "3"];
    stdout(&[&["demo", "--data-only", "--out", word(&out)], &size[..], more].concat());
    out.join("data")
}

/// PSNR of the training views after 200 iterations: each place of the sky shows in few photographs.
fn psnr(folder: &Path, data: &Path, name: &str, more: &[&str]) -> f64 {
    let out = folder.join(name);
    let long = ["train", word(data), "--out", word(&out), "--iterations", "200"];
    stdout(&[&long[..], more].concat());
    read_json(&out.join("report.json"))["train"]["psnr_db"]
        .as_f64()
        .unwrap()
}

#[test]
fn a_shell_draws_the_sky_and_is_refused_where_it_does_not_fit() {
    let folder = folder();
    let data = made(folder.path(), &["--perturb", "sky"]);
    let (with, without) = (
        psnr(folder.path(), &data, "with", &["--sky"]),
        psnr(folder.path(), &data, "without", &[]),
    );
    println!("{with:.2} dB with the shell, {without:.2} without");
    assert!(with > without + 1.0, "{with} dB, {without} without");
    let refused = folder.path().join("refused");
    for (more, words) in [
        (["--strategy", "mcmc"], "sky is true, but must be false with mcmc"),
        (["--kind", "surfel"], "sky is true, but must be false for surfels"),
    ] {
        let message = error(&train(word(&data), word(&refused), &[&["--sky"], &more[..]].concat()));
        assert!(message.contains(words) && !refused.exists(), "{message}");
    }
}
