//! Damaged glTF files, and those that are bombs.

use crate::io::gltf::{around, document, floats, glb, read, two};
use crate::io::{error_at, for_every_prefix};
use ashfall::io::{Source, gltf, spz};
use ashfall::scene::Splats;
use serde_json::{Value, json};
use std::path::Path;

type Change = Box<dyn Fn(&mut Value)>;

fn fault(bytes: &[u8]) -> String {
    let text = match gltf::read(Source::bytes(Path::new("scene.glb"), bytes)) {
        Ok(_) => panic!("it was accepted"),
        Err(error) => error.to_string(),
    };
    assert!(text.starts_with("scene.glb: ") && text.lines().count() == 1, "{text}");
    text
}

/// A change of one member of the document.
fn set(pointer: &'static str, value: Value) -> Change {
    Box::new(move |file| {
        let (parent, name) = pointer.rsplit_once('/').unwrap();
        let parent = file.pointer_mut(parent).unwrap();
        match parent {
            Value::Array(list) => list[name.parse::<usize>().unwrap()] = value.clone(),
            other => other[name] = value.clone(),
        }
    })
}

/// Removal of an attribute of the primitive.
fn without(name: &'static str) -> Change {
    Box::new(move |file| {
        let attributes = &mut file["meshes"][0]["primitives"][0]["attributes"];
        attributes.as_object_mut().unwrap().remove(name).unwrap();
    })
}

/// A new attribute that is an accessor already there.
fn with(name: &'static str, accessor: u32) -> Change {
    Box::new(move |file| file["meshes"][0]["primitives"][0]["attributes"][name] = accessor.into())
}

fn matrix(m: [f64; 9]) -> Change {
    let [a, b, c, d, e, f, g, h, i] = m;
    set(
        "/nodes/0/matrix",
        json!([a, b, c, 0, d, e, f, 0, g, h, i, 0, 0, 0, 0, 1]),
    )
}

