//! Mechanical checks of the sources. Every rule lists its faults, and is itself tested with text that violates it.

use ashfall::kernels::KERNELS;
use ashfall::shader::Requirement;
use language::*;
use layers::{folders_have_no_circles, ranks_hold};
use rules::*;
use source::{File, repository};
use unpaired::UNPAIRED;

mod language;
mod layers;
mod rules;
mod source;
mod unpaired;

fn file(path: &str, text: impl Into<String>) -> File {
    (path.to_owned(), text.into())
}

/// Asserts that a rule finds exactly these faults, given by their beginnings.
#[track_caller]
fn refuses(faults: &[String], beginnings: &[&str]) {
    let alike = faults.len() == beginnings.len()
        && faults
            .iter()
            .zip(beginnings)
            .all(|(fault, beginning)| fault.starts_with(beginning));
    assert!(alike, "{faults:#?} should be {beginnings:#?}");
}

#[track_caller]
fn holds(faults: &[String]) {
    assert!(faults.is_empty(), "\n{}\n", faults.join("\n"));
}

#[test]
fn kernels_have_a_reference_and_a_test_of_their_name() {
    let one = |path: &str| file(path, "");
    let mut files = vec![
        one("glsl/ranges.comp"),
        one("src/kernels/ranges.rs"),
        one("src/kernels/mod.rs"),
    ];
    files.extend([one("src/reference/ranges.rs"), one("tests/device/kernels/ranges.rs")]);
    refuses(&names_pair_up(&files, &[]), &[]);
    refuses(
        &names_pair_up(&files, &[("src/kernels/ranges.rs", "")]),
        &["src/kernels/ranges.rs: needs no"],
    );
    files.pop();
    files.push(one("src/reference/dual.rs"));
    let faults = [
        "src/reference/dual.rs: no kernel",
        "tests/device/kernels/ranges.rs: absent",
    ];
    refuses(&names_pair_up(&files, &[]), &faults);
    refuses(&names_pair_up(&files, &[("src/reference/dual.rs", "")]), &faults[1..]);
    // The steps of an operation share its reference and test, and may share its host file.
    let steps = [
        "glsl/sort_count.comp",
        "src/kernels/sort.rs",
        "src/reference/sort.rs",
        "tests/device/kernels/sort.rs",
    ]
    .map(one);
    refuses(&names_pair_up(&steps, &[]), &[]);
    let extra = [&steps[..], &[one("src/kernels/sorting.rs")]].concat();
    refuses(&names_pair_up(&extra, &[]), &["src/kernels/sorting.rs: no kernel"]);
    holds(&names_pair_up(&repository(), UNPAIRED));
}

#[test]
fn imports_point_down() {
    let bad =
        "use crate::scene::Camera; // crate::train is not imported here\nuse crate::{Error, io::{ply, x}, train};";
    let faults = ["src/io/ply.rs: io must not import train"];
    refuses(&ranks_hold(&[file("src/io/ply.rs", bad)]), &faults);
    let inline = file("src/gpu/caps.rs", "fn f() -> crate::scene::Camera {}");
    refuses(&ranks_hold(&[inline]), &["src/gpu/caps.rs: gpu must not import scene"]);
    refuses(
        &ranks_hold(&[file("src/extra.rs", "")]),
        &["src/extra.rs: the module extra has no rank"],
    );
    let lab = file("src/lab/bench/row.rs", "use super::super::chart::Chart;");
    refuses(
        &ranks_hold(&[lab]),
        &["src/lab/bench/row.rs: lab::bench must not import lab::chart"],
    );
    holds(&ranks_hold(&repository()));
}

#[test]
fn files_of_a_folder_import_each_other_one_way() {
    let folder = |b: &str| {
        vec![
            file("src/io/mod.rs", "mod a;\nmod b;\npub use a::{One, Two};"),
            file("src/io/a.rs", "use super::b::{self, Three};"),
            file("src/io/b.rs", b),
        ]
    };
    let circle = ["src/io: a circle of a, b"];
    refuses(&folders_have_no_circles(&folder("use super::Two;")), &circle);
    refuses(
        &folders_have_no_circles(&folder("fn f() -> crate::io::a::One {}")),
        &circle,
    );
    refuses(
        &folders_have_no_circles(&folder(
            "use super::Four;\n#[cfg(test)]\nmod tests {\n    use crate::io::One;\n}",
        )),
        &[],
    );
    refuses(&folders_have_no_circles(&repository()), &[]);
}

#[test]
fn unsafe_and_vulkan_and_the_environment_keep_their_place() {
    let bad = "//! unsafe\nlet s = \"unsafe\";\nunsafe { ash::f() };\nstd::env::var(\"X\");\nlet var = 1;";
    let found = [
        "src/io/a.rs:3: `unsafe`",
        "src/io/a.rs:3: `ash`",
        "src/io/a.rs:4: `var`",
    ];
    refuses(&words_keep_their_place(&[file("src/io/a.rs", bad)]), &found);
    refuses(
        &words_keep_their_place(&[file("src/gpu/a.rs", "unsafe { ash::vk::f() }")]),
        &[],
    );
    holds(&words_keep_their_place(&repository()));
}

