//! Seed inputs of the corpora: small valid files of every format, generated here.

use ashfall::io::sog::{SogCodes, SogOptions};
use ashfall::io::spz::{SpzCodes, SpzOptions, SpzVersion};
use ashfall::io::{gltf, ply};
use ashfall::scene::{ScreenFilter, Splats, sh_coefficient_count};
use ashfall::train::checkpoint::Checkpoint;
use ashfall::train::{HostState, PendingColors, TrainConfig};
use image::codecs::jpeg::JpegEncoder;
use image::{DynamicImage, ImageFormat, RgbaImage};
use serde_json::Value;
use std::io::{Cursor, Write};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// Target, name and contents.
pub(crate) fn all() -> Vec<(&'static str, String, Vec<u8>)> {
    let mut seeds = Vec::new();
    let mut add = |target, name: &str, bytes: Vec<u8>| seeds.push((target, name.to_owned(), bytes));
    for (degree, filter) in [(0, ScreenFilter::Classic), (1, ScreenFilter::Mip)] {
        add("ply", &format!("binary-{degree}"), binary_ply(degree, filter));
    }
    for degree in [0, 1] {
        add("ply", &format!("compressed-{degree}"), compressed_ply(degree));
    }
    add("ply", "ascii", ascii_ply("ascii", "float").into_bytes());
    add("ply", "mesh-before", mesh_before().into_bytes());
    add("cloud", "ascii", CLOUD.as_bytes().to_vec());
    add("cloud", "big-endian", big_endian_cloud());
    add("mesh", "ascii", MESH.as_bytes().to_vec());
    add("mesh", "binary", binary_mesh());
    add("splat", "two", splat_records());
    for (version, degree, flags) in [(1, 1, 0), (2, 2, 2), (3, 0, 1), (3, 4, 0x80)] {
        let contents = spz_contents(version, degree, flags);
        add("spz", &format!("raw-{version}-{degree}"), contents.clone());
        add("spz", &format!("gzip-{version}-{degree}"), gzipped(&contents));
    }
    for degree in [0, 2] {
        add("spz", &format!("frames-{degree}"), spz_frames(degree));
    }
    for level in 0..3 {
        add("ksplat", &format!("level-{level}"), ksplat(level));
    }
    add("colmap_bin", "model", colmap_binary());
    add("colmap_txt", "model", COLMAP.as_bytes().to_vec());
    add("colmap_rigs", "two", colmap_rigs());
    add("transforms", "nerfstudio", NERFSTUDIO.as_bytes().to_vec());
    add("transforms", "blender", BLENDER.as_bytes().to_vec());
    add("camera_path", "nerfstudio", VIEWER_PATH.as_bytes().to_vec());
    add("camera_path", "inria", INRIA_CAMERAS.as_bytes().to_vec());
    add("camera_path", "transforms", NERFSTUDIO.as_bytes().to_vec());
    add("camera_path", "gltf", GLTF_CAMERAS.as_bytes().to_vec());
    add("realitycapture", "lens", CAMERA_TABLE.as_bytes().to_vec());
    add("realitycapture", "least", CAMERA_TABLE_LEAST.as_bytes().to_vec());
    add("metashape", "groups", METASHAPE.as_bytes().to_vec());
    add("metashape", "panorama", METASHAPE_PANORAMA.as_bytes().to_vec());
    add("checkpoint", "two", checkpoint());
    add("obj", "tetrahedron", TETRAHEDRON.as_bytes().to_vec());
    add("obj", "colors", COLORS.as_bytes().to_vec());
    for degree in [0, 1] {
        add("gltf", &format!("binary-{degree}"), binary_gltf(degree));
    }
    add("gltf", "payload", payload());
    add("gltf", "text", GLTF.as_bytes().to_vec());
    add("gltf", "quantised", QUANTISED.as_bytes().to_vec());
    let picture = picture();
    for (name, image) in [
        ("rgba", picture.clone()),
        ("grey", DynamicImage::from(picture.to_luma8())),
        ("rgb16", DynamicImage::from(picture.to_rgb16())),
    ] {
        add("png", name, encoded(&image, ImageFormat::Png));
    }
    for (name, image) in [
        ("rgb", DynamicImage::from(picture.to_rgb8())),
        ("grey", DynamicImage::from(picture.to_luma8())),
    ] {
        let mut bytes = Vec::new();
        JpegEncoder::new_with_quality(&mut bytes, 60)
            .encode_image(&image)
            .unwrap();
        add("jpeg", name, bytes);
    }
    for degree in [0, 1] {
        add("sog", &format!("bundle-{degree}"), sog_bundle(degree, None));
    }
    add("sog", "version-1", sog_bundle(1, Some(SOG_1)));
    seeds
}

