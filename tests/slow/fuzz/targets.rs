//! The readers under test: one target per format. A target takes any bytes and panics unless they give a valid value or
//! an error of one line that names the file.

use super::repair;
use ashfall::io::colmap::Files;
use ashfall::io::camera_path::{self, CameraPath, PathOptions};
use ashfall::io::{Listing, Source, colmap, metashape, obj, photo, ply, realitycapture, splats, transforms};
use ashfall::io::LoadedSplats;
use ashfall::scene::{Camera, Mesh, Photo, Optics, PhotoSource, View};
use ashfall::train::checkpoint::Checkpoint;
use ashfall::{Error, Result};
use std::path::Path;

/// A format and its reader.
pub(crate) struct Target {
    /// Also the name of its corpus folder.
    pub(crate) name: &'static str,
    /// Returns the reader's message, or an empty string if there is none.
    pub(crate) run: fn(&[u8]) -> String,
    /// Repairs checksums and lengths, so that later stages of the reader are reached.
    pub(crate) repair: fn(&mut Vec<u8>),
    /// Vocabulary of the format.
    pub(crate) words: &'static [&'static str],
    /// Largest memory in bytes for reading an input, beyond [`SLACK`].
    pub(crate) memory: fn(&[u8]) -> usize,
}

/// Memory for buffers of fixed size, allowed for any input, bytes.
pub(crate) const SLACK: usize = 1 << 20;

