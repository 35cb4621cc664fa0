//! glTF with splats: files of other writers, every form of accessor, and nodes.

use crate::io::fixtures::{Bounds, assert_close, unpacked};
use crate::io::shared;
use crate::io::spz::decoding;
use ashfall::io::{AxesBy, LoadedSplats, Source, gltf, ply, splats, spz};
use ashfall::scene::{Axes, ScreenFilter, Splats};
use glam::{DQuat, DVec3};
use serde_json::{Value, json};
use std::path::Path;

/// A third of 255 and of 65,535 is whole.
const THIRD: f32 = 1.0 / 3.0;

/// An accessor to be: rows of bytes with their distance.
#[derive(Clone)]
pub(super) struct Rows {
    name: &'static str,
    shape: &'static str,
    component: u32,
    normalized: bool,
    stride: usize,
    bytes: Vec<u8>,
}

pub(super) fn floats(name: &'static str, shape: &'static str, values: &[f32]) -> Rows {
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let stride = 4 * width(shape);
    Rows {
        name,
        shape,
        component: 5126,
        normalized: false,
        stride,
        bytes,
    }
}

fn width(shape: &str) -> usize {
    ["SCALAR", "", "VEC3", "VEC4"].iter().position(|s| *s == shape).unwrap() + 1
}

/// Two splats without harmonics: at 1, 2, 3 and 4, 5, 6.
pub(super) fn two() -> Vec<Rows> {
    vec![
        floats("POSITION", "VEC3", &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
        floats("ROTATION", "VEC4", &[0.0, 0.6, 0.0, 0.8, 1.0, 0.0, 0.0, 0.0]),
        floats("SCALE", "VEC3", &[0.5, 1.0, 2.0, 0.25, 0.25, 0.25]),
        floats("OPACITY", "SCALAR", &[0.5, 0.75]),
        floats("SH_DEGREE_0_COEF_0", "VEC3", &[0.1, 0.2, 0.3, -0.1, -0.2, -0.3]),
    ]
}

/// A document with one node and one primitive of `rows`, and its buffer. Names get the extension's prefix, but for
/// names of capitals and digits alone that glTF knows, and those that begin with `_`.
pub(super) fn document(rows: &[Rows]) -> (Value, Vec<u8>) {
    let (mut views, mut accessors, mut attributes) = (Vec::new(), Vec::new(), serde_json::Map::new());
    let mut buffer = Vec::new();
    for (index, rows) in rows.iter().enumerate() {
        let mut view = json!({ "buffer": 0, "byteOffset": buffer.len(), "byteLength": rows.bytes.len() });
        let tight = width(rows.shape) * [1, 1, 2, 2, 0, 4, 4][rows.component as usize - 5120];
        if rows.stride != tight {
            view["byteStride"] = rows.stride.into();
        }
        views.push(view);
        accessors.push(json!({
            "bufferView": index, "componentType": rows.component, "normalized": rows.normalized,
            "count": rows.bytes.len().div_ceil(rows.stride), "type": rows.shape,
        }));
        let is_plain = rows.name.starts_with('_') || ["POSITION", "COLOR_0"].contains(&rows.name);
        let prefix = if is_plain { "" } else { "KHR_gaussian_splatting:" };
        attributes.insert(format!("{prefix}{}", rows.name), index.into());
        buffer.extend(&rows.bytes);
        buffer.resize(buffer.len().next_multiple_of(4), 0);
    }
    let splatting = json!({ "kernel": "ellipse", "colorSpace": "srgb_rec709_display" });
    let document = json!({
        "asset": { "version": "2.0" }, "extensionsUsed": ["KHR_gaussian_splatting"],
        "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "mode": 0, "attributes": attributes,
            "extensions": { "KHR_gaussian_splatting": splatting } }] }],
        "accessors": accessors, "bufferViews": views, "buffers": [{ "byteLength": buffer.len() }],
    });
    (document, buffer)
}

/// A GLB file of a document and its buffer.
pub(super) fn glb(document: &Value, buffer: &[u8]) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend((28 + text.len() as u32 + buffer.len() as u32).to_le_bytes());
    file.extend((text.len() as u32).to_le_bytes());
    file.extend(b"JSON");
    file.extend(text);
    file.extend((buffer.len() as u32).to_le_bytes());
    file.extend(b"BIN\0");
    file.extend(buffer);
    file
}

pub(super) fn read(bytes: &[u8]) -> LoadedSplats {
    gltf::read(Source::bytes(Path::new("scene.glb"), bytes)).unwrap()
}

