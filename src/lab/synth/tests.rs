//! Against closed forms: distances, normals, projections, areas.

use super::*;
use crate::scene::{Dataset, PhotoSource};

fn camera(width: u32, height: u32) -> Camera {
    Camera {
        width,
        height,
        focal: DVec2::new(1.1 * f64::from(width), 1.2 * f64::from(width)),
        center: DVec2::new(0.47 * f64::from(width), 0.55 * f64::from(height)),
        rotation: DMat3::IDENTITY,
        position: DVec3::ZERO,
    }
    .look_at(DVec3::new(2.0, -3.5, 1.5), DVec3::ZERO, DVec3::Z)
}

/// Of uniform colour.
fn matt() -> Material {
    Material::matt(Texture::ripples([0.5; 3], 0.0, 1.0, 0))
}

fn only(object: Object) -> Scene {
    Scene {
        objects: vec![object],
        ..Scene::default()
    }
}

/// World directions of the rays through pixel centres, scaled to view z = 1.
fn rays(camera: &Camera) -> Vec<DVec3> {
    Scene::per_pixel(camera, |corner| camera.ray_from_pixel(corner + 0.5))
}

fn small(kind: Kind) -> (Scene, SynthOptions) {
    let options = SynthOptions {
        views: 9,
        width: 48,
        height: 36,
        points: 400,
        ..SynthOptions::default()
    };
    (scene(kind), options)
}

#[test]
fn a_plane_has_its_closed_depth_and_normal() {
    let camera = camera(40, 30);
    let scene = only(Object::new(Shape::Rectangle(DVec2::splat(50.0)), matt()).at(0.0, 0.0, -0.5));
    let (depth, normals) = (scene.depth(&camera), scene.normals(&camera));
    for ((ray, depth), normal) in rays(&camera).iter().zip(depth).zip(normals) {
        let expected = (-0.5 - camera.position.z) / ray.z;
        if expected > 0.0 && (camera.position + expected * *ray).abs().max_element() < 49.0 {
            assert!(
                (f64::from(depth) - expected).abs() < 1e-5 * expected,
                "{depth} {expected}"
            );
            assert_eq!(normal, [0.0, 0.0, 1.0]);
        }
    }
}

#[test]
fn a_sphere_has_its_closed_depth_and_normal() {
    let camera = camera(40, 30);
    let (center, radius) = (DVec3::new(0.1, 0.2, 0.0), 0.9);
    let scene = only(Object::new(Shape::Sphere(1.0), matt()).scaled(radius).at(0.1, 0.2, 0.0));
    let (depth, normals) = (scene.depth(&camera), scene.normals(&camera));
    let mut met = 0;
    for ((ray, depth), normal) in rays(&camera).iter().zip(depth).zip(normals) {
        let away = center - camera.position;
        let (a, b) = (ray.length_squared(), ray.dot(away));
        let discriminant = b * b - a * (away.length_squared() - radius * radius);
        assert_eq!(depth.is_finite(), discriminant >= 0.0);
        if discriminant >= 0.0 {
            met += 1;
            let expected = (b - discriminant.sqrt()) / a;
            assert!((f64::from(depth) - expected).abs() < 1e-5, "{depth} {expected}");
            let normal = DVec3::from(normal.map(f64::from));
            let expected = (camera.position + expected * *ray - center) / radius;
            assert!(normal.distance(expected) < 1e-5, "{normal} {expected}");
        }
    }
    assert!(met > 100);
}

#[test]
fn a_fine_mesh_of_a_sphere_is_a_sphere() {
    let camera = camera(64, 48);
    let mesh = icosphere(4);
    assert_eq!(mesh.triangles.len(), 20 * 4_usize.pow(4));
    let exact = only(Object::new(Shape::Sphere(1.0), matt()));
    let meshed = only(Object::new(Shape::Mesh(MeshTree::new(&mesh)), matt()));
    let pairs = exact.depth(&camera).into_iter().zip(meshed.depth(&camera));
    let mut differently_met = 0;
    for ((a, b), normal) in pairs.zip(meshed.normals(&camera).iter().zip(exact.normals(&camera))) {
        if a.is_finite() != b.is_finite() {
            differently_met += 1;
        } else if a.is_finite() {
            let cosine: f32 = (0..3).map(|i| normal.0[i] * normal.1[i]).sum();
            assert!(cosine > 0.998, "{cosine}");
            // The sagitta of an edge of 0.07, seen at up to a grazing angle.
            assert!((a - b).abs() < 0.03, "{a} {b}");
        }
    }
    assert!(differently_met < 10, "{differently_met}");
}