/// Bundle with short codebooks, or with a list of its own.
fn sog_bundle(degree: u32, list: Option<&str>) -> Vec<u8> {
    let codes = SogCodes::quantise(&splats(degree, ScreenFilter::Mip), &SogOptions::default());
    let mut archive = ZipArchive::new(Cursor::new(codes.bytes().unwrap())).unwrap();
    let mut meta: Value = serde_json::from_reader(archive.by_name("meta.json").unwrap()).unwrap();
    for name in ["scales", "sh0", "shN"] {
        if let Some(Value::Array(values)) = meta.get_mut(name).and_then(|part| part.get_mut("codebook")) {
            values.dedup();
        }
    }
    let meta = list.map_or(meta.to_string(), str::to_owned);
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    writer.start_file("meta.json", options).unwrap();
    writer.write_all(meta.as_bytes()).unwrap();
    for i in 1..archive.len() {
        writer.raw_copy_file(archive.by_index_raw(i).unwrap()).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

const SOG_1: &str = r#"{"means":{"shape":[2,3],"mins":[-1,0,1],"maxs":[1,1,2],"files":["means_l.webp","means_u.webp"]},
"scales":{"shape":[2,3],"mins":[-5,-5,-5],"maxs":[1,1,1],"files":["scales.webp"]},
"quats":{"shape":[2,4],"encoding":"quaternion_packed","files":["quats.webp"]},
"sh0":{"shape":[2,1,4],"mins":[-2,-2,-2,-4],"maxs":[2,2,2,5],"files":["sh0.webp"]},
"shN":{"shape":[2,3,3],"mins":-1.5,"maxs":2e0,"quantization":8,"files":["shN_centroids.webp","shN_labels.webp"]}}"#;

/// Files to which a `transforms.json` may refer.
pub(crate) fn beside() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("a.png", encoded(&picture(), ImageFormat::Png)),
        ("cloud.ply", CLOUD.as_bytes().to_vec()),
    ]
}

fn picture() -> DynamicImage {
    RgbaImage::from_fn(8, 6, |x, y| {
        image::Rgba([x as u8 * 30, y as u8 * 40, 99, 255 - 9 * x as u8])
    })
    .into()
}

fn encoded(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

fn splats(degree: u32, filter: ScreenFilter) -> Splats {
    let stride = sh_coefficient_count(degree) * 3;
    Splats {
        mean: vec![[0.0, 1.0, 2.0], [-1.5, 0.25, 3.0]],
        quaternion: vec![[1.0, 0.0, 0.0, 0.0], [0.5, -0.5, 0.5, 0.5]],
        log_scale: vec![[-1.0, -2.0, -3.0]; 2],
        opacity_logit: vec![0.5, -0.5],
        sh: (0..2 * stride).map(|i| i as f32 * 0.125).collect(),
        sh_degree: degree,
        filter,
        ..Splats::default()
    }
}

fn binary_ply(degree: u32, filter: ScreenFilter) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ply");
    ply::write(&path, &splats(degree, filter)).unwrap();
    std::fs::read(path).unwrap()
}

fn compressed_ply(degree: u32) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.compressed.ply");
    ply::compressed::write(&path, &splats(degree, ScreenFilter::Mip)).unwrap();
    std::fs::read(path).unwrap()
}

fn binary_gltf(degree: u32) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.glb");
    gltf::write(&path, &splats(degree, ScreenFilter::Classic)).unwrap();
    std::fs::read(path).unwrap()
}