pub(crate) const TARGETS: &[Target] = &[
    Target {
        name: "ply",
        run: |bytes| check("scene.ply", splats::read(at("scene.ply", bytes)), check_splats),
        repair: |_| {},
        words: PLY_WORDS,
        memory: |bytes| 64 * bytes.len(),
    },
    Target {
        name: "cloud",
        run: |bytes| check("cloud.ply", ply::read_points(at("cloud.ply", bytes)), |_| Vec::new()),
        repair: |_| {},
        words: PLY_WORDS,
        memory: |bytes| 64 * bytes.len(),
    },
    Target {
        name: "mesh",
        run: |bytes| check("mesh.ply", ply::read_mesh(at("mesh.ply", bytes)), |(mesh, origin)| {
            assert!(origin.is_finite());
            check_mesh(mesh)
        }),
        repair: |_| {},
        words: PLY_WORDS,
        // A polygon of one-byte indices has a triangle of twelve bytes for each.
        memory: |bytes| 64 * bytes.len(),
    },
    Target {
        name: "splat",
        run: |bytes| check("scene.splat", splats::read(at("scene.splat", bytes)), check_splats),
        repair: |_| {},
        words: &[],
        memory: |bytes| 64 * bytes.len(),
    },
    Target {
        name: "spz",
        run: |bytes| check("scene.spz", splats::read(at("scene.spz", bytes)), check_splats),
        repair: repair::spz,
        words: &["NGSP", "\u{3}\0\u{be}\u{ad}\u{4}\0\0\0", "(\u{b5}/\u{fd}", "\u{1f}\u{8b}\u{8}"],
        memory: repair::spz_bytes,
    },
    Target {
        name: "ksplat",
        run: |bytes| {
            let bytes = repair::ksplat(bytes);
            check("scene.ksplat", splats::read(at("scene.ksplat", &bytes)), check_splats)
        },
        repair: |_| {},
        words: &["\0\u{1}\0\0"],
        memory: |bytes| 64 * repair::ksplat(bytes).len(),
    },
    Target {
        name: "colmap_bin",
        run: |bytes| check_model(true, repair::parts_by_length(bytes)),
        repair: |_| {},
        words: &["../", "/", "a.png", "\0", "\u{1b}[2J"],
        memory: |bytes| 64 * bytes.len(),
    },
    Target {
        name: "colmap_txt",
        run: |bytes| check_model(false, repair::parts_by_separator(bytes)),
        repair: |_| {},
        words: &[
            "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FOV", "#", "\r\n", "\u{1e}", "../",
        ],
        memory: |bytes| 64 * bytes.len(),
    },
    Target {
        name: "colmap_rigs",
        run: |bytes| check_rigs(repair::parts_by_length(bytes)),
        repair: |_| {},
        words: &["\u{1}\0\0\0", "\0\0\0\0"],
        memory: |bytes| 64 * bytes.len(),
    },
    Target {
        name: "transforms",
        run: |bytes| check_listed("transforms.json", bytes, |source| transforms::read(source, None)),
        repair: |_| {},
        words: JSON_WORDS,
        // An empty object in a list is three bytes, and 32 in memory; with a key, seven and a node of its map.
        memory: |bytes| 256 * bytes.len(),
    },
    Target {
        name: "checkpoint",
        run: |bytes| check("checkpoint", Checkpoint::read(at("checkpoint", bytes)), check_checkpoint),
        repair: repair::checkpoint,
        words: &["\"params\"", "\"m\"", "\"f32\"", "\"u8\"", "\"bytes\":", "\"sections\":", "\"meta\":", "null", "{}", "[]"],
        memory: |bytes| 256 * bytes.len(),
    },
    Target {
        name: "obj",
        run: |bytes| check("mesh.obj", obj::read(at("mesh.obj", bytes)), check_mesh),
        repair: |_| {},
        words: &["v ", "f ", "f 1 2 3\n", "vn ", "vt ", "o a\n", "g a\n", "usemtl a\n", "l 1 2\n", "1//1", "1/1/1", "-1", "\\\n"],
        memory: |bytes| 256 * bytes.len(),
    },
    Target {
        name: "gltf",
        run: |bytes| check("scene.glb", splats::read(at("scene.glb", bytes)), check_splats),
        repair: repair::glb,
        words: GLTF_WORDS,
        memory: repair::glb_bytes,
    },
    Target {
        name: "png",
        run: check_photo,
        repair: |bytes| repair::png(bytes),
        words: &["IHDR", "IDAT", "IEND", "PLTE", "tRNS", "acTL", "fcTL", "fdAT", "iCCP", "zTXt", "eXIf", "gAMA"],
        memory: repair::photo_bytes,
    },
    Target {
        name: "jpeg",
        run: check_photo,
        repair: |_| {},
        words: &["\u{ff}", "JFIF\0", "Exif\0\0", "Adobe\0"],
        memory: repair::photo_bytes,
    },
    Target {
        name: "sog",
        run: |bytes| check("scene.sog", splats::read(at("scene.sog", bytes)), check_splats),
        repair: repair::zip,
        words: &[
            "null", "[]", "{}", ",", "-1", "1e39", "\"version\":1,", "\"shape\":[6],", "\"count\":65536", "\"codebook\":[0]",
            "\"model\":\"2dgs\",", "\"model\":\"antialiased\",", "\"bands\":3,", "\"mins\":0,", "\"../a\"", "VP8L", "VP8X",
            "VP8 ", "ICCP", "ANIM", "meta.json", "lod-meta.json", "a/", "../",
        ],
        memory: repair::sog_bytes,
    },
    Target {
        name: "camera_path",
        run: check_path,
        repair: |_| {},
        words: PATH_WORDS,
        // An animation has up to 100,000 frames, whose cameras are 280 bytes in two forms, twice while the list grows.
        memory: |bytes| (1 << 26) + 1024 * bytes.len(),
    },
    Target {
        name: "realitycapture",
        run: |bytes| check_listed("cameras.csv", bytes, |source| realitycapture::read(source, None)),
        repair: |_| {},
        words: &["#name", "a.png", "b.jpg", ",", "\n", "\"", "alt", "heading", "k4", "-1.5e-003", "nan", "1e38", "../", "\\"],
        memory: |bytes| 256 * bytes.len(),
    },
    Target {
        name: "metashape",
        run: |bytes| check_listed("cameras.xml", bytes, |source| metashape::read(source, None)),
        repair: |_| {},
        words: XML_WORDS,
        // An empty element in a tree is four bytes, and some hundred in memory.
        memory: |bytes| 256 * bytes.len(),
    },
];

