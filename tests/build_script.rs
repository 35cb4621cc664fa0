//! The build script's own tests: what it finds in a shader, and what it refuses, with file and line.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    reason = "a failed set-up fails the test"
)]

use generator::kernel::{Kernel, group};
use generator::model::{Bound, Module, Scalar, Type};
use generator::shader::{Access, Requirement};
use std::path::Path;

#[path = "../build/mod.rs"]
#[allow(
    dead_code,
    reason = "the generator is tested piece by piece; some pieces only build.rs calls"
)]
mod generator;

const PRELUDE: &str = "#extension GL_EXT_scalar_block_layout : require\n";
/// The first five lines of most test kernels; what follows starts at line 6.
const OPEN: &str = "#version 460
#include \"shared/prelude.glsl\"
layout(constant_id = 0) const uint WORKGROUP = 64;
layout(local_size_x_id = 0) in;
layout(set = 0, binding = 0, scalar) buffer Data { uint data[]; };
";
const MAIN: &str = "void main() { data[0] = 1; }\n";

/// A `glsl` folder with these files and a prelude.
fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    std::fs::create_dir(dir.path().join("shared")).unwrap();
    std::fs::write(dir.path().join("shared/prelude.glsl"), PRELUDE).unwrap();
    for (name, text) in files {
        std::fs::write(dir.path().join(name), text).unwrap();
    }
    dir
}

fn build(text: &str) -> Result<Kernel, Vec<String>> {
    let dir = folder(&[("test.comp", text)]);
    Kernel::build(dir.path(), "test", &[String::new()])
}

fn build_pair(base: &str, wide: &str) -> Result<Kernel, Vec<String>> {
    let dir = folder(&[("test.comp", base), ("test.wide.comp", wide)]);
    Kernel::build(dir.path(), "test", &[String::new(), "wide".to_owned()])
}

/// What reflection finds in the base variant.
fn module(text: &str) -> Module {
    let kernel = build(text).unwrap();
    kernel.variants.first().unwrap().module.clone()
}

/// The texts of `layout.rs` and `kernels.rs`.
fn generate(glsl: &Path) -> Result<(String, String), Vec<String>> {
    let out = tempfile::tempdir().unwrap();
    generator::generate(glsl, out.path())?;
    let read = |name| std::fs::read_to_string(out.path().join(name)).unwrap();
    Ok((read("layout.rs"), read("kernels.rs")))
}

/// Asserts that a kernel is refused at a line for a reason.
fn refused(text: &str, line: u32, reason: &str) {
    let faults = build(text).err().expect("should be refused");
    let place = format!("glsl/test.comp:{line}:");
    assert!(
        faults
            .iter()
            .any(|fault| fault.contains(&place) && fault.contains(reason)),
        "expected `{place} …{reason}…`, got {faults:#?}"
    );
}

fn assert_contains(text: &str, all: &[&str]) {
    for expected in all {
        assert!(text.contains(expected), "no `{expected}` in\n{text}");
    }
}

const NESTED: &str = "
struct Inner {
    vec3 mean;  // world units
    uint id;
};
// One of two.
struct Outer {
    float weight;
    Inner pair[2];
    // Columns.
    mat3 turn;
    ivec2 place;
    float table[40];
};
layout(set = 0, binding = 1, scalar) readonly buffer Outers { Outer outer_from_id[]; };
layout(push_constant, scalar) uniform Push {
    vec3 position;  // metres
    Inner inner;
    uvec2 size;
} push;
void main() { data[0] = outer_from_id[1].pair[0].id + push.size.x; }
";

#[test]
fn layouts_are_packed_and_nested() {
    let module = module(&format!("{OPEN}{NESTED}"));
    let Some(Bound::Buffer(Type::Struct(outer))) = module.bindings.get(1).map(|b| &b.bound) else {
        panic!("binding 1 holds structs");
    };
    let offsets: Vec<_> = outer
        .members
        .iter()
        .map(|m| (m.name.as_str(), m.offset))
        .collect();
    assert_eq!(
        offsets,
        [
            ("weight", 0),
            ("pair", 4),
            ("turn", 36),
            ("place", 72),
            ("table", 80)
        ]
    );
    assert_eq!(outer.size(), 240);
    let params = module.params.as_ref().unwrap();
    let offsets: Vec<_> = params.members.iter().map(|m| m.offset).collect();
    assert_eq!(offsets, [0, 12, 28]);
    assert_eq!(params.size(), 36);
}