/// Splats of a generated file without warnings.
pub(super) fn clean(bytes: &[u8]) -> Splats {
    let loaded = read(bytes);
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    loaded.splats
}

fn of(rows: &[Rows]) -> Splats {
    let (document, buffer) = document(rows);
    clean(&glb(&document, &buffer))
}

fn opacity(splats: &Splats, index: usize) -> f32 {
    1.0 / (1.0 + (-splats.opacity_logit[index]).exp())
}

fn made(count: usize, sh_degree: u32) -> Splats {
    let number = |i: usize| (1.3 * i as f32).sin();
    let stride = 3 * (sh_degree as usize + 1).pow(2);
    Splats {
        mean: (0..count).map(|i| [number(i), number(i + 7), number(i + 31)]).collect(),
        quaternion: (0..count).map(|i| [number(2 * i), 0.3, number(3 * i), -0.2]).collect(),
        log_scale: (0..count).map(|i| [4.0 * number(i), -3.0, 1.0]).collect(),
        opacity_logit: (0..count).map(|i| 8.0 * number(5 * i)).collect(),
        sh: (0..count * stride).map(number).collect(),
        sh_degree,
        ..Splats::default()
    }
}

#[test]
fn files_of_splat_transform_are_their_sources() {
    for degree in 0..3 {
        let name = format!("playbot600_sh{degree}");
        let Some(path) = shared(&format!("formats/splat-transform-3.7.0/{name}.glb")) else {
            return;
        };
        let source = shared(&format!("formats/source/{name}.ply")).unwrap();
        let wanted = ply::read(&source).unwrap().splats;
        let loaded = splats::read(&path).unwrap();
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        assert_eq!((loaded.stored.format.as_str(), loaded.stored.axes), ("glTF", Axes::LUF));
        assert_eq!(loaded.splats.mean, wanted.mean);
        assert_eq!(loaded.splats.sh, wanted.sh);
        assert_close(&loaded.splats, &wanted, Bounds::EXACT, &name);
    }
}

#[test]
fn quantised_splats_of_a_node_are_placed() {
    let name = "playbot600_sh2.quantised_node.glb";
    let Some(path) = shared(&format!("formats/handmade/{name}")) else {
        return;
    };
    let expected = shared(&format!("formats/expected/handmade__{name}.local_luf.ply.gz")).unwrap();
    let mut wanted = unpacked(&expected);
    // A quarter turn about y: x to −z, z to x.
    wanted.rotate(DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2));
    for mean in &mut wanted.mean {
        *mean = [2.0 * mean[0] + 1.0, 2.0 * mean[1] + 2.0, 2.0 * mean[2] + 3.0];
    }
    let scale = wanted.log_scale.as_flattened_mut();
    scale.iter_mut().for_each(|log| *log += 2f32.ln());
    let loaded = gltf::read(&path).unwrap();
    assert_eq!(loaded.warnings.len(), 1, "{:?}", loaded.warnings);
    assert!(
        loaded.warnings[0].contains("lin_rec709_display"),
        "{:?}",
        loaded.warnings
    );
    assert_close(&loaded.splats, &wanted, Bounds::EXACT, "quantised");
    let folder = shared("formats/handmade/playbot600_sh2_gltf/scene.gltf").unwrap();
    assert_eq!(gltf::read(&folder).unwrap().splats, loaded.splats);
}

#[test]
fn spz_files_inside_unpack() {
    for name in ["playbot600_sh2.spz_2.glb", "playbot600_sh2.spz_2_v4payload.glb"] {
        let Some(path) = shared(&format!("formats/handmade/{name}")) else {
            return;
        };
        let wanted = unpacked(&shared(&format!("formats/expected/handmade__{name}.luf.ply.gz")).unwrap());
        let loaded = gltf::read(&path).unwrap();
        assert_eq!(loaded.warnings.len(), 1, "{:?}", loaded.warnings);
        assert!(loaded.warnings[0].contains("RUB was assumed"), "{:?}", loaded.warnings);
        let version = if name.contains("v4payload") { 4 } else { 2 };
        assert_close(&loaded.splats, &wanted, decoding(version), name);
    }
}