#[test]
fn files_and_functions_are_short() {
    refuses(
        &lengths_are_bounded(&[file("src/a.rs", "\n".repeat(501))]),
        &["src/a.rs: 501 lines"],
    );
    let wide = format!("// {}\n", "é".repeat(118));
    refuses(
        &lengths_are_bounded(&[file("src/a.rs", wide)]),
        &["src/a.rs:1: more than 120"],
    );
    let body = "    f(\"}\", '{', r#\"}\"#); // }\n".repeat(69);
    let long =
        format!("struct S {{ a: [u8; 3] }}\n\npub fn long<'a>(x: [f32; 3]) -> u32\n{{\n{body}}}\nfn short() {{}}\n");
    refuses(
        &lengths_are_bounded(&[file("src/a.rs", long)]),
        &["src/a.rs:3: `long` has 72 lines"],
    );
    let fits = format!("fn fits() {{\n{}}}\n", "    f();\n".repeat(68));
    refuses(&lengths_are_bounded(&[file("src/a.rs", fits)]), &[]);
    let glsl = format!("void main()\n{{\nif (a) {{\n{}}}\n}}\n", "a;\n".repeat(66));
    refuses(
        &lengths_are_bounded(&[file("glsl/a.comp", glsl)]),
        &["glsl/a.comp:1: `main` has 71 lines"],
    );
    holds(&lengths_are_bounded(&repository()));
}

#[test]
fn sources_say_what_they_are_for() {
    let shader = "#version 460\n#include \"shared/prelude.glsl\"\n\n// Finds.\nlayout() in;";
    refuses(&sources_open_with_a_comment(&[file("glsl/a.comp", shader)]), &[]);
    let mute = shader.replace("// Finds.\n", "");
    refuses(
        &sources_open_with_a_comment(&[file("glsl/a.comp", mute)]),
        &["glsl/a.comp: does not open"],
    );
    refuses(
        &sources_open_with_a_comment(&[file("src/a.rs", "// a\n")]),
        &["src/a.rs: does not open"],
    );
    holds(&sources_open_with_a_comment(&repository()));
}

#[test]
fn base_variants_need_no_optional_feature() {
    for info in KERNELS.iter().filter(|info| info.variant.is_empty()) {
        let optional = info.requirements.iter().find(|&&needs| is_optional(info.kernel, needs));
        assert_eq!(
            optional, None,
            "{}: an optional feature belongs into a variant",
            info.kernel
        );
    }
    assert!(is_optional("rasterize", Requirement::SubgroupArithmetic));
    assert!(is_optional("adam", Requirement::AtomicFloatAdd));
    assert!(!is_optional("baseline_16x16_backward", Requirement::AtomicFloatAdd));
}

#[test]
fn the_repository_stands_by_itself() {
    let bad = format!("see MET{}.md\nand README.md\nin /ho{}/me", "HODS", "me");
    let files = [file("README.md", ""), file("src/a.rs", bad)];
    refuses(
        &nothing_points_outside(&files),
        &["src/a.rs:1: there is no METHODS", "src/a.rs:3: a folder"],
    );
    holds(&nothing_points_outside(&repository()));
}

#[test]
fn comments_begin_with_the_noun() {
    let text = format!("//! {}\n// It is what it is.\n", "A word ".repeat(100));
    let faults = comments_name_things(&[file("src/a.rs", text)]);
    refuses(&faults, &["4.9 in", "src/a.rs: what"]);
    refuses(&comments_name_things(&[file("src/a.rs", "// It is.")]), &[]);
    let header = file("glsl/a.comp", "#version 460\n// Whether a splat is drawn.");
    refuses(
        &headers_begin_with_a_noun(&[header]),
        &["glsl/a.comp: begins with Whether"],
    );
    holds(&comments_name_things(&repository()));
    holds(&headers_begin_with_a_noun(&repository()));
}

#[test]
fn types_are_named_after_things() {
    let text =
        "pub(crate) struct Seen;\nenum Merged {}\nimpl A {\n    type Traced = u8;\n}\nstruct View;\ntype Known = u8;";
    let faults = ["src/a.rs: Known", "src/a.rs: Merged", "src/a.rs: Seen"];
    refuses(&types_have_names_of_their_own(&[file("src/a.rs", text)]), &faults);
    let many: String = (0..16).map(|i| format!("struct S{i};\n")).collect();
    let twice = [file("src/a.rs", many.as_str()), file("src/b.rs", many.as_str())];
    assert_eq!(types_have_names_of_their_own(&twice).len(), 16);
    holds(&types_have_names_of_their_own(&repository()));
}