fn cases() -> Vec<(&'static str, Change, &'static [&'static str])> {
    let deep: Vec<Value> = (1..300)
        .map(|i| json!({ "children": [i] }))
        .chain([json!({ "mesh": 0 })])
        .collect();
    let bomb: Vec<Value> = (0..4000).map(|_| json!({ "mesh": 0 })).collect();
    let all: Vec<u32> = (0..4000).collect();
    vec![
        (
            "version",
            set("/asset/version", json!("1.0")),
            &["glTF version \"1.0\""],
        ),
        (
            "required",
            set("/extensionsRequired", json!(["KHR_x"])),
            &["requires the extension \"KHR_x\""],
        ),
        ("scene", set("/scene", json!(3)), &["scene 3 is not there"]),
        ("node", set("/scenes/0/nodes", json!([7])), &["node 7 is not there"]),
        ("mesh", set("/nodes/0/mesh", json!(1)), &["mesh 1 is not there"]),
        ("cycle", set("/nodes/0/children", json!([0])), &["node 0", "cycle"]),
        (
            "parents",
            set("/scenes/0/nodes", json!([0, 0])),
            &["node 0", "two parents"],
        ),
        ("depth", set("/nodes", deep.into()), &["node 256", "256 levels deep"]),
        (
            "bomb",
            Box::new(move |file| {
                file["nodes"] = bomb.clone().into();
                file["scenes"][0]["nodes"] = json!(all);
                // As if there were more splats than bytes: rows of zeros.
                for accessor in file["accessors"].as_array_mut().unwrap() {
                    accessor.as_object_mut().unwrap().remove("bufferView");
                    accessor["count"] = 1000.into();
                }
            }),
            &["mesh 0, primitive 0", "4000000 splats", "justify"],
        ),
        (
            "zeros",
            Box::new(|file| {
                for accessor in file["accessors"].as_array_mut().unwrap() {
                    accessor.as_object_mut().unwrap().remove("bufferView");
                    accessor["count"] = u64::MAX.into();
                }
            }),
            &["18446744073709551615 splats", "justify"],
        ),
        (
            "mirror",
            set("/nodes/0/scale", json!([1, 1, -1])),
            &["node 0", "mirrors"],
        ),
        (
            "mirror",
            matrix([0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
            &["node 0", "mirrors"],
        ),
        (
            "shear",
            matrix([1.0, 0.0, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0, 1.0]),
            &["node 0", "shears"],
        ),
        (
            "flat",
            set("/nodes/0/scale", json!([1, 0, 1])),
            &["node 0", "no volume"],
        ),
        (
            "huge",
            set("/nodes/0/scale", json!([1e300, 1e300, 1e300])),
            &["node 0", "not finite"],
        ),
        (
            "projection",
            set(
                "/nodes/0/matrix",
                json!([1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]),
            ),
            &["last row"],
        ),
        (
            "rotation",
            set("/nodes/0/rotation", json!([0, 0, 0, 0])),
            &["node 0", "length 0"],
        ),
        (
            "no splats",
            set("/meshes/0/primitives/0/extensions", json!({})),
            &["holds no splats"],
        ),
        ("hidden", set("/scenes/0/nodes", json!([])), &["none of the 1 meshes"]),
        ("missing", without("POSITION"), &["POSITION is missing"]),
        (
            "missing",
            without("KHR_gaussian_splatting:SCALE"),
            &["KHR_gaussian_splatting:SCALE is missing"],
        ),
        (
            "missing",
            without("KHR_gaussian_splatting:OPACITY"),
            &["KHR_gaussian_splatting:OPACITY is missing"],
        ),
        (
            "hole",
            with("KHR_gaussian_splatting:SH_DEGREE_1_COEF_1", 4),
            &["SH_DEGREE_1_COEF_0 is missing"],
        ),
        (
            "hole",
            with("KHR_gaussian_splatting:SH_DEGREE_2_COEF_0", 4),
            &["SH_DEGREE_1_COEF_0 is missing"],
        ),
        (
            "accessor",
            with("KHR_gaussian_splatting:SCALE", 9),
            &["SCALE", "accessor 9 is not there"],
        ),
        (
            "type",
            set("/accessors/2/type", json!("VEC2")),
            &["SCALE", "Vec2", "Vec3"],
        ),
        ("type", set("/accessors/2/type", json!("VEC9")), &["JSON", "VEC9"]),
        (
            "component",
            set("/accessors/0/componentType", json!(5123)),
            &["POSITION", "U16 plain", "F32"],
        ),
        (
            "component",
            set("/accessors/1/componentType", json!(5122)),
            &["ROTATION", "I16 plain", "I16 normalised"],
        ),
        (
            "component",
            set("/accessors/1/componentType", json!(5124)),
            &["no component type 5124"],
        ),
        (
            "count",
            set("/accessors/4/count", json!(1)),
            &["SH_DEGREE_0_COEF_0 has 1 rows, but POSITION 2"],
        ),
        (
            "count",
            set("/accessors/0/count", json!(3)),
            &["POSITION: accessor 0", "3 rows of 12 bytes"],
        ),
        (
            "count",
            set("/accessors/0/count", json!(u64::MAX)),
            &["POSITION", "18446744073709551615 rows"],
        ),
        (
            "offset",
            set("/accessors/0/byteOffset", json!(4)),
            &["from byte 4 are not in a buffer view of 24"],
        ),
        (
            "offset",
            set("/accessors/0/byteOffset", json!(u64::MAX)),
            &["POSITION", "are not in a buffer view"],
        ),
        ("stride", set("/bufferViews/0/byteStride", json!(8)), &["stride of 8"]),
        (
            "view",
            set("/accessors/0/bufferView", json!(50)),
            &["buffer view 50 is not there"],
        ),
        (
            "view",
            set("/bufferViews/0/byteLength", json!(9999)),
            &["buffer view 0", "9999 bytes"],
        ),
        (
            "view",
            set("/bufferViews/0/byteOffset", json!(u64::MAX)),
            &["buffer view 0"],
        ),
        (
            "buffer",
            set("/bufferViews/0/buffer", json!(1)),
            &["buffer 1 is not there"],
        ),
        (
            "buffer",
            set("/buffers/0/byteLength", json!(9999)),
            &["buffer 0", "9999 bytes in the document"],
        ),
        (
            "base 64",
            set("/buffers/0/uri", json!("data:;base64,AA*A")),
            &["buffer 0", "character 2 is no base 64"],
        ),
        (
            "base 64",
            set("/buffers/0/uri", json!("data:text/plain,a")),
            &["buffer 0", "no data: URI"],
        ),
        (
            "file",
            set("/buffers/0/uri", json!("a.bin")),
            &["\"a.bin\"", "in memory"],
        ),
        (
            "sparse",
            set(
                "/accessors/0/sparse",
                json!({ "count": 1,
            "indices": { "bufferView": 0, "componentType": 5126 }, "values": { "bufferView": 0 } }),
            ),
            &["sparse indices have components F32"],
        ),
        (
            "sparse",
            set(
                "/accessors/0/sparse",
                json!({ "count": 9,
            "indices": { "bufferView": 0, "componentType": 5121 }, "values": { "bufferView": 0 } }),
            ),
            &["9 sparse values of 12 bytes"],
        ),
        (
            "sparse",
            set(
                "/accessors/0/sparse",
                json!({ "count": 2,
            "indices": { "bufferView": 0, "componentType": 5121 }, "values": { "bufferView": 0 } }),
            ),
            &["sparse index 1, 0"],
        ),
        (
            "foreign",
            Box::new(|file| {
                let own = &mut file["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"];
                own["extensions"] = json!({ "KHR_gaussian_splatting_lgsc": { "bufferView": 0 } });
                file["accessors"][0].as_object_mut().unwrap().remove("bufferView");
            }),
            &["\"KHR_gaussian_splatting_lgsc\"", "not supported"],
        ),
    ]
}

#[test]
fn damaged_documents_are_refused() {
    for (name, change, words) in cases() {
        let (mut file, buffer) = document(&two());
        change(&mut file);
        let text = fault(&glb(&file, &buffer));
        for word in words {
            assert!(text.contains(word), "{name}: no {word:?} in {text}");
        }
    }
}

#[test]
fn damaged_containers_are_refused() {
    let (file, buffer) = document(&two());
    let good = glb(&file, &buffer);
    let word = |at: usize, value: u32| {
        let mut bytes = good.clone();
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        fault(&bytes)
    };
    assert!(word(0, 0x4654_4c48).contains("neither a GLB file"));
    assert!(word(4, 1).contains("GLB version 1"));
    assert!(word(8, u32::MAX).contains("4294967295 bytes"));
    assert!(word(8, 4).contains("announces 4 bytes"));
    assert!(word(8, 12).contains("no JSON chunk"));
    assert!(word(12, u32::MAX).contains("chunk 0 has 4294967295 bytes"));
    assert!(word(16, 7).contains("first chunk is not JSON"));
    assert!(fault(b"").contains("is empty"));
    assert!(fault(b"[]").contains("nor a JSON object"));
    assert!(fault(b"{}").contains("asset"));
    let deep = [
        br#"{"asset":{"version":"2.0"},"nodes":[{"extras":"#.as_slice(),
        &[b'['; 100_000],
    ]
    .concat();
    assert!(fault(&deep).contains("recursion"));
    // Without its binary chunk.
    let text = &good[..good.len() - buffer.len() - 8];
    let mut bytes = text.to_vec();
    bytes[8..12].copy_from_slice(&(text.len() as u32).to_le_bytes());
    assert!(fault(&bytes).contains("buffer 0: has neither a URI nor a binary chunk"));
}

#[test]
fn damaged_spz_files_inside_are_refused() {
    let name = "KHR_gaussian_splatting_compression_spz_2";
    let text = fault(&around(b"nothing of the kind", name, true));
    assert!(text.contains("mesh 0, primitive 0: its SPZ file: "), "{text}");
    // One file in a thousand primitives.
    let (mut file, _) = document(&two());
    let primitive = json!({ "extensions": { "KHR_spz_compression": { "bufferView": 0 } } });
    file["meshes"] = json!([{ "primitives": vec![primitive; 1000] }]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.spz");
    let mut scene = Splats::default();
    for _ in 0..2000 {
        scene.mean.push([0.0; 3]);
        scene.quaternion.push([1.0, 0.0, 0.0, 0.0]);
        scene.log_scale.push([0.0; 3]);
        scene.opacity_logit.push(0.0);
        scene.sh.extend([0.0; 3]);
    }
    spz::write(&path, &scene).unwrap();
    let mut buffer = std::fs::read(&path).unwrap();
    let length = buffer.len();
    buffer.resize(length.next_multiple_of(4), 0);
    file["bufferViews"] = json!([{ "buffer": 0, "byteLength": length }]);
    file["buffers"] = json!([{ "byteLength": buffer.len() }]);
    assert!(fault(&glb(&file, &buffer)).contains("its SPZ files so far have"));
    // Its splats are free once.
    file["meshes"][0]["primitives"].as_array_mut().unwrap().truncate(1);
    assert_eq!(read(&glb(&file, &buffer)).splats.len(), 2000);
    file["nodes"] = json!(vec![json!({ "mesh": 0 }); 3]);
    file["scenes"][0]["nodes"] = json!([0, 1, 2]);
    assert!(fault(&glb(&file, &buffer)).contains("4000 splats in all instances so far"));
}

#[test]
fn names_of_buffers_stay_in_the_folder() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("in")).unwrap();
    std::fs::write(folder.path().join("a.bin"), [0; 999]).unwrap();
    let path = folder.path().join("in/scene.gltf");
    for (name, words) in [
        ("../a.bin", "is refused"),
        ("%2e%2e/a.bin", "is refused"),
        ("/etc/passwd", "is refused"),
        ("a%0ab", "is refused"),
        ("absent.bin", "absent.bin"),
        ("a%2", "no name of a file"),
    ] {
        let (mut file, _) = document(&two());
        file["buffers"][0]["uri"] = name.into();
        std::fs::write(&path, file.to_string()).unwrap();
        let text = error_at(gltf::read(&path), &path);
        assert!(text.contains(words) && text.contains("buffer 0"), "{text}");
    }
}

#[test]
fn every_prefix_is_an_error() {
    let (file, buffer) = document(&[two(), vec![floats("COLOR_0", "VEC4", &[0.0; 8])]].concat());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.glb");
    for_every_prefix(
        &glb(&file, &buffer),
        &path,
        |path| gltf::read(path),
        |_, result| {
            error_at(result, &path);
        },
    );
    // A document in text is complete with its last brace.
    let path = folder.path().join("scene.gltf");
    for_every_prefix(
        file.to_string().as_bytes(),
        &path,
        |path| gltf::read(path),
        |_, result| {
            error_at(result, &path);
        },
    );
}
