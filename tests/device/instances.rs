//! Instances: models in their places, sorted together, against their splats moved in f64 and against single models.

use crate::common::device::gpu;
use crate::common::scenes::{Random, Scene, gentle};
use ashfall::gpu::Gpu;
use ashfall::reference::frame::{margins, render_splats};
use ashfall::reference::{Splat, Viewpoint};
use ashfall::render::{ClipBox, Instance, Model, RenderOptions, RenderedImage, Renderer, ViewOptions};
use ashfall::scene::{SH_C0, ScreenFilter, Similarity, sh_basis};
use glam::{DMat3, DMat4, DQuat, DVec3};

const SIZE: [u32; 2] = [97, 65];

/// A scene before its camera, and the place of its model: the splats are moved by the inverse of the place first, so
/// that instances fill the picture whatever their places are.
struct Part {
    model: Model,
    baked: Vec<Splat<f64>>,
    place: Similarity,
}

fn place(random: &mut Random, scale: f64) -> Similarity {
    let [x, y, z, w] = [0; 4].map(|_| random.normal());
    Similarity {
        rotation: DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize()),
        scale,
        translation: DVec3::new(random.normal(), random.normal(), random.normal()) * 3.0,
    }
}

/// Quaternion of a product of rotations, w first.
fn turned(rotation: DMat3, [w, x, y, z]: [f64; 4]) -> [f64; 4] {
    let own = DQuat::from_xyzw(x, y, z, w);
    let all = DQuat::from_mat3(&rotation) * own.normalize();
    [all.w, all.x, all.y, all.z]
}

/// Coefficients of f(R⁻¹ d), by integrals of its products with the functions: exact for degrees up to 3 by eight points
/// of Gauss in z times 16 around it.
fn turned_harmonics(rotation: DMat3, sh: &[[f64; 3]]) -> Vec<[f64; 3]> {
    const GAUSS: [(f64, f64); 4] = [
        (0.183_434_642_495_649_8, 0.362_683_783_378_362),
        (0.525_532_409_916_329, 0.313_706_645_877_887_3),
        (0.796_666_477_413_626_7, 0.222_381_034_453_374_5),
        (0.960_289_856_497_536_3, 0.101_228_536_290_376_3),
    ];
    let mut turned = vec![[0.0; 3]; sh.len()];
    for (z, weight) in GAUSS.into_iter().flat_map(|(z, w)| [(z, w), (-z, w)]) {
        for step in 0..16 {
            let angle = f64::from(step) * std::f64::consts::TAU / 16.0;
            let r = (1.0 - z * z).sqrt();
            let d = DVec3::new(r * angle.cos(), r * angle.sin(), z);
            let before = sh_basis((rotation.transpose() * d).to_array());
            let after = sh_basis(d.to_array());
            let area = weight * std::f64::consts::TAU / 16.0;
            for channel in 0..3 {
                let value: f64 = sh.iter().zip(before).map(|(c, y)| c[channel] * y).sum();
                for (coefficient, y) in turned.iter_mut().zip(after) {
                    coefficient[channel] += area * value * y;
                }
            }
        }
    }
    turned
}

/// A splat moved by a similarity.
fn moved(splat: &Splat<f64>, by: &Similarity) -> Splat<f64> {
    Splat {
        mean: by.point(DVec3::from(splat.mean)).to_array(),
        quaternion: turned(by.rotation, splat.quaternion),
        log_scale: splat.log_scale.map(|s| s + by.scale.ln()),
        opacity_logit: splat.opacity_logit,
        sh: turned_harmonics(by.rotation, &splat.sh),
    }
}

/// Rounds a splat's numbers to those of a device.
fn stored(scene: &Scene, splats: &[Splat<f64>]) -> ashfall::scene::Splats {
    let single = |v: f64| v as f32;
    ashfall::scene::Splats {
        mean: splats.iter().map(|s| s.mean.map(single)).collect(),
        quaternion: splats.iter().map(|s| s.quaternion.map(single)).collect(),
        log_scale: splats.iter().map(|s| s.log_scale.map(single)).collect(),
        opacity_logit: splats.iter().map(|s| single(s.opacity_logit)).collect(),
        sh: splats
            .iter()
            .flat_map(|s| s.sh.iter().flatten().copied().map(single))
            .collect(),
        ..scene.splats.clone()
    }
}