/// A document whose splats are the SPZ file `payload`, under the extension's name or a draft's.
pub(super) fn around(payload: &[u8], name: &str, is_nested: bool) -> Vec<u8> {
    let mut buffer = payload.to_vec();
    buffer.resize(buffer.len().next_multiple_of(4), 0);
    let extension = json!({ name: { "bufferView": 0 } });
    let extensions = match is_nested {
        true => json!({ "KHR_gaussian_splatting": { "extensions": extension } }),
        false => extension,
    };
    let document = json!({
        "asset": { "version": "2.0" }, "extensionsRequired": [name], "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "extensions": extensions }] }],
        "accessors": [{ "componentType": 5126, "count": 2, "type": "VEC3" }],
        "bufferViews": [{ "buffer": 0, "byteLength": payload.len() }], "buffers": [{ "byteLength": buffer.len() }],
    });
    glb(&document, &buffer)
}

#[test]
fn spz_files_are_known_by_all_names_and_keep_their_axes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.spz");
    let mut scene = made(20, 1);
    scene.filter = ScreenFilter::Mip;
    spz::write(&path, &scene).unwrap();
    let payload = std::fs::read(&path).unwrap();
    let mut wanted = spz::read(&path).unwrap();
    assert_eq!(wanted.stored.axes_by, AxesBy::File);
    wanted.splats.change_axes(wanted.stored.axes, Axes::LUF);
    for (name, is_nested) in [
        ("KHR_gaussian_splatting_compression_spz_2", true),
        ("KHR_gaussian_splatting_compression_spz", true),
        ("KHR_spz_gaussian_splats_compression", false),
        ("KHR_spz_compression", false),
    ] {
        let found = clean(&around(&payload, name, is_nested));
        assert_close(&found, &wanted.splats, Bounds::EXACT, name);
        assert_eq!(
            (found.mean, found.filter),
            (wanted.splats.mean.clone(), ScreenFilter::Mip)
        );
    }
}

#[test]
fn our_files_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.glb");
    for degree in 0..4 {
        let mut wanted = made(50, degree);
        wanted.mean[0] = [0.0, -0.0, 0.0];
        for origin in [DVec3::ZERO, DVec3::new(0.1, -1.0 / 3.0, 4e6)] {
            wanted.origin = origin;
            splats::write(&path, &wanted).unwrap();
            let loaded = splats::read(&path).unwrap();
            assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
            let found = loaded.splats;
            assert_eq!(found.origin, wanted.origin);
            let bits = |values: &[f32]| -> Vec<u32> { values.iter().map(|v| v.to_bits()).collect() };
            assert_eq!(bits(found.mean.as_flattened()), bits(wanted.mean.as_flattened()));
            assert_eq!(bits(&found.sh), bits(&wanted.sh));
            assert_close(&found, &wanted, Bounds::EXACT, "our own");
            let first = std::fs::read(&path).unwrap();
            splats::write(&path, &wanted).unwrap();
            assert_eq!(std::fs::read(&path).unwrap(), first, "the same bytes");
        }
    }
    splats::write(&path, &Splats::default()).unwrap();
    let empty = splats::read(&path).unwrap();
    assert!(empty.splats.is_empty() && empty.warnings[0].contains("holds no splats"));
}

#[test]
fn only_the_filter_has_no_place() {
    let mut scene = made(1, 3);
    scene.origin = DVec3::ONE;
    scene.filter = ScreenFilter::Mip;
    let losses = splats::losses(Path::new("a.glb"), &scene);
    assert_eq!(losses, ["glTF files have no place for the render mode \"mip\""]);
    let text = splats::write(Path::new("a.gltf"), &scene).unwrap_err().to_string();
    assert!(text.contains(".glb") && text.contains(".gltf"), "{text}");
}

#[test]
fn splats_that_are_not_finite_are_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.glb");
    let mut scene = made(3, 1);
    scene.mean[1][2] = f32::NAN;
    gltf::write(&path, &scene).unwrap();
    assert_eq!(splats::read(&path).unwrap().splats.mean, scene.picked(&[0, 2]).mean);
}