/// An SPZ file without gzip inside, in two nodes.
fn payload() -> Vec<u8> {
    let contents = spz_contents(2, 1, 1);
    let text = format!(
        r#"{{"asset":{{"version":"2.0"}},"nodes":[{{"mesh":0}},{{"mesh":0,"scale":[2,2,2]}}],"meshes":[{{"primitives":[
{{"extensions":{{"KHR_gaussian_splatting":{{"extensions":{{"KHR_gaussian_splatting_compression_spz_2":
{{"bufferView":0}}}}}}}}}}]}}],"bufferViews":[{{"buffer":0,"byteLength":{0}}}],"buffers":[{{"byteLength":{0}}}]}}"#,
        contents.len()
    );
    let mut bytes = b"glTF\x02\0\0\0\0\0\0\0\0\0\0\0JSON".to_vec();
    bytes.extend(text.bytes());
    bytes.extend([contents.len() as u8, 0, 0, 0]);
    bytes.extend(b"BIN\0");
    bytes.extend(contents);
    super::repair::glb(&mut bytes);
    bytes
}

/// One splat of degree 0 in two nodes, with a draft's names, a buffer in base 64 and a sparse accessor.
const GLTF: &str = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,2]}],"nodes":[
{"children":[1],"translation":[1,2,3],"scale":[1,2,3]},{"mesh":0,"rotation":[0,0.6,0,0.8]},{"mesh":0,
"matrix":[0,1,0,0,-1,0,0,0,0,0,1,0,1,2,3,1]}],"meshes":[{"primitives":[{"mode":0,"attributes":{"POSITION":0,
"COLOR_0":1,"_ROTATION":2,"_SCALE":0},"extensions":{"KHR_gaussian_splatting":{"kernel":"ellipse"}}}]}],"accessors":[
{"bufferView":0,"componentType":5126,"count":1,"type":"VEC3","sparse":{"count":1,"indices":{"bufferView":0,
"byteOffset":12,"componentType":5121},"values":{"bufferView":0}}},
{"bufferView":0,"byteOffset":3,"componentType":5121,"normalized":true,"count":1,"type":"VEC4"},
{"bufferView":0,"componentType":5126,"count":1,"type":"VEC4"}],"bufferViews":[{"buffer":0,"byteLength":16}],
"buffers":[{"byteLength":16,"uri":"data:;base64,AACAPwAAAD8AAABAAAAAAA=="}]}"#;

/// Two splats of degree 1 in integers, most of them zeros without a buffer.
const QUANTISED: &str = r#"{"asset":{"version":"2.0"},"extensionsUsed":["KHR_mesh_quantization"],"nodes":[{"mesh":0}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0,"KHR_gaussian_splatting:ROTATION":1,
"KHR_gaussian_splatting:SCALE":2,"KHR_gaussian_splatting:OPACITY":3,"KHR_gaussian_splatting:SH_DEGREE_0_COEF_0":4,
"KHR_gaussian_splatting:SH_DEGREE_1_COEF_0":4,"KHR_gaussian_splatting:SH_DEGREE_1_COEF_1":4,
"KHR_gaussian_splatting:SH_DEGREE_1_COEF_2":4},"extensions":{"KHR_gaussian_splatting":{"kernel":"ellipse",
"colorSpace":"lin_rec709_display"}}}]}],"accessors":[
{"bufferView":0,"componentType":5122,"count":2,"type":"VEC3"},
{"bufferView":0,"componentType":5120,"normalized":true,"count":2,"type":"VEC4"},
{"bufferView":0,"componentType":5121,"count":2,"type":"VEC3"},
{"bufferView":1,"componentType":5123,"normalized":true,"count":2,"type":"SCALAR"},
{"componentType":5126,"count":2,"type":"VEC3"}],
"bufferViews":[{"buffer":0,"byteLength":14,"byteStride":8},{"buffer":0,"byteOffset":4,"byteLength":8}],
"buffers":[{"byteLength":14,"uri":"data:;base64,AAECAwQFBgcICQoLDA0="}]}"#;