const XML_WORDS: &[&str] = &[
    "<chunk>", "</chunk>", "<a>", "</a>", "<a/>", "<!--", "-->", "<![CDATA[", "]]>", "<?a ?>", "<!DOCTYPE a>", "&lt;", "&#0;", "&a;",
    "<transform>", "</transform>", "<scale>", "<rotation>", "<f>", "<k4>", "<b2>1</b2>", "<p3>0</p3>", "type=\"fisheye\"", "type=\"spherical\"",
    "enabled=\"false\"", "component_id=\"0\"", "sensor_id=\"1\"", "label=\"a\"", "label=\"b.jpg\"", "width=\"8\"", "nan", "1e38", "-1", "0 0 0 1",
];

const PATH_WORDS: &[&str] = &[
    "null", "true", "[]", "{}", "[", "]", "{", "}", ",", "\u{1e}", "\"camera_path\":", "\"camera_to_world\":", "\"fov\":50,",
    "\"render_width\":8,", "\"transform\":", "\"scale\":2,", "\"rotation\":[0,1,0,0],", "\"position\":[1,2,3],", "\"frames\":",
    "\"asset\":{\"version\":\"2.0\"},", "\"camera\":0,", "\"perspective\":{\"yfov\":1},", "\"animations\":", "\"channels\":",
    "\"sampler\":0,", "\"path\":\"scale\"", "\"interpolation\":\"CUBICSPLINE\",", "\"count\":6,", "1e38", "1e-38", "-1",
];

const PLY_WORDS: &[&str] = &[
    "ply\n", "format ascii 1.0\n", "format binary_little_endian 1.0\n", "format binary_big_endian 1.0\n",
    "element vertex 2\n", "element face 1\n", "element chunk 1\n", "element sh 2\n", "property uint packed_color\n", "property float x\n", "property double y\n",
    "property uchar z\n", "property list uchar int vertex_indices\n", "property list float double a\n", "property ",
    "end_header\n", "comment SplatRenderMode: mip\n", "comment antialiased 1\n", "obj_info a\n", "\r\n", "red", "f_rest_0",
];

const JSON_WORDS: &[&str] = &[
    "null", "true", "[]", "{}", "[", "]", "{", "}", ",", "\"frames\":", "\"transform_matrix\":", "\"file_path\":",
    "\"ply_file_path\":\"cloud.ply\",", "\"camera_angle_x\":1,", "\"w\":8,", "\"h\":6,", "\"k1\":0.1,", "\"fl_x\":9,",
    "\"camera_model\":\"OPENCV\",", "\"is_fisheye\":true,", "\"a.png\"", "\"../a\"", "\\u0000", "\\ud800", "\\\\",
];

const GLTF_WORDS: &[&str] = &[
    "null", "true", "[]", "{}", "[", "]", "{", "}", ",", "\"nodes\":[0],", "\"children\":[1],", "\"mesh\":0,", "\"matrix\":",
    "\"scale\":[1,2,3],", "\"rotation\":[0,1,0,0],", "\"translation\":[1e6,0,0],", "\"extras\":{\"splatOrigin\":true},",
    "\"bufferView\":1,", "\"byteOffset\":4,", "\"byteStride\":16,", "\"normalized\":true,", "\"componentType\":5121,", "5120",
    "5122", "5123", "5126", "SCALAR", "VEC4", "\"sparse\":", "\"uri\":\"data:;base64,AAAAAA==\",", "\"uri\":\"../a\",", "POSITION",
    "COLOR_0", "_SCALE", "_ROTATION", "KHR_gaussian_splatting:SH_DEGREE_1_COEF_0", "KHR_gaussian_splatting:OPACITY", "BIN\0",
    "KHR_gaussian_splatting_compression_spz_2", "KHR_spz_compression", "lin_rec709_display", "KHR_mesh_quantization",
];

fn at<'a>(name: &'static str, bytes: &'a [u8]) -> Source<'a> {
    Source::bytes(Path::new(name), bytes)
}

/// Checks an outcome: a value by `judge`, an error by its message. Returns the message or the warnings.
#[track_caller]
fn check<T>(name: &str, outcome: Result<T>, judge: impl FnOnce(T) -> Vec<String>) -> String {
    match outcome {
        Ok(value) => {
            let warnings = judge(value).concat();
            assert!(!warnings.chars().any(char::is_control), "control characters: {warnings:?}");
            warnings
        }
        Err(error) => check_error(name, &error),
    }
}