#[test]
fn boxes_and_cylinders_have_the_depth_of_their_faces() {
    // Looking down the x axis at flat faces and at a round side.
    let camera = Camera {
        center: DVec2::splat(16.0),
        ..camera(32, 32)
    }
    .look_at(DVec3::new(5.0, 0.0, 0.0), DVec3::ZERO, DVec3::Z);
    let middle = 16 * 32 + 16;
    let box_scene = only(Object::new(Shape::Cuboid(DVec3::new(1.0, 0.5, 0.5)), matt()));
    assert!((box_scene.depth(&camera)[middle] - 4.0).abs() < 1e-6);
    assert_eq!(box_scene.normals(&camera)[middle], [1.0, 0.0, 0.0]);
    let drum = Shape::Cylinder {
        radius: 0.75,
        half_height: 0.5,
    };
    let upright = only(Object::new(drum.clone(), matt()));
    let offset = camera.ray_from_pixel(DVec2::splat(16.5));
    // |(5 - t, y t)| = 0.75 in the horizontal plane.
    let (a, b) = (1.0 + offset.y * offset.y, 5.0);
    let expected = (b - (b * b - a * (25.0 - 0.5625)).sqrt()) / a;
    assert!((f64::from(upright.depth(&camera)[middle]) - expected).abs() < 1e-6);
    let lying = DMat3::from_rotation_y(std::f64::consts::FRAC_PI_2);
    let lying = only(Object::new(drum, matt()).turned(lying));
    assert!((lying.depth(&camera)[middle] - 4.5).abs() < 1e-6, "the cap");
    assert!((lying.normals(&camera)[middle][0] - 1.0).abs() < 1e-6);
    // From inside, the far wall is seen.
    let inside = Camera {
        position: DVec3::ZERO,
        ..camera
    };
    assert!((box_scene.depth(&inside)[middle] - 1.0).abs() < 1e-6);
}

#[test]
fn the_knot_is_closed() {
    // Every edge belongs to two triangles that run along it in opposite directions.
    for mesh in [knot(0.17, 60, 12), icosphere(1)] {
        let mut uses_from_edge = std::collections::HashMap::new();
        for &[a, b, c] in &mesh.triangles {
            for edge in [(a, b), (b, c), (c, a)] {
                *uses_from_edge.entry(edge).or_insert(0) += 1;
            }
        }
        for (&(from, to), &uses) in &uses_from_edge {
            assert_eq!((uses, uses_from_edge.get(&(to, from))), (1, Some(&1)));
        }
        // Outward: the signed volume is positive.
        let volume: f64 = (0..mesh.triangles.len())
            .map(|i| mesh.corners(i).map(|c| DVec3::from(c.map(f64::from))))
            .map(|[a, b, c]| a.dot(b.cross(c)) / 6.0)
            .sum();
        assert!(volume > 0.0, "{volume}");
    }
}

#[test]
fn wires_run_along_the_edges_at_their_radii() {
    let radii = [0.01, 0.03];
    let mesh = wires(1, radii, 8);
    // An icosahedron divided once has 120 edges.
    assert_eq!(mesh.triangles.len(), 120 * 2 * 8);
    let ends: Vec<DVec3> = icosphere(1)
        .positions
        .iter()
        .map(|p| DVec3::from(p.map(f64::from)))
        .collect();
    for (vertex, position) in mesh.positions.iter().enumerate() {
        let position = DVec3::from(position.map(f64::from));
        let nearest = ends
            .iter()
            .map(|end| end.distance(position))
            .fold(f64::INFINITY, f64::min);
        assert!((nearest - radii[vertex / 16 % 2]).abs() < 1e-6, "{nearest}");
    }
}