fn ascii_ply(format: &str, kind: &str) -> String {
    let names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let properties: String = names
        .split(' ')
        .map(|name| format!("property {kind} {name}\n"))
        .collect();
    let rows = "0 1 2 .1 .2 .3 0.5 -1 -2 -3 1 0 0 0\n1e1 nan 2 1 2 3 4 5 6 7 0 0 0 0\n";
    format!("ply\nformat {format} 1.0\ncomment antialiased 1\nelement vertex 2\n{properties}end_header\n{rows}")
}

fn mesh_before() -> String {
    let face = "element face 2\nproperty list uchar int vertex_indices\nproperty uchar flag\nelement vertex";
    let text = ascii_ply("ascii", "double").replace("element vertex", face);
    text.replace("end_header\n", "end_header\n3 0 1 2 9\n4 0 1 2 3 9\n")
}

const CLOUD: &str = "ply\r\nformat ascii 1.0\r\nobj_info a\r\nelement vertex 2\r\nproperty float x\r\nproperty float y\r\n\
property float z\r\nproperty uchar red\r\nproperty uchar green\r\nproperty uchar blue\r\nend_header\r\n0 0 2 255 0 7\r\n\
1 0.5 -2 1 2 3\r\n";

fn big_endian_cloud() -> Vec<u8> {
    let header = "ply\nformat binary_big_endian 1.0\nelement face 1\nproperty list uchar int v\nelement vertex 1\n\
                  property double x\nproperty short y\nproperty int z\nproperty float red\nproperty float green\n\
                  property float blue\nend_header\n";
    let mut bytes = header.as_bytes().to_vec();
    bytes.extend([1, 0, 0, 0, 7]);
    bytes.extend(1.5f64.to_be_bytes());
    bytes.extend(3i16.to_be_bytes());
    bytes.extend((-9i32).to_be_bytes());
    [0.1f32, 0.5, 1.0].iter().for_each(|v| bytes.extend(v.to_be_bytes()));
    bytes
}

const MESH: &str = "ply\nformat ascii 1.0\ncomment SplatOrigin: 1000.5 -2 3e6\nelement vertex 5\nproperty float x\n\
property float y\nproperty float z\nproperty float red\nproperty float green\nproperty float blue\nelement other 1\n\
property list uchar int a\nelement face 2\nproperty uchar flag\nproperty list uchar uint vertex_index\nend_header\n\
0 0 0 0 .5 1\n1 0 0 0 0 0\n0 1 0 1 1 1\n0 0 1 1 0 0\n1 1 1 .1 .2 .3\n2 8 9\n7 3 0 1 2\n0 4 0 1 4 3\n";