/// Half a turn about z, from the engine's axes to those of glTF: signs of x, y, z; of the quaternion's x, y, z; of the
/// bands; from their parity.
#[test]
fn the_numbers_in_our_file_have_the_signs_of_the_turn() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.glb");
    let scene = Splats {
        mean: vec![[1.0, 2.0, 3.0]],
        quaternion: vec![[0.5; 4]],
        log_scale: vec![[0.0; 3]],
        opacity_logit: vec![0.0],
        sh: vec![1.0; 48],
        sh_degree: 3,
        ..Splats::default()
    };
    gltf::write(&path, &scene).unwrap();
    let file = std::fs::read(&path).unwrap();
    let length = u32::from_le_bytes(file[12..16].try_into().unwrap()) as usize;
    let text: Value = serde_json::from_slice(&file[20..20 + length]).unwrap();
    let numbers = |name: &str, count: usize| -> Vec<f32> {
        let accessor = &text["meshes"][0]["primitives"][0]["attributes"][name];
        let view = &text["accessors"][accessor.as_u64().unwrap() as usize]["bufferView"];
        let at = text["bufferViews"][view.as_u64().unwrap() as usize]["byteOffset"]
            .as_u64()
            .unwrap();
        let bytes = &file[28 + length + at as usize..][..4 * count];
        bytes
            .chunks(4)
            .map(|four| f32::from_le_bytes(four.try_into().unwrap()))
            .collect()
    };
    assert_eq!(numbers("POSITION", 3), [-1.0, -2.0, 3.0]);
    assert_eq!(numbers("KHR_gaussian_splatting:ROTATION", 4), [-0.5, -0.5, 0.5, 0.5]);
    assert_eq!(numbers("KHR_gaussian_splatting:SCALE", 3), [1.0; 3]);
    assert_eq!(numbers("KHR_gaussian_splatting:OPACITY", 1), [0.5]);
    for (degree, signs) in ["+", "-+-", "+-+-+", "-+-+-+-"].iter().enumerate() {
        for (n, sign) in signs.chars().enumerate() {
            let wanted = if sign == '+' { 1.0 } else { -1.0 };
            let name = format!("KHR_gaussian_splatting:SH_DEGREE_{degree}_COEF_{n}");
            assert_eq!(numbers(&name, 3), [wanted; 3], "{name}");
        }
    }
    assert_eq!(text["accessors"][0]["min"], json!([-1.0, -2.0, 3.0]));
    assert_eq!(text["accessors"][0]["max"], json!([-1.0, -2.0, 3.0]));
    assert_eq!(text["asset"], json!({ "version": "2.0", "generator": "ashfall" }));
    // 0.782 in sRGB is 0.574 of linear light.
    let color = text["bufferViews"][1]["byteOffset"].as_u64().unwrap() as usize;
    assert_eq!(file[28 + length + color..][..4], [146, 146, 146, 128]);
}

