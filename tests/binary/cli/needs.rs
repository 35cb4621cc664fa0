//! `ashfall needs`.

use super::{ashfall, data, error, folder, run, stdout, word};
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

/// A survey of two scenes in a few steps.
fn survey<'a>(out: &'a Path, more: &[&'a str]) -> Vec<&'a str> {
    let tiny = ["--width", "24", "--iterations", "40", "--scenes", "sphere"];
    [&["needs", "--out", word(out)], &tiny[..], more].concat()
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

#[test]
fn every_run_is_written_down_drawn_and_not_run_again() {
    let folder = folder();
    let (out, filed) = (folder.path().join("needs"), folder.path().join("filed.csv"));
    let data = word(data());
    let recipes = ["--recipes", "fixed,parsimony,mcmc"];
    let first = survey(&out, &[&[data, "--seeds", "1", "--validate"], &recipes[..]].concat());
    let said = stdout(&first);
    assert!(said.contains("needs.html"), "{said}");
    let csv = read(&out.join("needs.csv"));
    let lines: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    let column = |name: &str| {
        let found = lines[0].iter().position(|column| *column == name);
        found.unwrap_or_else(|| panic!("no column {name}"))
    };
    assert_eq!(lines.len(), 1 + 2 * 3);
    // Paths are private: only the data set's last folder is written, as the name of its scene.
    assert_eq!([lines[1][0], lines[4][0]], ["sphere", "data"]);
    assert!(!csv.contains(data) && !csv.contains(word(folder.path())), "{csv}");
    for runs in [&lines[1..4], &lines[4..7]] {
        assert_eq!(runs[2][column("max_splats")], runs[1][column("splats")]);
        for run in runs {
            let psnr: f64 = run[column("psnr_db")].parse().unwrap_or(0.0);
            assert!((5.0..60.0).contains(&psnr), "{run:?}");
            assert!(run[column("ply_bytes")].len() > 3, "{run:?}");
        }
    }
    let page = read(&out.join("needs.html"));
    assert_eq!(page.matches("<figure ").count(), 2);
    assert!(page.contains("<h3>sphere</h3>") && page.contains("<h3>data</h3>"));
    assert!(!page.contains(data) && page.ends_with("</html>\n"));
    // With one more seed, earlier lines stay to the byte, times included.
    let filing = ["--seeds", "2", "--record", word(&filed)];
    stdout(&survey(&out, &[&[data], &filing[..], &recipes[..]].concat()));
    let both = read(&out.join("needs.csv"));
    assert_eq!(both.lines().count(), 1 + 2 * 6);
    let kept: Vec<&str> = both.lines().filter(|line| csv.contains(line)).collect();
    assert_eq!(kept, csv.lines().collect::<Vec<_>>());
    assert_eq!(read(&filed), both);
    let names = fs::read_dir(&out).map(|entries| entries.count());
    assert_eq!(names.ok(), Some(2), "something is left behind");
}

#[test]
fn constants_are_varied_and_test_views_are_drawn() {
    let folder = folder();
    let out = folder.path().join("needs");
    let varied = ["--vary", "auto.last_fit_share,drop_rate=0.5", "--recipes", "parsimony"];
    let arguments = survey(&out, &[&varied[..], &["--seeds", "1", "--pictures"]].concat());
    stdout(&arguments);
    let csv = read(&out.join("needs.csv"));
    let settings = [
        "",
        "auto.last_fit_share=0.1",
        "auto.last_fit_share=0.4",
        "drop_rate=0.5",
    ];
    let found: Vec<_> = csv.lines().skip(1).filter_map(|line| line.split(',').nth(3)).collect();
    assert_eq!(found, settings);
    let page = read(&out.join("needs.html"));
    assert!(page.contains("One scene left out") && page.contains("<td>drop_rate=0.5</td>"));
    // Of 48 views, every eighth is a test view.
    let names = ["sphere-parsimony-0", "sphere-parsimony-0-drop_rate=0.5"];
    for name in names {
        let pictures = fs::read_dir(out.join("pictures").join(name));
        assert_eq!(pictures.map(|entries| entries.count()).ok(), Some(6), "{name}");
    }
    stdout(&arguments);
    assert_eq!(read(&out.join("needs.csv")), csv, "runs were repeated");
}

#[test]
fn bad_input_is_refused_before_anything_is_written() {
    let folder = folder();
    let out = folder.path().join("needs");
    for wrong in [
        ["--scenes", "plain"],
        ["--recipes", "adc"],
        ["--loss", "-1"],
        ["--seeds", "0"],
        ["--iterations", "1"],
    ] {
        assert_eq!(run(&survey(&out, &wrong)).status.code(), Some(2), "{wrong:?}");
    }
    let data = word(data());
    let missing = error(&survey(&out, &["/no/such/folder"]));
    assert!(missing.contains("/no/such/folder"), "{missing}");
    let twice = error(&survey(&out, &[data, data]));
    assert!(twice.contains("another scene is called data"), "{twice}");
    let named = format!("plane={data}");
    let taken = error(&survey(&out, &[&named]));
    assert!(taken.contains("another scene is called plane"), "{taken}");
    let nothing = error(&["needs", "--scenes", "none", "--out", word(&out)]);
    assert!(nothing.contains("no scene"), "{nothing}");
    let unknown = error(&survey(&out, &["--vary", "auto.growth"]));
    assert!(
        unknown.contains("--vary") && unknown.contains("growth_share"),
        "{unknown}"
    );
    assert!(!out.exists());
}

#[test]
fn runs_of_another_survey_are_not_mixed_in() {
    let folder = folder();
    let out = folder.path().join("needs");
    let fixed = ["--recipes", "fixed", "--seeds", "1"];
    stdout(&survey(&out, &fixed));
    let before = read(&out.join("needs.csv"));
    let other = error(&survey(&out, &[&fixed[..], &["--loss", "0.5"]].concat()));
    assert!(
        other.contains("needs.csv") && other.contains("the loss allowed was "),
        "{other}"
    );
    let count = error(&survey(&out, &["--recipes", "mcmc", "--seeds", "1"]));
    assert!(count.contains("parsimony"), "{count}");
    assert_eq!(read(&out.join("needs.csv")), before);
    fs::write(out.join("needs.csv"), "scene,recipe\n").unwrap_or_else(|e| panic!("{e}"));
    let spoilt = error(&survey(&out, &fixed));
    assert!(spoilt.contains("needs.csv: is no record"), "{spoilt}");
    stdout(&survey(&out, &[&fixed[..], &["--loss", "0.5", "--overwrite"]].concat()));
    assert!(read(&out.join("needs.csv")).contains(",0.5,"));
}

#[test]
fn an_interrupted_survey_goes_on_with_the_run_that_was_broken_off() {
    let folder = folder();
    let out = folder.path().join("needs");
    let recipes = ["--recipes", "fixed,parsimony", "--seeds", "1"];
    let long = ["--width", "24", "--iterations", "150", "--scenes", "sphere"];
    let arguments = [&["needs", "--out", word(&out)], &long[..], &recipes[..]].concat();
    let mut child = ashfall(&arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap_or_else(|e| panic!("cannot run the binary: {e}"));
    let csv = || fs::read_to_string(out.join("needs.csv")).unwrap_or_default();
    while csv().is_empty() {
        let over = child.try_wait().is_ok_and(|status| status.is_some());
        assert!(!over, "the survey ended before it could be stopped");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(sent.is_ok_and(|status| status.success()));
    let status = child.wait().unwrap_or_else(|e| panic!("cannot wait: {e}"));
    assert_eq!(status.code(), Some(130));
    let before = csv();
    assert_eq!(before.lines().count(), 2, "{before}");
    assert!(read(&out.join("needs.html")).contains("fixed recipe"));
    stdout(&arguments);
    let after = csv();
    assert!(after.starts_with(&before) && after.lines().count() == 3, "{after}");
}