#[track_caller]
fn check_error(name: &str, error: &Error) -> String {
    assert!(matches!(error, Error::File { .. }), "of another kind: {error:?}");
    let text = error.to_string();
    let what = text.strip_prefix(name).and_then(|rest| rest.strip_prefix(": "));
    assert!(what.is_some_and(|what| what.len() > 8), "names no file, or no rule: {text}");
    // Contents of a file must neither reach the terminal as control characters nor fill it.
    assert!(!text.chars().any(char::is_control), "control characters: {text:?}");
    assert!(text.len() < 1500, "{} bytes long: {text}", text.len());
    text
}

fn check_splats(LoadedSplats { splats, warnings, .. }: LoadedSplats) -> Vec<String> {
    let count = splats.len();
    assert!(splats.sh_degree <= 3);
    let lengths = [splats.mean.len(), splats.quaternion.len(), splats.log_scale.len(), splats.opacity_logit.len()];
    assert_eq!(lengths, [count; 4], "one of each");
    assert_eq!(splats.sh.len(), count * splats.sh_stride());
    let geometry = splats.mean.as_flattened().iter().chain(splats.log_scale.as_flattened());
    let all = geometry.chain(splats.quaternion.as_flattened()).chain(&splats.opacity_logit).chain(&splats.sh);
    assert!(all.into_iter().all(|v| v.is_finite()), "every number is finite");
    assert!(splats.quaternion.iter().all(|q| q.iter().any(|v| *v != 0.0)), "every splat has a rotation");
    warnings
}

fn check_camera(camera: &Camera) {
    assert!((1..=65_535).contains(&camera.width) && (1..=65_535).contains(&camera.height));
    // Shaders use cameras in single precision.
    let numbers = [camera.focal.as_vec2(), camera.center.as_vec2()];
    assert!(numbers.iter().all(|v| v.is_finite()), "{camera:?}");
    assert!(camera.focal.as_vec2().min_element() > 0.0, "{camera:?}");
    assert!(camera.position.as_vec3().is_finite(), "{camera:?}");
    let error = camera.rotation * camera.rotation.transpose() - glam::DMat3::IDENTITY;
    assert!(error.to_cols_array().iter().all(|e| e.abs() < 1e-6), "{camera:?}");
}

fn check_listing(listing: Listing) -> Vec<String> {
    assert!(!listing.views.is_empty(), "an empty model is an error");
    for view in &listing.views {
        check_camera(&view.camera);
        let path = view.photo.strip_prefix(super::BESIDE).unwrap_or(&view.photo);
        assert!(path.components().all(|part| part != std::path::Component::ParentDir), "{path:?}");
        assert!(!view.name.chars().any(char::is_control), "{:?}", view.name);
    }
    listing.warnings
}

fn check_model(binary: bool, [cameras, images, points]: [&[u8]; 3]) -> String {
    let extension = if binary { "bin" } else { "txt" };
    let names = ["cameras", "images", "points3D"].map(|stem| format!("{stem}.{extension}"));
    let files = Files {
        binary,
        cameras: Source::bytes(names[0].as_ref(), cameras),
        images: Source::bytes(names[1].as_ref(), images),
        points: Some(Source::bytes(names[2].as_ref(), points)),
        rigs: None,
    };
    let outcome = colmap::read_files(&files, Path::new("images"));
    let blamed = match &outcome {
        Err(error) => names.iter().find(|name| error.to_string().starts_with(*name)),
        Ok(_) => None,
    };
    check(blamed.map_or("one of the three", String::as_str), outcome, check_listing)
}

/// The folder of the photograph and the point cloud to which inputs may refer.
fn beside() -> &'static Path {
    Path::new(super::BESIDE)
}