#[test]
fn every_type_of_component_decodes() {
    let plain = of(&two());
    assert_eq!(plain.mean, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
    assert_eq!(plain.quaternion, [[0.8, 0.0, 0.6, 0.0], [0.0, 1.0, 0.0, 0.0]]);
    assert_eq!(plain.sh, [0.1, 0.2, 0.3, -0.1, -0.2, -0.3]);
    assert_eq!(plain.log_scale[0], [0.5f32.ln(), 0.0, 2f32.ln()]);
    assert!((opacity(&plain, 0) - 0.5).abs() < 1e-6 && (opacity(&plain, 1) - 0.75).abs() < 1e-6);
    let bytes = |values: &[i32], size: usize| -> Vec<u8> {
        values
            .iter()
            .flat_map(|v| v.to_le_bytes().into_iter().take(size))
            .collect()
    };
    let with = |at: usize, shape, component, normalized, stride, bytes| {
        let mut rows = two();
        let name = rows[at].name;
        rows[at] = Rows {
            name,
            shape,
            component,
            normalized,
            stride,
            bytes,
        };
        of(&rows)
    };
    for (component, one, size) in [(5120, 127, 1), (5122, 32_767, 2)] {
        // The least number stands for −1, as its neighbour does.
        let values = bytes(&[0, one, 0, 0, 0, 0, -one - 1, 0], size);
        let found = with(1, "VEC4", component, true, 4 * size, values);
        assert_eq!(found.quaternion, [[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, -1.0]]);
    }
    for (component, one, size, stride) in [(5121, 255, 1, 4), (5123, 65_535, 2, 8)] {
        let mut values = bytes(&[one, one / 3, 0], size);
        values.resize(stride, 0xaa);
        values.extend(bytes(&[one, one, one], size));
        let found = with(2, "VEC3", component, true, stride, values.clone());
        assert_eq!(found.log_scale[1], [0.0; 3]);
        let [a, b, c] = found.log_scale[0];
        assert!(a == 0.0 && (b - THIRD.ln()).abs() < 1e-6 && (c - 1e-10f32.ln()).abs() < 1e-5);
        let found = with(2, "VEC3", component, false, stride, values);
        assert!((found.log_scale[1][0] - (one as f32).ln()).abs() < 1e-6);
        let mut values = bytes(&[one / 3], size);
        values.resize(4, 0xaa);
        values.extend(bytes(&[one], size));
        let found = with(3, "SCALAR", component, true, 4, values);
        assert!((opacity(&found, 0) - THIRD).abs() < 1e-6, "{}", opacity(&found, 0));
        assert_eq!(found.opacity_logit[1], 20.0);
    }
    let (mut document, buffer) = document(&two());
    document["accessors"][0]["componentType"] = 5122.into();
    document["extensionsUsed"] = json!(["KHR_gaussian_splatting", "KHR_mesh_quantization"]);
    let found = clean(&glb(&document, &buffer));
    // The low and high halves of 1.0 and 2.0.
    assert_eq!(found.mean[0], [0.0, f32::from(0x3f80u16), 0.0]);
}

#[test]
fn rows_may_lie_anywhere() {
    let wanted = of(&two());
    // Interleaved position and scale in one view, after 8 foreign bytes.
    let mut rows = two();
    let (mean, scale) = (rows[0].bytes.clone(), rows[2].bytes.clone());
    let pairs: Vec<u8> = (0..2)
        .flat_map(|i| [&mean[12 * i..][..12], &scale[12 * i..][..12]].concat())
        .collect();
    rows[0].bytes = [vec![9; 8], pairs].concat();
    rows[0].stride = 24;
    let (mut file, buffer) = document(&rows);
    file["accessors"][0]["byteOffset"] = 8.into();
    file["accessors"][0]["count"] = 2.into();
    file["accessors"][2]["bufferView"] = 0.into();
    file["accessors"][2]["byteOffset"] = 20.into();
    assert_eq!(clean(&glb(&file, &buffer)), wanted);
}

#[test]
fn sparse_rows_replace_others_and_zeros() {
    let mut rows = two();
    let index = Rows {
        name: "_INDEX",
        shape: "SCALAR",
        component: 5123,
        normalized: false,
        stride: 2,
        bytes: vec![1, 0],
    };
    rows.push(index);
    rows.push(floats("_VALUE", "VEC3", &[7.0, 8.0, 9.0]));
    let (mut file, buffer) = document(&rows);
    file["accessors"][0]["sparse"] = json!({
        "count": 1, "indices": { "bufferView": 5, "componentType": 5123 }, "values": { "bufferView": 6 }
    });
    assert_eq!(clean(&glb(&file, &buffer)).mean, [[1.0, 2.0, 3.0], [7.0, 8.0, 9.0]]);
    let accessor = file["accessors"][0].as_object_mut().unwrap();
    accessor.remove("bufferView");
    assert_eq!(clean(&glb(&file, &buffer)).mean, [[0.0; 3], [7.0, 8.0, 9.0]]);
    file["accessors"][0].as_object_mut().unwrap().remove("sparse");
    assert_eq!(clean(&glb(&file, &buffer)).mean, [[0.0; 3]; 2]);
}

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for three in bytes.chunks(3) {
        let bits = (0..3).fold(0, |bits, i| bits << 8 | u32::from(*three.get(i).unwrap_or(&0)));
        let digits = (0..=three.len()).map(|i| char::from(DIGITS[(bits >> (18 - 6 * i) & 63) as usize]));
        text.extend(digits);
        text.extend(std::iter::repeat_n('=', 3 - three.len()));
    }
    text
}

#[test]
fn buffers_may_be_texts_and_files() {
    let wanted = of(&two());
    let (mut file, buffer) = document(&two());
    let (first, second) = buffer.split_at(24);
    for view in file["bufferViews"].as_array_mut().unwrap().iter_mut().skip(1) {
        view["buffer"] = 1.into();
        view["byteOffset"] = (view["byteOffset"].as_u64().unwrap() - 24).into();
    }
    let address = format!("data:application/octet-stream;base64,{}", base64(first));
    file["buffers"] = json!([
        { "byteLength": 24, "uri": address },
        { "byteLength": second.len(), "uri": "sub/a%20b.bin" },
    ]);
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("sub")).unwrap();
    std::fs::write(folder.path().join("sub/a b.bin"), second).unwrap();
    let path = folder.path().join("scene.gltf");
    std::fs::write(&path, file.to_string()).unwrap();
    let loaded = gltf::read(&path).unwrap();
    assert_eq!((loaded.warnings.len(), loaded.splats), (0, wanted.clone()));
    file["buffers"][1]["uri"] = format!("data:;base64,{}", base64(second)).into();
    assert_eq!(clean(format!("\u{feff} {file}").as_bytes()), wanted);
}
