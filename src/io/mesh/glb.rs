//! Writing a mesh as GLB.

use super::super::atomic::write_atomically;
use crate::error::{Error, Result};
use crate::scene::{Mesh, srgb_to_linear};
use glam::DVec3;
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;

/// Component types of glTF.
const FLOAT: u32 = 5126;
const U16: u32 = 5123;
const U32: u32 = 5125;
/// Targets of buffer views: vertices and indices.
const VERTICES: u32 = 34962;
const INDICES: u32 = 34963;

/// Data of an accessor.
struct BufferPart {
    name: &'static str,
    component: u32,
    shape: &'static str,
    count: usize,
    target: u32,
    bytes: Vec<u8>,
}

pub(super) fn write(path: &Path, mesh: &Mesh, origin: DVec3) -> Result<()> {
    let parts = parts(mesh);
    let mut text = document(mesh, &parts, origin).to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let buffer: usize = parts.iter().map(|part| part.bytes.len()).sum();
    let length = 12 + 8 + text.len() + if buffer > 0 { 8 + buffer } else { 0 };
    let Ok(length) = u32::try_from(length) else {
        return Err(Error::file(
            path,
            format!("{length} bytes are more than the 4 GiB of a GLB file"),
        ));
    };
    write_atomically(path, |file| {
        file.write_all(b"glTF")?;
        file.write_all(&2u32.to_le_bytes())?;
        file.write_all(&length.to_le_bytes())?;
        file.write_all(&(text.len() as u32).to_le_bytes())?;
        file.write_all(b"JSON")?;
        file.write_all(&text)?;
        if buffer > 0 {
            file.write_all(&(buffer as u32).to_le_bytes())?;
            file.write_all(b"BIN\0")?;
        }
        parts.iter().try_for_each(|part| file.write_all(&part.bytes))
    })
}

/// Attributes and indices; none of an empty mesh, as accessors are never empty.
fn parts(mesh: &Mesh) -> Vec<BufferPart> {
    if mesh.triangles.is_empty() {
        return Vec::new();
    }
    let floats = |values: &[[f32; 3]]| values.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
    let vertices = |name, component, shape, bytes: Vec<u8>| BufferPart {
        name,
        component,
        shape,
        count: mesh.positions.len(),
        target: VERTICES,
        bytes,
    };
    let mut parts = vec![vertices("POSITION", FLOAT, "VEC3", floats(&mesh.positions))];
    if !mesh.normals.is_empty() {
        parts.push(vertices("NORMAL", FLOAT, "VEC3", floats(&mesh.normals)));
    }
    if !mesh.colors.is_empty() {
        let color = |&[r, g, b]: &[f32; 3]| [level(r), level(g), level(b), u16::MAX].map(u16::to_le_bytes);
        let bytes = mesh.colors.iter().flat_map(color).flatten().collect();
        parts.push(vertices("COLOR_0", U16, "VEC4", bytes));
    }
    parts.push(BufferPart {
        name: "indices",
        component: U32,
        shape: "SCALAR",
        count: 3 * mesh.triangles.len(),
        target: INDICES,
        bytes: mesh
            .triangles
            .as_flattened()
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect(),
    });
    parts
}

/// A display-referred value as linear light in 65,535ths.
fn level(value: f32) -> u16 {
    // The cast saturates and sends NaN to 0.
    (srgb_to_linear(value.into()) * 65_535.0).round() as u16
}

fn document(mesh: &Mesh, parts: &[BufferPart], origin: DVec3) -> Value {
    let mut document = json!({
        "asset": { "version": "2.0", "generator": "ashfall" },
        "scene": 0,
        "scenes": [{}],
    });
    if parts.is_empty() {
        return document;
    }
    let (mut least, mut most) = (mesh.positions[0], mesh.positions[0]);
    for position in &mesh.positions {
        for axis in 0..3 {
            least[axis] = least[axis].min(position[axis]);
            most[axis] = most[axis].max(position[axis]);
        }
    }
    let (mut views, mut accessors, mut attributes) = (Vec::new(), Vec::new(), serde_json::Map::new());
    let mut at = 0;
    for (i, part) in parts.iter().enumerate() {
        let length = part.bytes.len();
        views.push(json!({ "buffer": 0, "byteOffset": at, "byteLength": length, "target": part.target }));
        at += length;
        let mut accessor =
            json!({ "bufferView": i, "componentType": part.component, "count": part.count, "type": part.shape });
        if part.component == U16 {
            accessor["normalized"] = true.into();
        }
        if part.name == "POSITION" {
            accessor["min"] = json!(least.map(f64::from));
            accessor["max"] = json!(most.map(f64::from));
        }
        accessors.push(accessor);
        if part.target == VERTICES {
            attributes.insert(part.name.into(), i.into());
        }
    }
    // Half a turn about z: from y down to y up.
    let mut node = json!({ "mesh": 0, "rotation": [0.0, 0.0, 1.0, 0.0] });
    if origin != DVec3::ZERO {
        node["translation"] = json!([-origin.x, -origin.y, origin.z]);
    }
    let material = json!({
        "doubleSided": true,
        "extensions": { "KHR_materials_unlit": {} },
        "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 1.0 },
    });
    let primitive = json!({ "attributes": attributes, "indices": parts.len() - 1, "material": 0 });
    document["extensionsUsed"] = json!(["KHR_materials_unlit"]);
    document["scenes"] = json!([{ "nodes": [0] }]);
    document["nodes"] = json!([node]);
    document["materials"] = json!([material]);
    document["meshes"] = json!([{ "primitives": [primitive] }]);
    document["accessors"] = accessors.into();
    document["bufferViews"] = views.into();
    document["buffers"] = json!([{ "byteLength": at }]);
    document
}