/// A triangle and a square, as programs write them.
fn binary_mesh() -> Vec<u8> {
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
                  property float z\nproperty float nx\nproperty float ny\nproperty float nz\nproperty uchar red\n\
                  property uchar green\nproperty uchar blue\nelement face 2\nproperty list uchar int \
                  vertex_indices\nend_header\n";
    let mut bytes = header.as_bytes().to_vec();
    for [x, y] in [[0.0f32, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
        let vertex = [x, y, 0.5, 0.0, 0.0, -1.0];
        vertex.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        bytes.extend([255, 128, 7]);
    }
    for corners in [&[0i32, 1, 2][..], &[0, 1, 2, 3]] {
        bytes.push(corners.len() as u8);
        corners.iter().for_each(|corner| bytes.extend(corner.to_le_bytes()));
    }
    bytes
}

fn splat_records() -> Vec<u8> {
    let mut bytes = Vec::new();
    for i in 0..2u8 {
        [0.5, -1.0, 2.0, 0.1, 0.2, 0.3f32]
            .iter()
            .for_each(|v| bytes.extend((v + f32::from(i)).to_le_bytes()));
        bytes.extend([10, 20, 30, 200, 255, 128, 128, 128 - i]);
    }
    bytes
}

/// Contents of SPZ versions 1 to 3: two splats, and a record of axes if flag 2 announces it.
fn spz_contents(version: u8, degree: u8, flags: u8) -> Vec<u8> {
    let mut bytes = b"NGSP".to_vec();
    bytes.extend([version, 0, 0, 0, 2, 0, 0, 0, degree, 12, flags, 0]);
    let position = if version == 1 { 6 } else { 9 };
    let rotation = if version < 3 { 3 } else { 4 };
    let sh = 3 * ((usize::from(degree) + 1).pow(2) - 1);
    let size = 2 * (position + 1 + 3 + 3 + rotation + sh);
    bytes.extend((0..size).map(|i| (i * 37) as u8));
    if flags & 2 != 0 {
        bytes.extend([3, 0, 0xbe, 0xad, 4, 0, 0, 0, 7, 0, 0, 0]);
    }
    bytes
}

fn gzipped(bytes: &[u8]) -> Vec<u8> {
    // Stored blocks, so that mutations reach the contents.
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::none());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn spz_frames(degree: u32) -> Vec<u8> {
    let codes = SpzCodes::nearest(&splats(degree, ScreenFilter::Mip), &SpzOptions::default());
    codes.bytes(SpzVersion::V4, 1).unwrap()
}

/// Two sections of two splats, with a full bucket each at levels 1 and 2 and a partial one in the second; without the
/// unused ends of the headers.
fn ksplat(level: u8) -> Vec<u8> {
    let mut bytes = vec![0, 1, 0, 0];
    [2u32, 2, 4, 4].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    bytes.extend([level, 0]);
    bytes.resize(44, 0);
    let bucketed = u32::from(level > 0);
    for (degree, partial) in [(2, 0), (1, bucketed)] {
        let full = bucketed - partial;
        [2u32, 2, 2, full + partial]
            .iter()
            .for_each(|v| bytes.extend(v.to_le_bytes()));
        bytes.extend(5f32.to_le_bytes());
        bytes.extend([12, 0, 0, 0]);
        [0u32, 0, full, partial]
            .iter()
            .for_each(|v| bytes.extend(v.to_le_bytes()));
        bytes.extend([degree, 0, 0, 0]);
    }
    for (degree, partial) in [(2usize, 0), (1, bucketed)] {
        (0..partial).for_each(|_| bytes.extend(2u32.to_le_bytes()));
        bytes.resize(bytes.len() + 12 * bucketed as usize, 0);
        let harmonics = 3 * ((degree + 1).pow(2) - 1);
        let record = match level {
            0 => 44 + 4 * harmonics,
            1 => 24 + 2 * harmonics,
            _ => 24 + harmonics,
        };
        // Half floats and floats of these bytes are finite and positive.
        bytes.extend((0..2 * record).map(|i| 0x30 + (i * 7 % 13) as u8));
    }
    bytes
}

fn colmap_binary() -> Vec<u8> {
    let mut cameras = 1u64.to_le_bytes().to_vec();
    [7u32, 4].iter().for_each(|v| cameras.extend(v.to_le_bytes()));
    [8u64, 6].iter().for_each(|v| cameras.extend(v.to_le_bytes()));
    [9.0, 9.5, 4.0, 3.0, 0.1, 0.01, 1e-3, -1e-3f64]
        .iter()
        .for_each(|v| cameras.extend(v.to_le_bytes()));
    let mut images = 1u64.to_le_bytes().to_vec();
    images.extend(1u32.to_le_bytes());
    [1.0, 0.0, 0.5, 0.0, 0.0, 1.0, 2.0f64]
        .iter()
        .for_each(|v| images.extend(v.to_le_bytes()));
    images.extend(7u32.to_le_bytes());
    images.extend(b"a.png\0");
    images.extend(1u64.to_le_bytes());
    images.extend([0; 24]);
    let mut points = 1u64.to_le_bytes().to_vec();
    points.extend(5u64.to_le_bytes());
    [0.0, 1.0, 2.0f64].iter().for_each(|v| points.extend(v.to_le_bytes()));
    points.extend([255, 128, 0]);
    points.extend(0.5f64.to_le_bytes());
    points.extend(1u64.to_le_bytes());
    points.extend([0; 8]);
    let mut all = Vec::new();
    [cameras.len(), images.len()]
        .iter()
        .for_each(|length| all.extend((*length as u16).to_le_bytes()));
    [cameras, images, points].iter().for_each(|part| all.extend(part));
    all
}

const COLMAP: &str = "# cameras\n1 PINHOLE 8 6 9 9.5 4 3\n2 OPENCV 8 6 9 9 4 3 .1 .01 0 0\n\u{1e}# images\n\
1 1 0 0 0 0 0 1 1 a b.png\n\n2 0.5 0.5 0 0 1 2 3 2 sub/c.png\n1 2 -1 3 4 -1\n\u{1e}# points\n1 0 1 2 255 128 0 0.5 1 0\n\
2 -1 nan 2 1 2 3 0.5\n";

const NERFSTUDIO: &str = r#"{"camera_model":"OPENCV","w":8,"h":6,"fl_x":9,"fl_y":9.5,"cx":4,"cy":3,"k1":0.1,"p2":-0.01,
"ply_file_path":"cloud.ply","applied_transform":[[1,0,0,0],[0,1,0,0],[0,0,1,0]],"frames":[
{"file_path":"./a.png","transform_matrix":[[1,0,0,0],[0,0,-1,1],[0,1,0,2],[0,0,0,1]]},
{"file_path":"b.jpg","fl_x":10,"w":4.0,"h":3.0,"transform_matrix":[[2,0,0,0],[0,2,0,1],[0,0,2,2],[0,0,0,1]]}]}"#;

