//! Errors of the generator; every message names file and line.

use crate::build_script::fixtures::{
    MAIN, OPEN, PRELUDE, assert_contains, build, build_pair, folder, generate, refused,
};
use crate::build_script::generator::kernel::Kernel;

#[test]
fn params_and_tunables_have_rules() {
    let push =
        |members: &str| format!("{OPEN}layout(push_constant, scalar) uniform Push {{ {members} }} push;\n{MAIN}");
    refused(&push("vec4 rows[9];"), 6, "144 bytes of push constants");
    refused(&push("uint type;"), 6, "keyword of Rust");
    refused(&push("uint SplatCount;"), 6, "small letter");
    refused(&push("double wide;"), 6, "TypeFloat");
    refused(
        &push("vec2 a;").replace(", scalar) uni", ") uni"),
        6,
        "must say `scalar`",
    );
    let spec = |text: &str| format!("{OPEN}\n{text}\n{MAIN}");
    refused(
        &spec("layout(constant_id = 1) const bool FAST = true;"),
        7,
        "must be a uint, an int or a float",
    );
    refused(&spec("layout(constant_id = 1) const uint fast = 1;"), 7, "IN_CAPITALS");
    let whole = format!("{OPEN}{MAIN}");
    refused(&whole.replace("WORKGROUP", "SIZE"), 3, "`WORKGROUP` exactly");
    refused(&whole.replace("size_x_id = 0", "size_x = 8"), 3, "`WORKGROUP` exactly");
    refused(&whole.replace("size_x_id = 0", "size_x_id = 1"), 4, "constant 0");
    let wide = MAIN.replace("= 1", "= uint(double(data[1]) * 2.0lf)");
    refused(&format!("{OPEN}{wide}"), 1, "capability Float64");
}

#[test]
fn bindings_have_rules() {
    let block = |text: &str| format!("{OPEN}\nlayout({text};\n{MAIN}");
    for (text, line, reason) in [
        ("set = 0, binding = 1, std430) buffer Two { vec3 a[]; }", 7, "padded"),
        (
            "set = 0, binding = 1, std430) buffer Two { uint a[]; }",
            7,
            "must say `scalar`",
        ),
        (
            "set = 0, binding = 1, scalar) buffer Two { uint a; uint b[]; }",
            7,
            "exactly one member",
        ),
        (
            "set = 1, binding = 1, scalar) buffer Two { uint a[]; }",
            7,
            "descriptor set 0",
        ),
        (
            "set = 0, binding = 0, scalar) buffer Two { uint a[]; }",
            5,
            "share a binding",
        ),
        (
            "set = 0, binding = 0, scalar) buffer Two { uvec4 data_by_four[]; }",
            5,
            "share a binding",
        ),
        (
            "set = 0, binding = 1, scalar) readonly buffer Two { uint a[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Fours { uvec4 b[]; }",
            7,
            "share a binding",
        ),
        (
            "set = 0, binding = 1, scalar) readonly buffer Two { uint a[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Fours { vec4 a_by_four[]; }",
            7,
            "share a binding",
        ),
        (
            "set = 0, binding = 1, scalar) readonly buffer Two { uint a[]; };
layout(set = 0, binding = 1, scalar) writeonly buffer Fours { uvec4 a_by_four[]; }",
            7,
            "share a binding",
        ),
        (
            "set = 0, binding = 1, scalar) buffer Two { uint data[]; } two",
            1,
            "two bindings are called",
        ),
        (
            "set = 0, binding = 1, scalar) uniform Two { uint a; }",
            7,
            "uniform blocks",
        ),
        (
            "set = 0, binding = 1) uniform sampler2D photo",
            7,
            "only storage buffers and storage",
        ),
        (
            "set = 0, binding = 1, rgba8) writeonly uniform image2D photo",
            7,
            "without a format",
        ),
        (
            "set = 0, binding = 1, scalar, row_major) buffer Two { mat3 a[]; }",
            7,
            "row_major",
        ),
    ] {
        refused(&block(text), line, reason);
    }
}