#[test]
fn a_mesh_is_centred_and_scaled() {
    let mut mesh = icosphere(2);
    mesh.positions.iter_mut().for_each(|p| *p = p.map(|x| 0.01 * x + 7.0));
    let scene = of_mesh(&mesh);
    let corners: Vec<DVec3> = scene
        .mesh()
        .positions
        .iter()
        .map(|p| DVec3::from(p.map(f64::from)))
        .collect();
    let low = corners.iter().copied().reduce(DVec3::min).unwrap();
    let high = corners.iter().copied().reduce(DVec3::max).unwrap();
    assert!(
        (low + high).length() < 1e-4 && ((high - low).length() - 2.5).abs() < 1e-4,
        "{low} to {high}"
    );
}

#[test]
fn points_lie_on_surfaces_and_have_their_colours() {
    for kind in Kind::ALL {
        let (scene, mut options) = small(kind);
        if matches!(kind, Kind::Intricate | Kind::Foliage | Kind::Facade | Kind::Cage) {
            // Scales of detail below a pixel have no colour there.
            (options.width, options.height, options.samples) = (192, 144, 2);
        }
        let data = scene.dataset(&options);
        assert_eq!(data.points.len(), options.points);
        let mut good = 0;
        for point in &data.points {
            let position = DVec3::from(point.position);
            let mut shown = Vec::new();
            for view in &data.views {
                let Some(pixel) = view.camera.pixel_from_world(position) else {
                    continue;
                };
                let size = DVec2::new(view.camera.width.into(), view.camera.height.into());
                if pixel.cmplt(DVec2::ZERO).any() || pixel.cmpge(size).any() {
                    continue;
                }
                let ray = Scene::ray(&view.camera, pixel);
                let depth = view.camera.view_from_world(position).z;
                let met = scene.hit(&ray, f64::INFINITY).map_or(f64::INFINITY, |(_, hit)| hit.t);
                assert!(met < depth * 1.0001, "nothing is at {position}");
                if met > depth * 0.9999 {
                    let PhotoSource::Memory(photo) = &view.photo else {
                        unreachable!()
                    };
                    let [x, y] = [pixel.x as usize, pixel.y as usize];
                    let [r, g, b, _] = photo.rgba[y * options.width as usize + x];
                    shown.push([r, g, b].map(|level| f32::from(level) / 255.0));
                }
            }
            assert!(!shown.is_empty(), "{kind:?}: nobody sees {position}");
            let near = |shown: &[f32; 3]| (0..3).all(|i| (shown[i] - point.color[i]).abs() < 0.12);
            good += usize::from(shown.iter().any(near));
        }
        // The rest lie within a pixel of an edge.
        assert!(good * 100 > data.points.len() * 93, "{kind:?}: {good}");
    }
}

#[test]
fn photographs_are_the_rounded_image_and_cutouts_have_its_alpha() {
    let (scene, options) = small(Kind::Sphere);
    let camera = scene.cameras(&options)[0];
    let photo = scene.photo(&camera, 2);
    let rounded: Vec<[u8; 3]> = scene.image(&camera, 2).iter().map(|c| c.map(Photo::level)).collect();
    let colors: Vec<[u8; 3]> = photo.rgba.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
    assert_eq!(rounded, colors);
    assert!(photo.rgba.iter().all(|c| c[3] == 255));
    // A cutout composited over the background equals the photograph up to rounding.
    for (cut, whole) in scene.cutout(&camera, 2).rgba.iter().zip(&photo.rgba) {
        for i in 0..3 {
            let over = f32::from(cut[i]) * f32::from(cut[3]) / 255.0;
            assert!((over - f32::from(whole[i])).abs() <= 1.5, "{cut:?} {whole:?}");
        }
    }
}

#[test]
fn highlights_move_with_the_view_and_matt_surfaces_do_not() {
    let at = |material: Material| {
        let scene = only(Object::new(Shape::Sphere(1.0), material));
        let top = DVec3::new(0.0, -0.6, 0.8);
        let color = |from: DVec3| {
            scene.color(&Ray {
                origin: from,
                direction: top - from,
            })
        };
        let colors = [color(DVec3::new(-0.5, -4.0, 3.0)), color(DVec3::new(3.0, -3.0, 3.0))];
        let [Some(a), Some(b)] = colors else { panic!("missed") };
        (a - b).abs().max_element()
    };
    let plain = Texture::ripples([0.4; 3], 0.0, 1.0, 0);
    assert!(at(Material::matt(plain.clone())) < 1e-9);
    assert!(at(Material::glossy(plain, 0.4, 10.0)) > 0.05);
}

