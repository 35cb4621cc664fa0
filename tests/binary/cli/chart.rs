//! `ashfall chart`.

use super::{data, error, folder, stdout, train, word};
use std::fs;

#[test]
fn a_chart_is_one_page_with_its_numbers_and_every_bound_kept() {
    let folder = folder();
    let out = folder.path().join("chart");
    let csv = stdout(&["chart", "--quick", "--csv", "--out", word(&out), "--validate"]);
    assert_eq!(fs::read_to_string(out.join("chart.csv")).unwrap_or_default(), csv);
    let mut lines = csv.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let rows: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    assert!(rows.iter().all(|row| row.len() == header.len()), "{csv}");
    let column = |name: &str| {
        let found = header.iter().position(|column| *column == name);
        found.unwrap_or_else(|| panic!("no column {name} in {header:?}"))
    };
    let number = |row: &[&str], name: &str| {
        let text = row[column(name)];
        text.parse::<f64>()
            .unwrap_or_else(|e| panic!("{e}: {text:?} in {row:?}"))
    };
    let (mut coarse, mut fine) = (0.0_f64, f64::INFINITY);
    for row in rows
        .iter()
        .filter(|row| row[0] == "rendering" && row[column("quantity")] == "max_error")
    {
        // Some pixel differs, none by more than the proven bound and rounding.
        let (error, bound) = (number(row, "value"), number(row, "bound"));
        assert!(error > 0.0 && error <= bound + 1e-3, "{row:?}");
        coarse = coarse.max(error);
        fine = fine.min(error);
    }
    assert!(coarse > 2.0 * fine, "every setting errs alike: {fine} to {coarse}");
    for chart in ["rendering", "gradients", "training", "geometry"] {
        assert!(
            rows.iter().any(|row| row[0] == chart && row[3] == "yes"),
            "{chart}: no default"
        );
    }
    let page = fs::read_to_string(out.join("chart.html")).unwrap_or_default();
    assert_eq!(page.matches("<figure ").count(), 14);
    assert!(page.contains("settings keep their proven bounds") && page.ends_with("</html>\n"));
}

#[test]
fn a_chart_of_ones_own_scene_takes_its_data_set() {
    let data = word(data());
    let folder = folder();
    let (run, out) = (folder.path().join("run"), folder.path().join("chart"));
    stdout(&train(data, word(&run), &[]));
    let scene = run.join("scene.ply");
    let said = stdout(&[
        "chart",
        word(&scene),
        data,
        "--quick",
        "--only",
        "accuracy",
        "--out",
        word(&out),
    ]);
    assert!(said.contains("chart.html"), "{said}");
    let page = fs::read_to_string(out.join("chart.html")).unwrap_or_default();
    assert_eq!(page.matches("<figure ").count(), 5);
    assert!(page.contains("scene.ply"));
    let alone = error(&["chart", word(&scene), "--out", word(&out)]);
    assert!(alone.contains("scene.ply"), "{alone}");
}
