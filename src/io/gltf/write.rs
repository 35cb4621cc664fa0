//! Writing a `.glb` file.

use super::super::atomic::write_atomically;
use super::{EXTENSION, glb};
use crate::error::{Error, Result};
use crate::scene::{Axes, SH_C0, Splats, sh_coefficient_count, sh_signs, sigmoid, srgb_to_linear};
use glam::DVec3;
use serde_json::{Value, json};
use std::io::{BufWriter, Write};
use std::path::Path;

/// Puts the bytes of a splat at an index behind others.
type Put<'a> = Box<dyn Fn(usize, &mut Vec<u8>) + 'a>;

/// An attribute: its name, type, bytes a splat, and bytes of a splat at an index.
struct Attribute<'a> {
    name: String,
    shape: &'static str,
    bytes: usize,
    put: Put<'a>,
}

/// Writes `splats` as a GLB file of one primitive with `KHR_gaussian_splatting` in floats, in glTF's axes, and with
/// `COLOR_0`, linear colours of 8 bits for viewers without the extension. The origin becomes the translation of the
/// node. Splats with a number that is not finite are left out, as glTF has no such numbers. Reading the file returns
/// equal positions and harmonics, bit for bit; scales, opacities and rotations to the rounding of floats, and a
/// logit above 17 as 20, since the opacity is 1 in floats. The filter on the screen has no place. The write is atomic.
///
/// # Errors
/// Besides those of the file system, more than 4 GiB.
pub fn write(path: &Path, splats: &Splats) -> Result<()> {
    let count = splats.len();
    assert_eq!(splats.quaternion.len(), count, "quaternions of all splats");
    assert_eq!(splats.log_scale.len(), count, "scales of all splats");
    assert_eq!(splats.opacity_logit.len(), count, "opacities of all splats");
    assert_eq!(splats.sh.len(), count * splats.sh_stride(), "harmonics");
    if splats.not_finite().is_some() {
        let sound: Vec<usize> = (0..count).filter(|&i| splats.is_finite(i)).collect();
        return write(path, &splats.picked(&sound));
    }
    let attributes = attributes(splats);
    let text = text(splats, &attributes);
    let buffer = buffer_bytes(splats, &attributes);
    let length = u32::try_from(length(text.len(), buffer)).map_err(|_| {
        let what = format!("{count} splats in {buffer} bytes are more than the 4 GiB of a GLB file");
        Error::file(path, what)
    })?;
    write_atomically(path, |file| {
        file.write_all(glb::MAGIC)?;
        file.write_all(&2u32.to_le_bytes())?;
        file.write_all(&length.to_le_bytes())?;
        write_chunk_header(file, text.len(), glb::JSON)?;
        file.write_all(&text)?;
        if buffer == 0 {
            return Ok(());
        }
        write_chunk_header(file, buffer, glb::BIN)?;
        let mut row = Vec::new();
        for attribute in &attributes {
            for index in 0..count {
                row.clear();
                (attribute.put)(index, &mut row);
                file.write_all(&row)?;
            }
        }
        Ok(())
    })
}

/// Bytes of the file that [`write()`] writes of finite splats.
pub fn byte_count(splats: &Splats) -> u64 {
    let attributes = attributes(splats);
    let text = text(splats, &attributes);
    length(text.len(), buffer_bytes(splats, &attributes)) as u64
}

/// Bytes of a file with these chunks.
fn length(text: usize, buffer: usize) -> usize {
    12 + 8 + text + if buffer > 0 { 8 + buffer } else { 0 }
}