#[test]
fn rust_says_what_the_shader_says() {
    let dir = folder(&[("test.comp", &format!("{OPEN}{NESTED}"))]);
    let (layout, kernels) = generate(dir.path()).unwrap();
    assert_contains(
        &layout,
        &[
            "/// world units\n    pub mean: [f32; 3],",
            "/// One of two.\n#[repr(C)]\n#[derive(Clone, Copy, Debug, PartialEq, ",
            "impl Default for Outer",
            "pub pair: [Inner; 2],",
            "/// Columns.\n    pub turn: [[f32; 3]; 3],",
            "pub table: [f32; 40],",
            "assert!(core::mem::size_of::<Outer>() == 240);",
            "assert!(core::mem::offset_of!(Outer, place) == 72);",
        ],
    );
    assert_contains(
        &kernels,
        &[
            "pub mod test {",
            "/// metres\n    pub position: [f32; 3],",
            "pub inner: layout::Inner,",
            "kernel: \"test\",",
            "params_size: 36,",
            "    &test::INFO,",
        ],
    );
    assert!(layout.find("struct Inner") < layout.find("struct Outer"));
}

#[test]
fn tunables_keep_type_and_default() {
    let text = format!(
        "{OPEN}layout(constant_id = 3) const float SCALE = 0.3;
layout(constant_id = 1) const int BIAS = -2;
layout(constant_id = 2) const uint UNUSED = 7;
void main() {{ data[0] = uint(SCALE) + uint(BIAS); }}\n"
    );
    let kernel = build(&text).unwrap();
    let specs: Vec<_> = kernel
        .specs
        .iter()
        .map(|s| (s.id, s.name.as_str(), s.scalar, s.default))
        .collect();
    assert_eq!(
        specs,
        [
            (0, "workgroup", Scalar::U32, 64),
            (1, "bias", Scalar::I32, (-2_i32).cast_unsigned()),
            (2, "unused", Scalar::U32, 7),
            (3, "scale", Scalar::F32, 0.3_f32.to_bits()),
        ]
    );
    let dir = folder(&[("test.comp", &text)]);
    let (_, kernels) = generate(dir.path()).unwrap();
    assert_contains(
        &kernels,
        &[
            "bias: -2,",
            "scale: f32::from_bits(0x3e99999a),",
            "[self.workgroup, self.bias.cast_unsigned(), self.unused, self.scale.to_bits(), ]",
            "#[derive(Clone, Copy, Debug, PartialEq)]\n    pub struct Spec",
        ],
    );
}

#[test]
fn access_follows_the_qualifiers_and_unused_bindings_stay() {
    let module = module(&format!(
        "{OPEN}layout(set = 0, binding = 3, scalar) writeonly buffer B {{ uvec2 written[]; }};
layout(set = 0, binding = 2, scalar) readonly buffer A {{ mat3 seen; }};
layout(set = 0, binding = 4) writeonly uniform image2D target;
{MAIN}"
    ));
    let found: Vec<_> = module
        .bindings
        .iter()
        .map(|b| {
            (
                b.binding,
                b.name.as_str(),
                b.access,
                b.bound == Bound::Image,
            )
        })
        .collect();
    assert_eq!(
        found,
        [
            (0, "data", Access::ReadWrite, false),
            (2, "seen", Access::Read, false),
            (3, "written", Access::Write, false),
            (4, "target", Access::Write, true),
        ]
    );
}

/// What a kernel with this extension and this text asks of a device.
fn needs(extension: &str, text: &str) -> Vec<Requirement> {
    let rest = OPEN.strip_prefix("#version 460\n").unwrap();
    let text = format!("#version 460\n#extension {extension} : require\n{rest}{text}\n");
    module(&text).requirements
}

#[test]
fn capabilities_become_requirements() {
    assert_eq!(module(&format!("{OPEN}{MAIN}")).requirements, []);
    assert_eq!(
        needs(
            "GL_KHR_shader_subgroup_arithmetic",
            "void main() { data[0] = subgroupAdd(data[1]); }"
        ),
        [Requirement::SubgroupBasic, Requirement::SubgroupArithmetic]
    );
    assert_eq!(
        needs(
            "GL_KHR_shader_subgroup_vote",
            "void main() { if (subgroupAny(data[0] > 1)) data[0] = 2; }"
        ),
        [Requirement::SubgroupBasic, Requirement::SubgroupVote]
    );
    assert_eq!(
        needs(
            "GL_EXT_shader_explicit_arithmetic_types_int64",
            "void main() { data[0] = uint((uint64_t(data[1]) * data[2]) >> 32); }"
        ),
        [Requirement::Int64]
    );
    assert_eq!(
        needs(
            "GL_EXT_shader_atomic_float",
            "layout(set = 0, binding = 1, scalar) buffer F { float sum; };
void main() { atomicAdd(sum, 1.0); }"
        ),
        [Requirement::AtomicFloatAdd]
    );
    assert_eq!(
        needs(
            "GL_EXT_shader_image_load_formatted",
            "layout(set = 0, binding = 1) writeonly uniform image2D target;
void main() { imageStore(target, ivec2(0), vec4(1)); }"
        ),
        [Requirement::StorageImageWriteWithoutFormat]
    );
}

