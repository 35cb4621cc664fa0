//! Nodes of glTF: places, instances, origins; several primitives; drafts; warnings.

use crate::io::gltf::{clean, document, floats, glb, read, two};
use ashfall::scene::{Splats, sh_basis};
use glam::{DMat3, DQuat, DVec3};
use serde_json::{Value, json};

fn covariance(splats: &Splats, index: usize) -> DMat3 {
    let [w, x, y, z] = splats.quaternion[index].map(f64::from);
    let scale = DMat3::from_diagonal(DVec3::from(splats.log_scale[index].map(|s| f64::from(s).exp())));
    let factor = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize()) * scale;
    factor * factor.transpose()
}

/// Red channel of a splat's colour.
fn color(splats: &Splats, index: usize, direction: DVec3) -> f64 {
    let stride = splats.sh_stride();
    let red = splats.sh[index * stride..][..stride].iter().step_by(3);
    let basis = sh_basis(direction.into());
    red.zip(basis).map(|(c, b)| f64::from(*c) * b).sum()
}

fn mean(splats: &Splats, index: usize) -> DVec3 {
    DVec3::from(splats.mean[index].map(f64::from))
}

/// Two splats of degree 3.
fn lit() -> (Value, Vec<u8>) {
    let names = (1..=3).flat_map(|l| (0..=2 * l).map(move |n| format!("SH_DEGREE_{l}_COEF_{n}")));
    let mut rows = two();
    for (k, name) in (1..).zip(names) {
        let values: Vec<f32> = (0..6).map(|i| (1.7 * (6 * k + i) as f32).sin()).collect();
        rows.push(floats(name.leak(), "VEC3", &values));
    }
    document(&rows)
}

/// Asserts that splats are those without the node, under an affine map with this rotation.
#[track_caller]
fn assert_placed(found: &Splats, local: &Splats, linear: DMat3, rotation: DMat3, translation: DVec3) {
    for i in 0..local.len() {
        let wanted = linear * mean(local, i) + translation - found.origin;
        assert!(
            (mean(found, i) - wanted).length() < 1e-6 * (1.0 + wanted.length()),
            "{i}: {wanted}"
        );
        let wanted = linear * covariance(local, i) * linear.transpose();
        let off = (covariance(found, i) - wanted).to_cols_array();
        let size = wanted.to_cols_array().iter().fold(0.0f64, |a, b| a.max(b.abs()));
        assert!(off.iter().all(|v| v.abs() < 2e-6 * size), "{i}: {off:?} of {size}");
        for k in 0..20 {
            let t = f64::from(k);
            let d = DVec3::new((1.3 * t).sin(), (2.1 * t).cos(), (0.7 * t).sin()).normalize();
            let (a, b) = (color(local, i, d), color(found, i, rotation * d));
            assert!((a - b).abs() < 1e-5, "{i}: {a} {b}");
        }
    }
}

#[test]
fn nodes_move_rotate_and_scale() {
    let (file, buffer) = lit();
    let local = clean(&glb(&file, &buffer));
    let rotation = DQuat::from_xyzw(0.1, -0.7, 0.4, 0.5).normalize();
    let turn = DMat3::from_quat(rotation);
    let t = DVec3::new(-3.0, 0.5, 7.0);
    for scale in [
        DVec3::ONE,
        DVec3::splat(3.5),
        DVec3::new(0.25, 2.0, 9.0),
        DVec3::new(-2.0, -2.0, 2.0),
    ] {
        let linear = turn * DMat3::from_diagonal(scale);
        // Two negative scales are half a turn.
        let signs = DMat3::from_diagonal(scale.signum());
        let mut by_parts = file.clone();
        by_parts["nodes"][0]["translation"] = json!(t.to_array());
        by_parts["nodes"][0]["rotation"] = json!(rotation.to_array());
        by_parts["nodes"][0]["scale"] = json!(scale.to_array());
        let found = clean(&glb(&by_parts, &buffer));
        assert_placed(&found, &local, linear, turn * signs, t);
        let [x, y, z] = [linear.x_axis, linear.y_axis, linear.z_axis];
        let mut by_matrix = file.clone();
        let matrix = [x.extend(0.0), y.extend(0.0), z.extend(0.0), t.extend(1.0)];
        by_matrix["nodes"][0]["matrix"] = json!(matrix.map(|c| c.to_array()).concat());
        let other = clean(&glb(&by_matrix, &buffer));
        assert_placed(&other, &local, linear, turn * signs, t);
        // A chain: scale below rotation below translation.
        let mut chain = file.clone();
        chain["nodes"] = json!([
            { "translation": t.to_array(), "children": [2] },
            { "mesh": 0, "scale": scale.to_array() },
            { "rotation": rotation.to_array(), "children": [1] },
        ]);
        let third = clean(&glb(&chain, &buffer));
        assert_placed(&third, &local, linear, turn * signs, t);
    }
}

