//! Tests of the build script: reflection of shaders, and errors with file and line.

use fixtures::{MAIN, OPEN, PRELUDE, assert_contains, build, folder, generate, instructions, module};
use generator::kernel::group;
use generator::model::{Bound, Scalar, Type};
use generator::shader::{Access, Requirement};
use generator::source::{File, Sources};
use rspirv::spirv::{Decoration, LoopControl, Op};

#[path = "../../../build/mod.rs"]
#[allow(
    dead_code,
    reason = "the generator is tested piece by piece; some pieces only build.rs calls"
)]
mod generator;
#[path = "../../../build/packaged.rs"]
mod packaged;

mod fixtures;
mod refusals;

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
    let offsets: Vec<_> = outer.members.iter().map(|m| (m.name.as_str(), m.offset)).collect();
    assert_eq!(
        offsets,
        [("weight", 0), ("pair", 4), ("turn", 36), ("place", 72), ("table", 80)]
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
            "pub outer_from_id: &'a Buffer<layout::Outer>,",
            "io: Bindings<'_>, params: Params, groups: Groups<'_>)",
            "&[Slot::from(io.data), Slot::from(io.outer_from_id)], bytemuck::bytes_of(&params), groups)",
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
fn optimised_modules_keep_precise_operations_and_loops_to_unroll() {
    let kernel = build(&format!(
        "{OPEN}layout(set = 0, binding = 1, scalar) buffer Sums {{ float sums[]; }};
float product(float a, float b) {{
    precise float c = a * b;
    return c;
}}
void main() {{
    precise float sum = 0.0;
    [[unroll]] for (uint i = 0; i < 4; ++i) sum += product(sums[i], sums[i + 4]);
    sums[data[0]] = sum;
}}\n"
    ))
    .unwrap();
    let spirv = &kernel.variants.first().unwrap().spirv;
    let (mut sums, mut exact, mut hints) = (Vec::new(), Vec::new(), Vec::new());
    for line in instructions(spirv) {
        match Op::from_u32(line[0] & 0xffff) {
            Some(Op::FMul | Op::FAdd) => sums.push(line[2]),
            Some(Op::Decorate) if line[2] == Decoration::NoContraction as u32 => exact.push(line[1]),
            Some(Op::LoopMerge) => hints.push(line[3]),
            _ => {}
        }
    }
    sums.sort_unstable();
    exact.sort_unstable();
    assert_eq!(sums, exact);
    assert_eq!(sums.len(), 2);
    assert_eq!(hints, [LoopControl::UNROLL.bits()]);
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
        .map(|b| (b.binding, b.name.as_str(), b.access, b.bound == Bound::Image))
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

#[test]
fn a_view_by_four_is_no_binding_of_its_own() {
    let views = |access: &str, name: &str, element: &str| {
        let block = |block: &str, member: &str| {
            format!("layout(set = 0, binding = 1, scalar) {access} buffer {block} {{ {member}[]; }};\n")
        };
        let (numbers, fours) = (block("A", "uint keys"), block("B", &format!("{element} {name}")));
        format!("{OPEN}{numbers}{fours}{MAIN}")
    };
    for access in ["readonly", "writeonly"] {
        let module = module(&views(access, "keys_by_four", "uvec4"));
        let names: Vec<&str> = module.bindings.iter().map(|b| b.name.as_str()).collect();
        assert_eq!(names, ["data", "keys"]);
    }
}

/// Device requirements of a kernel with this extension and this text.
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
        []
    );
}

/// Some compilers declare the workgroup size by id in any version of SPIR-V; here it is that of 1.6.
#[test]
fn workgroup_sizes_by_id_are_refused() {
    let text = OPEN.replace("#include \"shared/prelude.glsl\"\n", PRELUDE) + MAIN;
    let reflected = |version| {
        let mut options = shaderc::CompileOptions::new().unwrap();
        options.set_target_env(shaderc::TargetEnv::Vulkan, shaderc::EnvVersion::Vulkan1_3 as u32);
        options.set_target_spirv(version);
        let compiler = shaderc::Compiler::new().unwrap();
        let kind = shaderc::ShaderKind::Compute;
        let module = compiler.compile_into_spirv(&text, kind, "a.comp", "main", Some(&options));
        let sources = Sources::new(vec![File::new("a.comp", &text)]);
        generator::reflect::reflect(module.unwrap().as_binary(), &sources).map(|_| ())
    };
    assert_eq!(reflected(shaderc::SpirvVersion::V1_5), Ok(()));
    let faults = reflected(shaderc::SpirvVersion::V1_6).unwrap_err();
    assert_contains(&faults.concat(), &["a.comp:1:", "maintenance4"]);
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
        let faults = generate(dir.path()).expect_err(wrong);
        assert_contains(&faults.concat(), &["glsl/shared/constants.glsl:2: expected"]);
    }
}

/// Signed files are taken as they are; those of other sources and absent ones are refused.
#[test]
fn compiled_shaders_of_a_package_are_those_of_its_sources() {
    let folder = tempfile::tempdir().unwrap();
    let [glsl, spirv, out] = ["glsl", "spirv", "out"].map(|name| folder.path().join(name));
    for folder in [&glsl.join("shared"), &spirv, &out] {
        std::fs::create_dir_all(folder).unwrap();
    }
    std::fs::write(glsl.join("one.comp"), "void main() {}\n").unwrap();
    std::fs::write(glsl.join("shared/two.glsl"), "int two;\n").unwrap();
    let take = || packaged::take(&glsl, &spirv, &out).map_err(|faults| faults.join("\n"));
    assert_contains(&take().unwrap_err(), &["no compiled shaders"]);
    std::fs::write(spirv.join("kernels.rs"), "pub mod one {}").unwrap();
    packaged::sign(&glsl, &spirv).unwrap();
    take().unwrap();
    assert_eq!(
        std::fs::read_to_string(out.join("kernels.rs")).unwrap(),
        "pub mod one {}"
    );
    // Line ends of another system are the same source; a changed include is not.
    std::fs::write(glsl.join("one.comp"), "void main() {}\r\n").unwrap();
    take().unwrap();
    std::fs::write(glsl.join("shared/two.glsl"), "int three;\n").unwrap();
    assert_contains(&take().unwrap_err(), &["of other shaders"]);
}
