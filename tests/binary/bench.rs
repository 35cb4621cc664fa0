//! `ashfall bench`: output and files, and refusal to time wrong kernels.

use ashfall::gpu::Gpu;
use ashfall::kernels::gather::Gather;
use ashfall::kernels::{KERNELS, SELFTESTS};
use ashfall::lab::baseline;
use ashfall::lab::baseline::scalar;
use ashfall::lab::bench::check::{Output, words};
use ashfall::lab::bench::input::scene::scattered;
use ashfall::lab::bench::kernels::gradient::SPLAT_TOLERANCE;
use ashfall::lab::bench::kernels::{KernelCase, Workgroups, gather};
use ashfall::lab::bench::{Bench, BenchOptions, Case, kernels, row};
use serde_json::Value;
use std::cell::Cell;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::rc::Rc;

fn ashfall(arguments: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_ashfall"))
        .args(arguments)
        .stdin(Stdio::null())
        .env_remove("ASHFALL_DEVICE")
        .output()
        .unwrap()
}

fn bench(gpu: &ashfall::gpu::Gpu, filter: &str) -> (Bench, Rc<Cell<usize>>) {
    let options = BenchOptions {
        filter: Some(filter.into()),
        runs: 1,
        warm_up: 0,
    };
    let seen = Rc::new(Cell::new(0));
    let count = seen.clone();
    let progress = move |_: &row::BenchRow| count.set(count.get() + 1);
    (Bench::new("kernels", gpu, options, progress).unwrap(), seen)
}

#[test]
fn rows_and_files_agree() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let [csv, json] = ["rows.csv", "rows.json"].map(path);
    let word = |path: &Path| path.to_str().unwrap().to_owned();
    let output = ashfall(&[
        "bench",
        "kernels",
        "--filter",
        "gather/16384",
        "--runs",
        "1",
        "--csv",
        &word(&csv),
        "--json",
        &word(&json),
        "--record",
        &word(folder.path()),
    ]);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{errors}");
    let table = String::from_utf8_lossy(&output.stdout);
    assert!(table.contains("gather/16384 base/64"), "{table}");
    assert!(errors.contains("measured gather/16384"), "{errors}");

    let text = fs::read_to_string(&csv).unwrap();
    let lines: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(lines[0], row::column_names());
    assert!(lines.iter().all(|line| line.len() == lines[0].len()));
    let report: Value = serde_json::from_slice(&fs::read(&json).unwrap()).unwrap();
    let rows = report["rows"].as_array().unwrap();
    assert_eq!(rows.len(), lines.len() - 1);
    for (row, line) in rows.iter().zip(&lines[1..]) {
        assert_eq!(row["input"], line[1]);
        let median = line[5].parse::<f64>().unwrap();
        assert!(median > 0.0 && (row["median_ns"].as_f64().unwrap() - median).abs() <= 0.5);
        assert!(row["copy_share"].as_f64().unwrap() >= 0.0);
    }
    assert_eq!(rows.iter().filter(|row| row["input"] == "copy").count(), 1);
    assert_eq!(report["ratios"], Value::Array(Vec::new()));
    let name = ashfall::lab::bench::record::slug(report["device"].as_str().unwrap());
    let recorded = fs::read_dir(folder.path().join(name)).unwrap().next().unwrap();
    assert_eq!(fs::read_to_string(recorded.unwrap().path()).unwrap(), text);
}

#[test]
fn what_is_not_there_is_an_error() {
    let output = ashfall(&["bench", "kernels", "--filter", "nonsense", "--runs", "1"]);
    assert_eq!(output.status.code(), Some(1));
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(
        errors.lines().last().unwrap().starts_with("error: nothing is called"),
        "{errors}"
    );
    assert_eq!(ashfall(&["bench"]).status.code(), Some(2));
    let none = ashfall(&["bench", "kernels", "--runs", "0"]);
    assert_eq!(none.status.code(), Some(2));
}