fn buffer_bytes(splats: &Splats, attributes: &[Attribute<'_>]) -> usize {
    splats.len() * attributes.iter().map(|attribute| attribute.bytes).sum::<usize>()
}

/// Contents of the JSON chunk.
fn text(splats: &Splats, attributes: &[Attribute<'_>]) -> Vec<u8> {
    let mut text = document(splats, attributes).to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    text
}

fn write_chunk_header(file: &mut BufWriter<std::fs::File>, length: usize, kind: [u8; 4]) -> std::io::Result<()> {
    // In range: the file's length is.
    file.write_all(&(length as u32).to_le_bytes())?;
    file.write_all(&kind)
}

/// Signs of x, y and z from this engine's axes to glTF's.
fn signs() -> [f32; 3] {
    let turn = Axes::RDF.to(Axes::LUF);
    [turn.x_axis.x, turn.y_axis.y, turn.z_axis.z].map(|sign| sign as f32)
}

fn attributes(splats: &Splats) -> Vec<Attribute<'_>> {
    let floats = |values: &[f32], row: &mut Vec<u8>| values.iter().for_each(|v| row.extend(v.to_le_bytes()));
    let attribute = |name: &str, shape, bytes, put| Attribute {
        name: name.to_owned(),
        shape,
        bytes,
        put,
    };
    let own = |name: &str| format!("{EXTENSION}:{name}");
    let (stride, [x, y, z]) = (splats.sh_stride(), signs());
    let mut attributes = vec![
        attribute(
            "POSITION",
            "VEC3",
            12,
            Box::new(move |i, row| floats(&position(splats, i), row)),
        ),
        attribute(
            "COLOR_0",
            "VEC4",
            4,
            Box::new(move |i, row| row.extend(fallback(splats, i))),
        ),
        attribute(
            &own("ROTATION"),
            "VEC4",
            16,
            Box::new(move |i, row| {
                let [qw, qx, qy, qz] = unit(splats.quaternion[i]);
                floats(&[y * z * qx, x * z * qy, x * y * qz, qw], row);
            }),
        ),
        attribute(
            &own("SCALE"),
            "VEC3",
            12,
            Box::new(move |i, row| {
                let scale = splats.log_scale[i].map(|log| f64::from(log).exp().min(f32::MAX.into()) as f32);
                floats(&scale, row);
            }),
        ),
        attribute(
            &own("OPACITY"),
            "SCALAR",
            4,
            Box::new(move |i, row| floats(&[sigmoid(splats.opacity_logit[i].into()) as f32], row)),
        ),
    ];
    let parity = sh_signs(signs());
    let names = (0..=splats.sh_degree).flat_map(|l| (0..=2 * l).map(move |n| format!("SH_DEGREE_{l}_COEF_{n}")));
    for (k, name) in names.enumerate() {
        let put = move |i: usize, row: &mut Vec<u8>| {
            let coefficient = &splats.sh[i * stride + 3 * k..][..3];
            coefficient
                .iter()
                .for_each(|v| row.extend((parity[k] * v).to_le_bytes()));
        };
        attributes.push(attribute(&own(&name), "VEC3", 12, Box::new(put)));
    }
    debug_assert_eq!(attributes.len(), 5 + sh_coefficient_count(splats.sh_degree));
    attributes
}

fn position(splats: &Splats, index: usize) -> [f32; 3] {
    let ([x, y, z], mean) = (signs(), splats.mean[index]);
    [x * mean[0], y * mean[1], z * mean[2]]
}

/// Quaternion of length 1; no rotation for one of length zero.
fn unit(quaternion: [f32; 4]) -> [f32; 4] {
    let q = quaternion.map(f64::from);
    let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    match length > 0.0 {
        true => q.map(|v| (v / length) as f32),
        false => [1.0, 0.0, 0.0, 0.0],
    }
}

/// Linear colour without harmonics above degree 0, and opacity, in 255ths.
fn fallback(splats: &Splats, index: usize) -> [u8; 4] {
    let byte = |share: f64| (255.0 * share).round() as u8;
    let constant = &splats.sh[index * splats.sh_stride()..][..3];
    let color = |c: usize| byte(srgb_to_linear((0.5 + f64::from(SH_C0 * constant[c])).clamp(0.0, 1.0)));
    [
        color(0),
        color(1),
        color(2),
        byte(sigmoid(splats.opacity_logit[index].into())),
    ]
}

/// The JSON chunk. Without splats there is no mesh, as accessors and buffers are never empty.
fn document(splats: &Splats, attributes: &[Attribute]) -> Value {
    let count = splats.len();
    let mut document = json!({
        "asset": { "version": "2.0", "generator": "ashfall" },
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{}],
    });
    if count == 0 {
        return document;
    }
    let (mut least, mut most) = (position(splats, 0), position(splats, 0));
    for i in 0..count {
        for (axis, value) in position(splats, i).into_iter().enumerate() {
            (least[axis], most[axis]) = (least[axis].min(value), most[axis].max(value));
        }
    }
    let (mut views, mut accessors, mut by_name) = (Vec::new(), Vec::new(), serde_json::Map::new());
    let mut at = 0;
    for (index, attribute) in attributes.iter().enumerate() {
        let length = count * attribute.bytes;
        // 34962: data of vertices.
        views.push(json!({ "buffer": 0, "byteOffset": at, "byteLength": length, "target": 34962 }));
        at += length;
        let component = if attribute.name == "COLOR_0" { 5121 } else { 5126 };
        let mut accessor =
            json!({ "bufferView": index, "componentType": component, "count": count, "type": attribute.shape });
        match attribute.name.as_str() {
            "COLOR_0" => accessor["normalized"] = true.into(),
            "POSITION" => {
                accessor["min"] = json!(least.map(f64::from));
                accessor["max"] = json!(most.map(f64::from));
            }
            _ => {}
        }
        accessors.push(accessor);
        by_name.insert(attribute.name.clone(), index.into());
    }
    let mut node = json!({ "mesh": 0 });
    if splats.origin != DVec3::ZERO {
        let origin = splats.origin * DVec3::from(signs().map(f64::from));
        node["translation"] = json!(origin.to_array());
        node["extras"] = json!({ "splatOrigin": true });
    }
    let splatting = json!({
        "kernel": "ellipse",
        "colorSpace": "srgb_rec709_display",
        "projection": "perspective",
        "sortingMethod": "cameraDistance",
    });
    let primitive = json!({ "mode": 0, "attributes": by_name, "extensions": { EXTENSION: splatting } });
    document["scenes"] = json!([{ "nodes": [0] }]);
    document["nodes"] = json!([node]);
    document["meshes"] = json!([{ "primitives": [primitive] }]);
    document["accessors"] = accessors.into();
    document["bufferViews"] = views.into();
    document["buffers"] = json!([{ "byteLength": at }]);
    document
}