const BLENDER: &str = r#"{"camera_angle_x":0.7,"frames":[{"file_path":"a","rotation":0.1,"transform_matrix":
[[0,-1,0,4],[1,0,0,0.5],[0,0,1,-2e0],[0,0,0,1]]}]}"#;

/// A rig of two cameras and a frame of each, with the lengths of both files before.
fn colmap_rigs() -> Vec<u8> {
    let pose = [1.0, 0.0, 0.0, 0.0, 0.5, 0.0, 2.0_f64].map(f64::to_le_bytes).concat();
    let words = |words: &[u32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
    let rigs = [words(&[1, 0, 1, 2, 0, 1, 0, 2]), vec![1], pose.clone()].concat();
    let frame = |id: u32, sensor: u32| [words(&[id, 1]), pose.clone(), words(&[1, 0, sensor, id, 0])].concat();
    let frames = [words(&[2, 0]), frame(1, 1), frame(2, 2)].concat();
    let lengths = [rigs.len() as u16, frames.len() as u16].map(u16::to_le_bytes).concat();
    [lengths, rigs, frames].concat()
}

const CAMERA_TABLE: &str = "#cameras 2\r\n#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2\r\n\
a.png,44.5,-138.8,6.8,170.3,85.1,-22.7,14.2,-9.4e-004,2e-004,3e-003,4e-003,-1e-003,1e-4,1e-3,-1e-3\r\n\
b.jpg,1,2,3,10,90,0,24,0,0,0,0,0,0,0,0\r\n";

const CAMERA_TABLE_LEAST: &str = "#name,f,roll,pitch,heading,alt,y,x\na,20,1,2,3,4,5,6\n";

const METASHAPE: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0"><chunk label="Chunk 1" enabled="true"><sensors next_id="2">
<sensor id="0" label="frame" type="frame"><resolution width="8" height="6"/><calibration type="frame" class="adjusted">
<resolution width="8" height="6"/><f>9</f><cx>0.1</cx><cy>-0.2</cy><b1>0.3</b1><b2>-0.1</b2><k1>0.1</k1><k2>0.01</k2>
<k3>-0.01</k3><k4>0.001</k4><p1>0.001</p1><p2>-0.002</p2></calibration></sensor>
<sensor id="1" label="wide" type="fisheye"><resolution width="8" height="6"/><calibration type="fisheye">
<f>3</f><k1>0.02</k1></calibration></sensor></sensors>
<components next_id="1"><component id="0"><transform><rotation>0 -1 0 1 0 0 0 0 1</rotation>
<translation>10 20 30</translation><scale>2</scale></transform></component></components>
<cameras><group id="0" label="Group 1" type="folder"><camera id="0" sensor_id="0" component_id="0" label="/x/a.png">
<transform>1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1</transform></camera></group>
<camera id="1" sensor_id="1" component_id="0" label="b"><transform>0 0 1 1 1 0 0 2 0 1 0 3 0 0 0 1</transform></camera>
<camera id="2" sensor_id="1" label="c" enabled="false"/><camera id="3" sensor_id="1" label="d"/></cameras>
</chunk></document>"#;

const METASHAPE_PANORAMA: &str = r#"<document><chunk><sensors><sensor id="0" type="spherical">
<resolution width="8" height="6"/></sensor></sensors><cameras><camera id="0" sensor_id="0" label="a">
<transform>1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1</transform></camera></cameras>
<transform><scale>0.5</scale></transform></chunk></document>"#;

const VIEWER_PATH: &str = "{\"render_width\":8,\"render_height\":6,\"fps\":24,\"is_cycle\":true,\"camera_path\":[\
{\"camera_to_world\":[1,0,0,0,0,1,0,0,0,0,1,2,0,0,0,1],\"fov\":50},\
{\"camera_to_world\":[0,-1,0,4,1,0,0,0.5,0,0,1,-2,0,0,0,1],\"fov\":60.5}]}\u{1e}\
{\"transform\":[[0,-1,0,4],[1,0,0,0.5],[0,0,1,-2]],\"scale\":0.25}";

const INRIA_CAMERAS: &str = r#"[{"id":0,"img_name":"a","width":8,"height":6,"fx":9,"fy":9.5,"position":[1,2,3],
"rotation":[[1,0,0],[0,1,0],[0,0,1]]},{"width":4,"height":3,"fx":9,"fy":9,"position":[0,0,0],
"rotation":[[0,-1,0],[1,0,0],[0,0,1]]}]"#;