#[test]
fn compiler_messages_name_the_file() {
    let fault = |text: &str| build(text).err().unwrap().concat();
    let message = fault(&format!("{OPEN}\nvoid main() {{ data[0] = nothing; }}\n"));
    assert_contains(&message, &["glsl/test.comp:7:"]);
    let message = fault(&format!("{OPEN}#include \"absent.glsl\"\n{MAIN}"));
    assert_contains(&message, &["glsl/test.comp:6:", "absent.glsl"]);
    let message = fault(&format!("{OPEN}#include \"../secret.glsl\"\n{MAIN}"));
    assert_contains(&message, &["from glsl/ downward"]);

    let dir = folder(&[
        ("test.comp", &format!("{OPEN}#include \"broken.glsl\"\n{MAIN}")),
        ("broken.glsl", "\nuint broken() { return nothing; }\n"),
    ]);
    let faults = Kernel::build(dir.path(), "test", &[String::new()]).err().unwrap();
    assert_contains(&faults.concat(), &["glsl/broken.glsl:2:"]);
}

#[test]
fn a_kernel_opens_with_version_and_prelude() {
    let (version, rest) = OPEN.split_at("#version 460\n".len());
    let (_, rest) = rest.split_once('\n').unwrap();
    let late = format!("{version}{PRELUDE}// Comments may stand anywhere.\n{rest}{MAIN}");
    refused(&late, 4, "then the prelude");
    refused(&format!("{OPEN}{MAIN}").replace("460", "450"), 1, "#version 460");
}

#[test]
fn the_workgroup_size_is_not_used_before_it_is_declared() {
    let size = "uint size() { return gl_WorkGroupSize.x; }\n";
    let early = format!("{OPEN}{MAIN}").replace("layout(local", &format!("{size}layout(local"));
    refused(&early, 4, "gl_WorkGroupSize silently is 1");
    assert!(build(&format!("{OPEN}{size}{MAIN}")).is_ok());
}

#[test]
fn variants_are_interchangeable() {
    let base = format!("{OPEN}{MAIN}");
    let more = format!("{OPEN}layout(constant_id = 5) const uint MORE = 2;\n{MAIN}");
    let ids: Vec<u32> = build_pair(&base, &more)
        .unwrap()
        .specs
        .iter()
        .map(|spec| spec.id)
        .collect();
    assert_eq!(ids, [0, 5], "a variant may have tunables of its own");

    let differs = |wide: &str, place: &str, reason: &str| {
        let faults = build_pair(&base, wide).err().expect("should be refused");
        let found = faults.iter().any(|f| f.contains(place) && f.contains(reason));
        assert!(found, "expected `{place} …{reason}…`, got {faults:#?}");
    };
    let blind = base.replace("buffer", "readonly buffer").replace("data[0] = 1;", "");
    differs(&blind, "test.wide.comp:5:", "`data` differs");
    differs(
        &base.replace("= 64", "= 32"),
        "test.wide.comp:3:",
        "another type or default",
    );
    differs(
        &format!("{OPEN}layout(push_constant, scalar) uniform Push {{ uint a; }} push;\n{MAIN}"),
        "test.wide.comp:6:",
        "push constants differ",
    );
    differs(
        &format!("{OPEN}layout(set = 0, binding = 1, scalar) buffer More {{ uint more[]; }};\n{MAIN}"),
        "test.wide.comp:6:",
        "`more` differs",
    );
    let dir = folder(&[("test.wide.comp", &base)]);
    let faults = generate(dir.path()).err().unwrap();
    assert_contains(&faults.concat(), &["portable base variant"]);
}

#[test]
fn one_name_means_one_struct() {
    let kernel = |member: &str| {
        format!(
            "{OPEN}struct Pair {{ {member} first; uint second; }};
layout(set = 0, binding = 1, scalar) readonly buffer Pairs {{ Pair pairs[]; }};
{MAIN}"
        )
    };
    let dir = folder(&[("one.comp", &kernel("uint")), ("two.comp", &kernel("float"))]);
    let faults = generate(dir.path()).err().unwrap();
    assert_contains(&faults.concat(), &["glsl/two.comp:6: `Pair` has other members"]);
}