fn inverse(of: &Similarity) -> Similarity {
    Similarity {
        rotation: of.rotation.transpose(),
        scale: of.scale.recip(),
        translation: of.point_before(DVec3::ZERO),
    }
}

/// Every third splat of a scene as a model of its own, so that the models interpenetrate.
fn parts(gpu: &Gpu, scene: &Scene, places: &[Similarity]) -> Vec<Part> {
    let all = Splat::<f64>::all(&scene.splats);
    let part = |(index, place): (usize, &Similarity)| {
        let own = all.iter().skip(index).step_by(places.len());
        let own: Vec<_> = own.map(|splat| moved(splat, &inverse(place))).collect();
        let splats = stored(scene, &own);
        let model = Model::upload(gpu, &splats).unwrap();
        // The stored numbers, moved in f64.
        let baked = Splat::<f64>::all(&splats)
            .iter()
            .map(|splat| moved(splat, place))
            .collect();
        Part {
            model,
            baked,
            place: *place,
        }
    };
    places.iter().enumerate().map(part).collect()
}

fn instances(parts: &[Part]) -> Vec<Instance<'_>> {
    let mut all = Vec::new();
    for part in parts {
        all.push(Instance {
            world_from_model: part.place,
            ..Instance::new(&part.model)
        });
    }
    all
}

fn view(scene: &Scene) -> ViewOptions {
    ViewOptions {
        background: scene.options.background.map(|c| c as f32),
        near: scene.options.near as f32,
        filter: scene.splats.filter,
    }
}