/// A camera with a still parent, whose rotation is animated from 0 to 0.5 seconds, and another.
const GLTF_CAMERAS: &str = r#"{"asset":{"version":"2.0"},"nodes":[{"children":[1],"translation":[1,2,3],"scale":[2,2,2]},
{"camera":0,"rotation":[0,0.6,0,0.8]},{"camera":0}],"cameras":[{"perspective":{"yfov":0.8,"aspectRatio":1.5}}],
"animations":[{"channels":[{"sampler":0,"target":{"node":1,"path":"rotation"}}],"samplers":[{"input":0,"output":1,
"interpolation":"STEP"}]}],"accessors":[{"bufferView":0,"componentType":5126,"count":2,"type":"SCALAR"},
{"bufferView":0,"componentType":5121,"normalized":true,"count":2,"type":"VEC4"}],"bufferViews":[{"buffer":0,
"byteLength":8}],"buffers":[{"byteLength":8,"uri":"data:;base64,AAAAAAAAAD8="}]}"#;

fn checkpoint() -> Vec<u8> {
    let mut config = TrainConfig::for_iterations(100);
    config.sh_degree = 0;
    let checkpoint = Checkpoint {
        config,
        iteration: 40,
        state: HostState::from_splats(&splats(0, ScreenFilter::Classic), 0),
        statistics: vec![[1.0, 2.0, 3.0, 0.0]; 2],
        colors: PendingColors::default(),
        fingerprint: 5,
        controller: None,
        exposure: None,
        poses: None,
        transients: None,
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    checkpoint.write(&path).unwrap();
    std::fs::read(path).unwrap()
}

const TETRAHEDRON: &str = "# a\nmtllib a.mtl\no a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1 1.0\nvt 0 0\nvn 0 0 1\n\
usemtl a\nf 1 3 2\nf 1/1 2/1 4/1\nf 1//1 4//1 3//1\ng b\nf -1/1/1 -2/1/1 -3/1/1\n";

const COLORS: &str = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0 0 1\nv 0 1 0 .5 .5 2\nf 1 2 3 4\n";