#[test]
fn a_data_set_is_a_function_of_its_options() {
    let (scene, options) = small(Kind::Demo);
    let data = scene.dataset(&options);
    let again = scene.dataset(&options);
    assert_eq!((&data.views, &data.points), (&again.views, &again.points));
    let other = scene.dataset(&SynthOptions {
        seed: 2,
        ..options.clone()
    });
    assert_ne!(data.points, other.points);
    assert_eq!(data.views, other.views, "the seed moves points only");
    let names: Vec<&str> = data.views.iter().map(|view| view.name.as_str()).collect();
    assert!(names.is_sorted());
    assert_eq!(data.split(crate::scene::Split::Test), [0, 8]);
    // Noise has its nominal size.
    let noisy = scene.dataset(&SynthOptions {
        point_noise: 0.02,
        ..options
    });
    let squares = data
        .points
        .iter()
        .zip(&noisy.points)
        .map(|(a, b)| (0..3).map(|i| (a.position[i] - b.position[i]).powi(2)).sum::<f64>());
    let deviation = (squares.sum::<f64>() / (3 * data.points.len()) as f64).sqrt();
    assert!((deviation - 0.02).abs() < 0.002, "{deviation}");
}

#[test]
fn the_principal_point_and_the_focal_ratio_move_the_picture() {
    let (scene, options) = small(Kind::Sphere);
    let plain = scene.cameras(&options)[3];
    let skewed = SynthOptions {
        center_offset: DVec2::new(5.0, -3.0),
        focal_ratio: 1.1,
        ..options
    };
    let skewed = scene.cameras(&skewed)[3];
    let from = plain.pixel_from_world(DVec3::new(0.1, 0.2, 0.3)).unwrap() - plain.center;
    let to = skewed.pixel_from_world(DVec3::new(0.1, 0.2, 0.3)).unwrap() - plain.center;
    assert!(to.distance(from * DVec2::new(1.0, 1.1) + DVec2::new(5.0, -3.0)) < 1e-9);
}

#[test]
fn a_scene_nobody_sees_ends_without_points() {
    let options = small(Kind::Plane).1;
    let data = Scene::default().dataset(&options);
    assert!(data.points.is_empty());
    let none = scene(Kind::Plane).dataset(&SynthOptions { views: 0, ..options });
    assert!(none.views.is_empty() && none.points.is_empty());
}

#[test]
fn a_saved_data_set_says_the_same() {
    let (scene, options) = small(Kind::Solids);
    let data: Dataset = scene.dataset(&SynthOptions {
        cutout: true,
        ..options
    });
    let dir = tempfile::tempdir().unwrap();
    save(&data, dir.path()).unwrap();
    let text = std::fs::read_to_string(dir.path().join("transforms.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    for (view, frame) in data.views.iter().zip(json["frames"].as_array().unwrap()) {
        let number = |value: &serde_json::Value| value.as_f64().unwrap();
        let column = |j: usize| DVec3::from([0, 1, 2].map(|i| number(&frame["transform_matrix"][i][j])));
        // nerfstudio: x right, y up, z backward; here x right, y down, z forward.
        assert!(column(3).distance(view.camera.position) < 1e-12);
        assert!((column(0) - view.camera.rotation.row(0)).length() < 1e-12);
        assert!((column(1) + view.camera.rotation.row(1)).length() < 1e-12);
        assert!((column(2) + view.camera.rotation.row(2)).length() < 1e-12);
        assert_eq!(number(&frame["fl_x"]), view.camera.focal.x);
        let picture = image::open(dir.path().join(frame["file_path"].as_str().unwrap())).unwrap();
        let PhotoSource::Memory(photo) = &view.photo else {
            unreachable!()
        };
        assert_eq!(picture.into_rgba8().into_raw(), photo.rgba.as_flattened());
    }
    let ply = std::fs::read(dir.path().join("points.ply")).unwrap();
    let header = ply.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    assert_eq!(ply.len() - header, data.points.len() * 15);
    assert_eq!(
        ply[header..header + 4],
        (data.points[0].position[0] as f32).to_le_bytes()
    );
}