#[test]
fn every_instance_adds_splats_of_the_default_scene() {
    let (mut file, buffer) = document(&two());
    file["nodes"] = json!([
        { "mesh": 0, "translation": [10, 0, 0], "children": [2] },
        { "mesh": 0, "translation": [0, 0, 99] },
        { "mesh": 0, "translation": [0, 20, 0] },
        { "mesh": 0 },
    ]);
    file["scenes"] = json!([{ "nodes": [1] }, { "nodes": [0, 3] }]);
    file["scene"] = 1.into();
    let found = clean(&glb(&file, &buffer));
    let wanted = [
        [11.0, 2.0, 3.0],
        [14.0, 5.0, 6.0],
        [11.0, 22.0, 3.0],
        [14.0, 25.0, 6.0],
        [1.0, 2.0, 3.0],
        [4.0, 5.0, 6.0],
    ];
    assert_eq!(found.mean, wanted);
    // Without scenes all roots count.
    for member in ["scene", "scenes"] {
        file.as_object_mut().unwrap().remove(member);
    }
    assert_eq!(clean(&glb(&file, &buffer)).len(), 8);
}

/// Positions on the ellipsoid of the Earth, in metres, keep micrometres.
#[test]
fn a_far_translation_becomes_the_origin() {
    let (mut file, buffer) = document(&two());
    let t = DVec3::new(4_041_816.123_456, 470_156.654_321, 4_893_114.000_001);
    file["nodes"][0]["translation"] = json!(t.to_array());
    let found = clean(&glb(&file, &buffer));
    assert_eq!(found.origin, t);
    assert_eq!(found.mean, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
    // The second of two instances is relative to the first.
    file["nodes"]
        .as_array_mut()
        .unwrap()
        .push(json!({ "mesh": 0, "translation": (t + DVec3::X).to_array() }));
    file["scenes"][0]["nodes"] = json!([0, 1]);
    let found = clean(&glb(&file, &buffer));
    assert_eq!(found.origin, t);
    assert_eq!(found.mean[2..], [[2.0, 2.0, 3.0], [5.0, 5.0, 6.0]]);
    // A thousand times the size, and just not: the sizes are 3.7 + 2 and 8.8 + 0.25, of which the larger counts.
    for (distance, is_far) in [(8_900.0, false), (9_100.0, true)] {
        let (mut file, buffer) = document(&two());
        file["nodes"][0]["translation"] = json!([0.0, distance, 0.0]);
        let found = clean(&glb(&file, &buffer));
        assert_eq!(found.origin == DVec3::ZERO, !is_far, "{distance}");
        assert!((mean(&found, 0) + found.origin - DVec3::new(1.0, distance + 2.0, 3.0)).length() < 1e-3);
    }
}

#[test]
fn primitives_of_lower_degree_are_padded() {
    let (mut file, buffer) = lit();
    let mut plain = file["meshes"][0]["primitives"][0].clone();
    let attributes = plain["attributes"].as_object_mut().unwrap();
    attributes.retain(|name, _| !name.contains("SH_DEGREE") || name.contains("SH_DEGREE_0"));
    file["meshes"][0]["primitives"].as_array_mut().unwrap().insert(0, plain);
    let found = clean(&glb(&file, &buffer));
    assert_eq!((found.len(), found.sh_degree), (4, 3));
    assert_eq!(found.sh[3..48], [0.0; 45]);
    assert_eq!(found.sh[..3], found.sh[96..99]);
    assert!(found.sh[99..144].iter().all(|v| *v != 0.0));
}

#[test]
fn drafts_keep_colour_and_opacity_together() {
    let mut rows = two();
    rows.truncate(3);
    let mut old = rows.clone();
    old.push(floats("COLOR_0", "VEC4", &[0.5, 0.75, 1.0, 0.5, 0.0, 0.25, 0.5, 0.75]));
    let (mut file, buffer) = document(&old);
    let attributes = file["meshes"][0]["primitives"][0]["attributes"]
        .as_object_mut()
        .unwrap();
    for name in ["ROTATION", "SCALE"] {
        let index = attributes.remove(&format!("KHR_gaussian_splatting:{name}")).unwrap();
        attributes.insert(format!("_{name}"), index);
    }
    file["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"] = json!({ "colorSpace": "BT.709" });
    let found = clean(&glb(&file, &buffer));
    let (plain, wanted) = document(&two());
    let wanted = clean(&glb(&plain, &wanted));
    assert_eq!(found.log_scale, wanted.log_scale);
    assert_eq!(found.quaternion, wanted.quaternion);
    assert_eq!(found.opacity_logit, wanted.opacity_logit);
    let shown = |i: usize| 0.5 + 0.282_094_8 * found.sh[i];
    for (i, color) in [0.5, 0.75, 1.0, 0.0, 0.25, 0.5].into_iter().enumerate() {
        assert!((shown(i) - color).abs() < 1e-6, "{i}: {}", shown(i));
    }
}

#[test]
fn oddities_are_warned_of() {
    let warned = |change: &dyn Fn(&mut Value)| {
        let (mut file, buffer) = document(&two());
        change(&mut file);
        let loaded = read(&glb(&file, &buffer));
        assert_eq!(loaded.splats.len(), 2);
        assert_eq!(loaded.warnings.len(), 1, "{:?}", loaded.warnings);
        assert!(loaded.warnings[0].starts_with("scene.glb: "));
        loaded.warnings[0].clone()
    };
    let set = |name: &'static str, value: &'static str| {
        move |file: &mut Value| {
            file["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"][name] = value.into();
        }
    };
    for name in ["kernel", "projection", "sortingMethod", "colorSpace"] {
        let text = warned(&set(name, "odd"));
        assert!(text.contains(name) && text.contains("\"odd\" taken for"), "{text}");
    }
    assert!(warned(&set("colorSpace", "lin_rec709_display")).contains("shown as stored"));
    let triangles = |file: &mut Value| {
        let mesh = json!({ "primitives": [{ "attributes": { "POSITION": 0 } }, { "attributes": {} }] });
        file["meshes"].as_array_mut().unwrap().push(mesh);
    };
    assert!(warned(&triangles).contains("2 primitives of 1 meshes hold no splats"));
    let opacity = |file: &mut Value| file["accessors"][3]["bufferView"] = 0.into();
    assert!(warned(&opacity).contains("1 of 2 opacities"));
    let degree = |file: &mut Value| {
        let attributes = &mut file["meshes"][0]["primitives"][0]["attributes"];
        attributes["KHR_gaussian_splatting:SH_DEGREE_4_COEF_0"] = 4.into();
    };
    assert!(warned(&degree).contains("above degree 3"));
    let instancing = |file: &mut Value| {
        file["extensionsUsed"] = json!(["KHR_gaussian_splatting", "EXT_mesh_gpu_instancing"]);
    };
    assert!(warned(&instancing).contains("instances are left out"));
    let (file, buffer) = document(&two());
    let mut bytes = glb(&file, &buffer);
    bytes.extend([0; 5]);
    assert!(read(&bytes).warnings[0].contains("5 bytes"));
}