/// Rigs and frames of two images: whatever they hold, the images have poses.
fn check_rigs([rigs, frames, _]: [&[u8]; 3]) -> String {
    let cameras = b"1 SIMPLE_PINHOLE 8 6 9 4 3\n";
    let images = b"1 1 0 0 0 0 0 0 1 a.png\n\n2 0 1 0 0 1 2 3 1 b.jpg\n\n";
    let files = Files {
        binary: false,
        cameras: at("cameras.txt", cameras),
        images: at("images.txt", images),
        points: None,
        rigs: Some([at("rigs.bin", rigs), at("frames.bin", frames)]),
    };
    let outcome = colmap::read_files(&files, Path::new("images"));
    check("images.txt", outcome, |listing| {
        assert_eq!(listing.views.len(), 2);
        check_listing(listing)
    })
}

/// A list of cameras with photographs beside it.
fn check_listed(name: &str, bytes: &[u8], read: fn(Source<'_>) -> Result<Listing>) -> String {
    let name = beside().join(name);
    let outcome = read(Source::bytes(&name, bytes));
    check(&name.display().to_string(), outcome, |listing| {
        listing.views.iter().take(4).for_each(|view| {
            // As on opening a data set: the camera takes the size of the file, and the file is undistorted.
            let Ok((width, height)) = photo::dimensions(&view.photo) else { return };
            let camera = view.camera.resized(width, height);
            let optics = view.lens.map(|lens| Box::new(Optics::of(lens, &camera)));
            let (path, mask) = (view.photo.clone(), None);
            let source = PhotoSource::File { path, optics, orientation: 1, mask, vignetting: None };
            let view = View { name: view.name.clone(), camera, photo: source };
            let loaded = photo::load(&view);
            assert!(loaded.is_ok_and(|photo| photo.rgba.len() == (width * height) as usize));
        });
        check_listing(listing)
    })
}

/// A path, and behind a separator the transforms beside it.
fn check_path(bytes: &[u8]) -> String {
    let [path, parser, _] = repair::parts_by_separator(bytes);
    let (name, beside) = (beside().join("path.json"), beside().join(camera_path::DATAPARSER));
    let world = match parser {
        [] => None,
        parser => match camera_path::normalised_world(Source::bytes(&beside, parser)) {
            Ok(world) => Some(world),
            Err(error) => return check_error(&beside.display().to_string(), &error),
        },
    };
    let options = PathOptions { world, ..PathOptions::default() };
    let outcome = camera_path::read(Source::bytes(&name, path), &options);
    check(&name.display().to_string(), outcome, |CameraPath { cameras, rate, warnings, .. }| {
        assert!(!cameras.is_empty(), "a path without cameras is an error");
        assert!(rate.is_none_or(|rate| rate > 0.0));
        cameras.iter().for_each(check_camera);
        warnings
    })
}

fn check_checkpoint(checkpoint: Checkpoint) -> Vec<String> {
    let count = checkpoint.state.len();
    assert_eq!(checkpoint.statistics.len(), count);
    let state = &checkpoint.state;
    assert!(state.params.iter().chain(&state.m).chain(&state.v).all(|plane| plane.len() == count));
    assert!(checkpoint.iteration <= checkpoint.config.iterations);
    let splats = state.to_splats(ashfall::scene::ScreenFilter::Classic);
    assert_eq!(splats.len(), count);
    Vec::new()
}

fn check_mesh(mesh: Mesh) -> Vec<String> {
    let count = mesh.positions.len() as u32;
    assert!(!mesh.triangles.is_empty(), "a mesh without faces is an error");
    assert!(mesh.triangles.iter().flatten().all(|v| *v < count));
    assert!(mesh.positions.iter().flatten().all(|v| v.is_finite()));
    assert!(mesh.colors.is_empty() || mesh.colors.len() == mesh.positions.len());
    let points = obj::sample(&mesh, 8, 1);
    assert!(points.is_empty() || points.len() == 8);
    assert!(points.iter().all(|p| p.is_finite()));
    Vec::new()
}

fn check_photo(bytes: &[u8]) -> String {
    check("photo", photo::decode(at("photo", bytes)), |photo: Photo| {
        assert_eq!(photo.rgba.len(), (photo.width * photo.height) as usize);
        let size = photo::dimensions(at("photo", bytes));
        assert!(size.is_ok_and(|size| size == (photo.width, photo.height)));
        Vec::new()
    })
}