#[test]
fn params_and_tunables_have_rules() {
    let push = |members: &str| {
        format!("{OPEN}layout(push_constant, scalar) uniform Push {{ {members} }} push;\n{MAIN}")
    };
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
    refused(
        &spec("layout(constant_id = 1) const uint fast = 1;"),
        7,
        "IN_CAPITALS",
    );
    let whole = format!("{OPEN}{MAIN}");
    refused(
        &whole.replace("WORKGROUP", "SIZE"),
        3,
        "`WORKGROUP` exactly",
    );
    refused(
        &whole.replace("size_x_id = 0", "size_x = 8"),
        3,
        "`WORKGROUP` exactly",
    );
    refused(
        &whole.replace("size_x_id = 0", "size_x_id = 1"),
        4,
        "constant 0",
    );
    let wide = MAIN.replace("= 1", "= uint(double(data[1]) * 2.0lf)");
    refused(&format!("{OPEN}{wide}"), 1, "capability Float64");
}

#[test]
fn bindings_have_rules() {
    let block = |text: &str| format!("{OPEN}\nlayout({text};\n{MAIN}");
    for (text, line, reason) in [
        (
            "set = 0, binding = 1, std430) buffer Two { vec3 a[]; }",
            7,
            "padded",
        ),
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
        (
            "test.comp",
            &format!("{OPEN}#include \"broken.glsl\"\n{MAIN}"),
        ),
        ("broken.glsl", "\nuint broken() { return nothing; }\n"),
    ]);
    let faults = Kernel::build(dir.path(), "test", &[String::new()])
        .err()
        .unwrap();
    assert_contains(&faults.concat(), &["glsl/broken.glsl:2:"]);
}

#[test]
fn a_kernel_opens_with_version_and_prelude() {
    let (version, rest) = OPEN.split_at("#version 460\n".len());
    let (_, rest) = rest.split_once('\n').unwrap();
    let late = format!("{version}{PRELUDE}// Comments may stand anywhere.\n{rest}{MAIN}");
    refused(&late, 4, "then the prelude");
    refused(
        &format!("{OPEN}{MAIN}").replace("460", "450"),
        1,
        "#version 460",
    );
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
        let found = faults
            .iter()
            .any(|f| f.contains(place) && f.contains(reason));
        assert!(found, "expected `{place} …{reason}…`, got {faults:#?}");
    };
    let blind = base
        .replace("buffer", "readonly buffer")
        .replace("data[0] = 1;", "");
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
        &format!(
            "{OPEN}layout(set = 0, binding = 1, scalar) buffer More {{ uint more[]; }};\n{MAIN}"
        ),
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
    let dir = folder(&[
        ("one.comp", &kernel("uint")),
        ("two.comp", &kernel("float")),
    ]);
    let faults = generate(dir.path()).err().unwrap();
    assert_contains(
        &faults.concat(),
        &["glsl/two.comp:6: `Pair` has other members"],
    );
}

#[test]
fn files_make_kernels() {
    let names = |files: &[&str]| group(files.iter().map(|&f| f.to_owned()).collect());
    let files = [
        "sort.wide.comp",
        "sort.comp",
        "sort_count.comp",
        "tile.glsl",
        "sort.half.comp",
        "shared",
    ];
    let own = |list: &[&str]| -> Vec<String> { list.iter().map(|&name| name.to_owned()).collect() };
    assert_eq!(
        names(&files).unwrap(),
        [
            ("sort".to_owned(), own(&["", "half", "wide"])),
            ("sort_count".to_owned(), own(&[""])),
        ]
    );
    assert!(names(&["Sort.comp"]).is_err());
    assert!(names(&["sort.base.comp"]).is_err());
    assert!(names(&["loop.comp"]).is_err());
}

#[test]
fn constants_are_literals() {
    let dir = folder(&[(
        "shared/constants.glsl",
        "#ifndef A\n#define A\n// Pixels.\nconst uint TILE = 0x10u;
const int LOW = -3;  // Lowest.\nconst float NEAR = 1e-2;\n#endif\n",
    )]);
    let (layout, _) = generate(dir.path()).unwrap();
    assert_eq!(
        layout.trim(),
        "/// Pixels.\npub const TILE: u32 = 16;\n/// Lowest.\npub const LOW: i32 = -3;
/// `NEAR` of the shaders.\npub const NEAR: f32 = 0.01;"
    );
    for wrong in [
        "const uint TILE = 2 * 8;",
        "const uint TILE = -1;",
        "const uint TILE = 4294967296;",
        "const vec2 TILE = 1.0;",
        "const uint tile = 1;",
        "uint TILE = 1;",
        "const float TILE = 1e99;",
        "const uint A = 1; const uint B = 2;",
    ] {
        let dir = folder(&[("shared/constants.glsl", &format!("\n{wrong}\n"))]);
        let faults = generate(dir.path()).err().expect(wrong);
        assert_contains(
            &faults.concat(),
            &["glsl/shared/constants.glsl:2: expected"],
        );
    }
}