#[test]
fn a_wrong_kernel_is_named_and_not_timed() {
    let gpu = crate::common::device::gpu();
    let (mut bench, seen) = bench(&gpu, "");
    let mut trial = |last: f64| {
        let buffer = gpu.buffer::<u32>("more", 4)?;
        let more = move |gpu: &Gpu| -> ashfall::Result<KernelCase<'_, Gather>> {
            let case = gather::gather(gpu, 4)?.fill(&buffer, 7);
            Ok(case.judge(move |gpu| {
                let found = words(&gpu.download(&buffer, 0..4)?);
                Ok(vec![Output::exact("more", found, vec![7.0, 7.0, 7.0, last])])
            }))
        };
        kernels::time(&mut bench, Workgroups::any(&[64]), 4, more)
    };
    let error = trial(8.0).unwrap_err().to_string();
    assert_eq!(seen.get(), 0, "it was timed");
    assert!(error.starts_with("gather/4 base/64: wrong result: more:"), "{error}");
    trial(7.0).unwrap();
    assert_eq!(seen.get(), 1);
    assert_eq!(bench.rows[0].runs, 1);
}

#[test]
fn every_kernel_is_measured() {
    let gpu = crate::common::device::gpu();
    // No kernel matches the filter: all are considered, and only the copy is run.
    let (mut bench, seen) = bench(&gpu, "no such kernel");
    kernels::run(&mut bench).unwrap();
    baseline::run(&mut bench).unwrap();
    assert_eq!(seen.get(), 1);
    for info in KERNELS {
        let variant = if info.variant.is_empty() { "base" } else { info.variant };
        let named = |name: &&String| {
            let mut parts = name.split('/').skip(1);
            parts.next() == Some(info.kernel) && parts.any(|part| part == variant)
        };
        // Self-tests are not benchmarked.
        let excused = SELFTESTS.contains(&info.kernel) || gpu.caps().supports(info).is_err();
        assert!(
            excused || bench.names.iter().any(|name| named(&name)),
            "{} {variant} is not measured",
            info.kernel
        );
    }
}

/// The cheapest input of each kind with sampled oracle checks, as run by the command.
#[test]
fn kernels_are_checked_on_what_they_are_timed_on() {
    let gpu = crate::common::device::gpu();
    for filter in [
        "/16384/base/64",
        "present/480x272",
        "loss/480x272/base/32",
        "loss_backward/480x272/base/32",
    ] {
        let (mut bench, seen) = bench(&gpu, filter);
        kernels::run(&mut bench).unwrap();
        assert!(seen.get() > 1, "{filter}");
    }
}

/// A baseline with wrong results would be no baseline.
#[test]
fn a_yardstick_that_is_wrong_is_noticed() {
    let composite = kernels::Composite::in_squares(scattered(300, [61, 47], 6.0, 0));
    let gradient = kernels::Gradient::new(&composite, kernels::gradient::SAMPLED);
    let input = scalar::HostInput::new(&composite);
    let planes = |image: &[[f32; 4]]| -> Vec<f32> {
        (0..4)
            .flat_map(|plane| image.iter().map(move |pixel| pixel[plane]))
            .collect()
    };
    let case = Case::of("baseline", "forward", "scalar", 0);
    let (mut image, ends) = scalar::forward(&input);
    let vectorised = planes(&baseline::vector::forward(&input));
    case.judge(&composite.outputs(&planes(&image), Some(&ends))).unwrap();
    case.judge(&composite.outputs(&vectorised, None)).unwrap();
    let sums = scalar::backward(&input, &image, &ends, &gradient.d_sampled);
    case.judge(&gradient.judge_splats(&scalar::whitened(&input, &sums), SPLAT_TOLERANCE))
        .unwrap();
    let other = scalar::backward(&input, &image, &ends, &gradient.d_image);
    assert!(
        case.judge(&gradient.judge_splats(&scalar::whitened(&input, &other), SPLAT_TOLERANCE))
            .is_err()
    );
    image.iter_mut().for_each(|pixel| pixel[1] *= 1.001);
    assert!(case.judge(&composite.outputs(&planes(&image), None)).is_err());
}