fn draw(gpu: &Gpu, scene: &Scene, instances: &[Instance<'_>]) -> RenderedImage {
    let mut renderer = Renderer::new(gpu, RenderOptions::default()).unwrap();
    renderer
        .render_instances(instances, &scene.camera, &view(scene))
        .unwrap()
}

/// Largest error over the pixels far from any discontinuity, and their share.
fn error(scene: &Scene, image: &RenderedImage, splats: &[Splat<f64>]) -> (f64, f64) {
    let viewpoint = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    let expected = render_splats(splats, &viewpoint, &scene.options);
    let margins = margins(splats, &viewpoint, &scene.options);
    let (mut largest, mut far) = (0.0_f64, 0);
    for (i, (pixel, margin)) in expected.pixels.iter().zip(&margins).enumerate() {
        if margin.nearest() > 1e-4 {
            far += 1;
            for channel in 0..3 {
                largest = largest.max((f64::from(image.rgb[i][channel]) - pixel.color[channel]).abs());
            }
            largest = largest.max((f64::from(image.transmittance[i]) - pixel.transmittance).abs());
        }
    }
    (largest, far as f64 / margins.len() as f64)
}

/// Error allowed beside the reference in f64. The instances' camera and matrix are rounded once, which moves a mean by
/// 2⁻²⁴ of its distance from the model's origin, here up to three times its depth.
const TOLERANCE: f64 = 5e-6;

fn baked(parts: &[Part]) -> Vec<Splat<f64>> {
    parts.iter().flat_map(|part| part.baked.clone()).collect()
}

#[test]
fn interpenetrating_instances_are_their_splats_moved_in_f64() {
    let gpu = gpu();
    let random = &mut Random::new(5);
    for (seed, scales, filter) in [
        (1, vec![1.0, 1.0, 1.0], ScreenFilter::Classic),
        (2, vec![1e-3, 0.3, 4.0, 1e3], ScreenFilter::Classic),
        (3, vec![2.0, 0.5], ScreenFilter::Mip),
    ] {
        let mut scene = gentle(seed, 90, SIZE[0], SIZE[1], 3);
        scene.splats.filter = filter;
        let places: Vec<Similarity> = scales.iter().map(|&scale| place(random, scale)).collect();
        let parts = parts(&gpu, &scene, &places);
        let image = draw(&gpu, &scene, &instances(&parts));
        let (largest, far) = error(&scene, &image, &baked(&parts));
        println!("scales {scales:?}: {largest:.2e}, {far:.3} of the pixels");
        assert!(largest <= TOLERANCE && far > 0.8, "{scales:?}: {largest}, {far}");
        // Harmonics that are not rotated with their model are noticed.
        let unturned = |part: &Part| {
            let own = part.baked.iter().map(|splat| Splat {
                sh: turned_harmonics(part.place.rotation.transpose(), &splat.sh),
                ..splat.clone()
            });
            own.collect::<Vec<_>>()
        };
        let wrong: Vec<_> = parts.iter().flat_map(unturned).collect();
        let (largest, _) = error(&scene, &image, &wrong);
        assert!(largest > 100.0 * TOLERANCE, "{largest}");
    }
}

#[test]
fn an_instance_in_place_has_the_bits_of_its_model() {
    let gpu = gpu();
    for (seed, degree) in [(4, 0), (5, 2), (6, 3)] {
        let mut scene = gentle(seed, 90, SIZE[0], SIZE[1], degree);
        for filter in [ScreenFilter::Classic, ScreenFilter::Mip] {
            scene.splats.filter = filter;
            let model = Model::upload(&gpu, &scene.splats).unwrap();
            let image = draw(&gpu, &scene, &[Instance::new(&model)]);
            let mut renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
            let alone = renderer.render(&model, &scene.camera, &view(&scene)).unwrap();
            assert_eq!((image.rgb, image.transmittance), (alone.rgb, alone.transmittance));
        }
    }
}

/// A list in another order, with a model twice and an empty one: the pictures differ by ties only, of which there are
/// none.
#[test]
fn the_order_of_instances_does_not_count() {
    let gpu = gpu();
    let random = &mut Random::new(9);
    let scene = gentle(7, 150, SIZE[0], SIZE[1], 2);
    let places = [0.5, 1.0, 2.0].map(|scale| place(random, scale));
    let parts = parts(&gpu, &scene, &places);
    let nothing = Model::upload(&gpu, &gentle(1, 0, 8, 8, 2).splats).unwrap();
    let mut all = instances(&parts);
    all.push(Instance {
        world_from_model: Similarity {
            translation: all[0].world_from_model.translation + DVec3::new(0.01, 0.02, 0.03),
            ..all[0].world_from_model
        },
        ..all[0]
    });
    let first = draw(&gpu, &scene, &all);
    all.rotate_left(2);
    all.insert(1, Instance::new(&nothing));
    all.insert(0, Instance::new(&nothing));
    let other = draw(&gpu, &scene, &all);
    assert_eq!((&first.rgb, &first.transmittance), (&other.rgb, &other.transmittance));
    all.pop();
    assert_ne!(draw(&gpu, &scene, &all).rgb, first.rgb);
}

#[test]
fn no_instances_are_the_background() {
    let gpu = gpu();
    let scene = gentle(7, 10, SIZE[0], SIZE[1], 0);
    let image = draw(&gpu, &scene, &[]);
    let background = scene.options.background.map(|c| c as f32);
    assert!(image.rgb.iter().all(|pixel| *pixel == background));
    assert!(image.transmittance.iter().all(|t| *t == 1.0));
}

/// Opacity, tint and clip box, against splats changed in f64.
#[test]
fn looks_of_instances_are_those_of_changed_splats() {
    let gpu = gpu();
    let random = &mut Random::new(11);
    let scene = gentle(8, 120, SIZE[0], SIZE[1], 1);
    let places = [0.7, 1.5].map(|scale| place(random, scale));
    let parts = parts(&gpu, &scene, &places);
    let (opacity, tint) = (0.375_f32, [1.25_f32, 0.5, 0.75]);
    let ahead = scene.camera.position + scene.camera.rotation.transpose() * DVec3::new(0.2, -0.1, 4.0);
    let turn = DMat4::from_quat(DQuat::from_xyzw(0.2, 0.5, -0.1, 0.8).normalize());
    let world_from_cube = DMat4::from_translation(ahead) * turn * DMat4::from_scale(DVec3::new(1.1, 0.8, 1.3));
    for cuts_inside in [false, true] {
        let mut all = instances(&parts);
        all[0].opacity = opacity;
        all[0].tint = tint;
        all[1].clip = Some(ClipBox {
            world_from_cube,
            cuts_inside,
        });
        let image = draw(&gpu, &scene, &all);
        let changed = |splat: &Splat<f64>| {
            let alpha = f64::from(opacity) / (1.0 + (-splat.opacity_logit).exp());
            let mut splat = Splat {
                opacity_logit: (alpha / (1.0 - alpha)).ln(),
                ..splat.clone()
            };
            for coefficient in &mut splat.sh {
                *coefficient = std::array::from_fn(|c| coefficient[c] * f64::from(tint[c]));
            }
            let constant = f64::from(SH_C0);
            splat.sh[0] = std::array::from_fn(|c| splat.sh[0][c] + 0.5 * (f64::from(tint[c]) - 1.0) / constant);
            splat
        };
        let is_inside = |splat: &&Splat<f64>| {
            let cube = world_from_cube.inverse().transform_point3(DVec3::from(splat.mean));
            cube.abs().max_element() <= 1.0
        };
        let (inside, outside): (Vec<_>, Vec<_>) = parts[1].baked.iter().partition(is_inside);
        assert!(
            inside.len() > 5 && outside.len() > 5,
            "{} and {}",
            inside.len(),
            outside.len()
        );
        let kept = if cuts_inside { outside } else { inside };
        let mut splats: Vec<_> = parts[0].baked.iter().map(changed).collect();
        splats.extend(kept.into_iter().cloned());
        let (largest, far) = error(&scene, &image, &splats);
        println!("cuts {cuts_inside}: {largest:.2e}, {far:.3} of the pixels");
        assert!(largest <= TOLERANCE && far > 0.8, "{largest}, {far}");
        splats.pop();
        assert!(
            error(&scene, &image, &splats).0 > 100.0 * TOLERANCE,
            "a splat more or less is not noticed"
        );
    }
}

/// An opacity of 0 leaves the others as they are.
#[test]
fn instances_may_be_hidden() {
    let gpu = gpu();
    let random = &mut Random::new(13);
    let scene = gentle(9, 60, SIZE[0], SIZE[1], 1);
    let places = [0.7, 1.5].map(|scale| place(random, scale));
    let parts = parts(&gpu, &scene, &places);
    let mut all = instances(&parts);
    all[1].opacity = 0.0;
    assert_eq!(draw(&gpu, &scene, &all).rgb, draw(&gpu, &scene, &all[..1]).rgb);
}

#[test]
fn faulty_instances_are_refused_with_their_number() {
    let gpu = gpu();
    let scene = gentle(9, 20, SIZE[0], SIZE[1], 1);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    let mut refused = |change: &dyn Fn(&mut Instance<'_>)| {
        let mut all = [Instance::new(&model); 2];
        change(&mut all[1]);
        let drawn = renderer.render_instances(&all, &scene.camera, &view(&scene));
        let message = drawn.unwrap_err().to_string();
        assert!(message.starts_with("instance 1: "), "{message}");
        message
    };
    assert!(refused(&|i| i.world_from_model.scale = -1.0).contains("scale is -1"));
    assert!(refused(&|i| i.world_from_model.scale = f64::NAN).contains("not finite"));
    assert!(refused(&|i| i.world_from_model.rotation = DMat3::ZERO).contains("unevenly"));
    assert!(refused(&|i| i.world_from_model.translation.y = f64::INFINITY).contains("not finite"));
    assert!(refused(&|i| i.opacity = 1.5).contains("opacity of 1.5"));
    assert!(refused(&|i| i.opacity = f32::NAN).contains("opacity of NaN"));
    assert!(refused(&|i| i.tint[2] = -0.5).contains("tint"));
    let flat = ClipBox::between(DVec3::ZERO, DVec3::new(1.0, 0.0, 1.0));
    assert!(refused(&|i| i.clip = Some(flat)).contains("clip box"));
    let options = RenderOptions {
        with_surface: true,
        ..RenderOptions::default()
    };
    let mut surfaces = Renderer::new(&gpu, options).unwrap();
    let drawn = surfaces.render_instances(&[Instance::new(&model)], &scene.camera, &view(&scene));
    assert!(drawn.unwrap_err().to_string().contains("surfaces of instances"));
}
