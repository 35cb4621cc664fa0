//! Mip mode and its 3D filter (entries 29 and 30), and needles (entry 10): pictures nearer and farther than the
//! photographs, at subpixel offsets, and in other units. Effects of single splats are exact and are tested in `conic`;
//! here are whole scenes, trained in seconds.

use crate::common::pack;
use crate::common::scenes::{self, Scene};
use crate::stability::lab;
use crate::stability::lab::{Lab, lab, within};
use crate::stability::trained::{cameras, psnr_db, train};
use ashfall::lab::synth::{self, Kind, SynthOptions};
use ashfall::reference::frame::discontinuity_margins;
use ashfall::render::{Accuracy, Model, RenderOptions, RenderedImage, Renderer, ViewOptions, planes_from_splats};
use ashfall::scene::{Camera, Dataset, ScreenFilter, Splats, Split};
use ashfall::train::smoothing::{refresh, sampling_rates};
use ashfall::train::{HostState, TrainConfig};
use glam::{DMat3, DVec2, DVec3};

/// Zooms in by longer focal lengths at the same picture size, and out by a smaller picture of the same field of view.
fn zoomed(camera: &Camera, zoom: f64) -> Camera {
    if zoom < 1.0 {
        let size = |n: u32| (f64::from(n) * zoom).round() as u32;
        return camera.resized(size(camera.width), size(camera.height));
    }
    let middle = 0.5 * DVec2::new(camera.width.into(), camera.height.into());
    Camera {
        focal: camera.focal * zoom,
        center: middle + zoom * (camera.center - middle),
        ..*camera
    }
}

fn dataset(scene: &synth::Scene) -> Dataset {
    scene.dataset(&SynthOptions {
        views: 18,
        width: 80,
        height: 64,
        points: 600,
        test_every: 6,
        ..SynthOptions::default()
    })
}

fn config(filter: ScreenFilter) -> TrainConfig {
    TrainConfig {
        filter,
        sh_degree: 0,
        ..TrainConfig::for_iterations(320)
    }
}

/// Held-out views against ray-cast truth, 16 × 16 samples a pixel for smaller pictures.
#[test]
fn f029_zoom_sweep() {
    let lab = lab();
    let scene = synth::scene(Kind::Demo);
    let dataset = dataset(&scene);
    // Training amplifies rounding: one run's gain is uncertain by some tenths of a decibel, the mean of three less.
    let trained = [ScreenFilter::Classic, ScreenFilter::Mip].map(|filter| {
        [0, 1, 2].map(|seed| {
            let config = TrainConfig { seed, ..config(filter) };
            train(&lab, &dataset, &config)
        })
    });
    let test = cameras(&dataset, Split::Test);
    // Required mean gain of mip mode by zoom, decibels.
    let wanted = [
        (0.125, 6.0),
        (0.25, 6.0),
        (0.5, 4.0),
        (1.0, -0.2),
        (2.0, 1.0),
        (4.0, 1.0),
    ];
    for (zoom, gain) in wanted {
        let cameras: Vec<Camera> = test.iter().map(|c| zoomed(c, zoom)).collect();
        let samples = if zoom < 1.0 { 16 } else { 3 };
        let scores = psnr_db(&lab, trained.as_flattened(), &scene, &cameras, samples);
        let [before, after] = [&scores[..3], &scores[3..]].map(|runs| runs.iter().sum::<f64>() / 3.0);
        println!("zoom {zoom}: {before:.2} dB, mip {after:.2} dB");
        within("frame", "f029", &format!("dB lost at x{zoom}"), before - after, -gain);
    }
    let [plain, mip] = [&trained[0][0], &trained[1][0]].map(|splats| flicker(&lab, splats, &scene, &test[0]));
    within("frame", "f029", "flicker of a quarter-size picture", mip, 0.5 * plain);
}

/// Temporal noise of a pixel's error while the picture shifts through a pixel in eight steps: the root of the mean
/// variance. The truth shifts as well, so only flicker remains.
fn flicker(lab: &Lab, splats: &Splats, scene: &synth::Scene, camera: &Camera) -> f64 {
    let base = zoomed(camera, 0.25);
    let model = Model::upload(lab.gpu(), splats).unwrap();
    let mut renderer = Renderer::new(lab.gpu(), RenderOptions::default()).unwrap();
    let errors: Vec<Vec<f64>> = (0..8)
        .map(|step| {
            let offset = DVec2::new(f64::from(step) / 8.0, f64::from(step * 3 % 8) / 8.0);
            let camera = Camera {
                center: base.center + offset,
                ..base
            };
            let options = ViewOptions {
                background: [0.0; 3],
                near: 0.01,
                filter: splats.filter,
            };
            let found = renderer.render(&model, &camera, &options).unwrap().rgb;
            let truth = scene.image(&camera, 16);
            let pairs = found.as_flattened().iter().zip(truth.as_flattened());
            pairs.map(|(a, b)| f64::from(a - b)).collect()
        })
        .collect();
    let values = errors[0].len();
    let variance = |i: usize| {
        let mean = errors.iter().map(|e| e[i]).sum::<f64>() / 8.0;
        errors.iter().map(|e| (e[i] - mean).powi(2)).sum::<f64>() / 8.0
    };
    ((0..values).map(variance).sum::<f64>() / values as f64).sqrt()
}

/// One white splat of standard deviation `sigma` px before black, straight ahead in a picture of 24 × 24.
fn spot(sigma: f64) -> Scene {
    let mut scene = scenes::gentle(90, 1, 24, 24, 0);
    let depth = 4.0;
    scene.camera = Camera {
        width: 24,
        height: 24,
        focal: DVec2::splat(64.0),
        center: DVec2::splat(12.0),
        rotation: DMat3::IDENTITY,
        position: DVec3::ZERO,
    };
    scene.options.background = [0.0; 3];
    scene.splats = Splats {
        mean: vec![[0.0, 0.0, depth as f32]],
        quaternion: vec![[1.0, 0.0, 0.0, 0.0]],
        log_scale: vec![[(sigma * depth / 64.0).ln() as f32; 3]],
        // 1 − opacity is 6e-6.
        opacity_logit: vec![12.0],
        sh: vec![0.5 / ashfall::scene::SH_C0; 3],
        filter: ScreenFilter::Mip,
        ..Splats::default()
    };
    scene
}

/// Largest over smallest total light of a spot that moves through a pixel, less 1.
fn light_variation(lab: &Lab, spot: &Scene) -> f64 {
    let model = Model::upload(lab.gpu(), &spot.splats).unwrap();
    let mut renderer = Renderer::new(
        lab.gpu(),
        RenderOptions {
            accuracy: Accuracy {
                alpha_min: CUT,
                ..Accuracy::default()
            },
            ..RenderOptions::default()
        },
    )
    .unwrap();
    let (mut least, mut most) = (f64::INFINITY, 0.0f64);
    for step in 0..16 {
        let offset = DVec2::new(f64::from(step) / 16.0, f64::from(step * 5 % 16) / 16.0);
        let mut camera = spot.camera;
        camera.center += offset;
        let options = lab::view_options(spot);
        let picture = renderer.render(&model, &camera, &options).unwrap();
        let light: f64 = picture.rgb.iter().map(|c| f64::from(c[0])).sum();
        (least, most) = (least.min(light), most.max(light));
    }
    most / least - 1.0
}

/// Alpha threshold here: at the usual 1/255, pixels of a faint spot's rim would come and go.
const CUT: f32 = 1e-6;

/// A Gaussian of variance v sampled at pixel centres sums to its integral times Σ exp(-2π² k² v) cos(2π k φ) over all k
/// on each axis (Poisson), with its position φ in the pixel: with a = 2 exp(-2π² v) its light lies between (1 - a)² and
/// (1 + a)², the next term being a⁴ / 8 and, for variances from 0.3, under 1e-11. The threshold is reached at o exp(-r²
/// / 2v) = CUT for drawn opacity o: 2πv CUT of 2πv o lie beyond. The bound allows all of it to vary, times four, as a
/// sum over pixels is no integral. Sums round 576 terms: 576u.
fn variation_bound(variance: f64, opacity: f64) -> f64 {
    let a = 2.0 * (-2.0 * std::f64::consts::PI.powi(2) * variance).exp();
    ((1.0 + a) / (1.0 - a)).powi(2) - 1.0 + 4.0 * f64::from(CUT) / opacity + 576.0 * lab::U
}

#[test]
fn f029_no_shimmer_between_pixels() {
    let lab = lab();
    for sigma in [0.2, 0.3, 0.5, 1.0, 2.0] {
        let spot = spot(sigma);
        // As after training with one view, that of the picture.
        let mut state = HostState::from_splats(&spot.splats, 0);
        let mip = config(ScreenFilter::Mip).mip;
        refresh(&mut state, &[spot.camera], 0.1, &mip);
        let trained = Scene {
            splats: state.to_splats(ScreenFilter::Mip),
            ..spot.clone()
        };
        let s = sigma * sigma;
        // Both filters take their factor for two axes, smoothing that of the third as well.
        let opacity = s / (s + 0.3) * (s / (s + 0.2)).sqrt();
        let bound = variation_bound(s + 0.3, opacity);
        let what = format!("light of a spot of {sigma} px");
        within("frame", "f029", &what, light_variation(&lab, &trained), bound);
        // Validity of the test: without the 3D filter a thin splat shimmers.
        if sigma <= 0.3 {
            let raw = light_variation(&lab, &spot);
            assert!(raw > 2.0 * bound, "{what}: {raw}, not over {bound}");
        }
    }
}

/// Largest difference of two pictures of a scene, away from its discontinuities.
fn apart(scene: &Scene, a: &RenderedImage, b: &RenderedImage) -> f64 {
    let margins = discontinuity_margins(&scene.splats, &scene.camera, &scene.options);
    let pixels = a.rgb.iter().zip(&b.rgb).zip(&margins);
    let away = pixels.filter(|(_, at)| at.nearest() > 1e-4);
    away.flat_map(|((a, b), _)| (0..3).map(|c| (f64::from(a[c]) - f64::from(b[c])).abs()))
        .fold(0.0, f64::max)
}

/// Draws with one 3D filter per splat, as in training.
fn draw_filtered(lab: &Lab, scene: &Scene, filters: &[f32]) -> RenderedImage {
    let mut planes = planes_from_splats(&scene.splats);
    pack::set_filters(&mut planes, filters);
    let model = Model::upload(lab.gpu(), &scene.splats).unwrap();
    assert_eq!(model.params.len(), 1, "a small scene is one block");
    lab.gpu().upload(&model.params[0], 0, &planes).unwrap();
    let mut renderer = Renderer::new(lab.gpu(), RenderOptions::default()).unwrap();
    let options = lab::view_options(scene);
    renderer.render(&model, &scene.camera, &options).unwrap()
}

/// Baking rounds like drawing with the filter: scales and their logarithms to 8 in magnitude, 8u each, logits likewise;
/// an alpha of power p ≤ 5.55 multiplies a scale's relative error by 2 p and the opacity's by 1, 12 · 16u in all, and
/// compositing does not amplify it. Colours lie between 0 and 1.
const BAKED: f64 = 200.0 * lab::U;

fn filtered_scene(seed: u64) -> (Scene, Vec<f32>) {
    let mut scene = scenes::gentle(seed, 80, 64, 48, 1);
    scene.splats.filter = ScreenFilter::Mip;
    let filters = scenes::filters(&scene.splats, seed);
    (scene, filters)
}

#[test]
fn f030_a_baked_scene_is_drawn_as_it_was_trained() {
    let lab = lab();
    let (scene, filters) = filtered_scene(91);
    let mut state = HostState::from_splats(&scene.splats, 1);
    for (row, &filter) in state.params[2].iter_mut().zip(&filters) {
        row[3] = filter;
    }
    let baked = Scene {
        splats: state.to_splats(ScreenFilter::Mip),
        ..scene.clone()
    };
    let (trained, drawn) = (draw_filtered(&lab, &scene, &filters), lab.draw(&baked));
    let error = apart(&baked, &trained, &drawn);
    within("frame", "f030", "baked filter", error, BAKED);
    let without = lab::difference(&trained, &lab.draw(&scene));
    assert!(without > 0.05, "the filter does nothing: {without}");
}

/// Independence of the unit: products of squared scales underflow in small units and overflow in large ones; ratios do
/// not.
#[test]
fn f030_filters_have_no_unit() {
    let lab = lab();
    let (scene, filters) = filtered_scene(92);
    let clean = draw_filtered(&lab, &scene, &filters);
    for exponent in [-40, -20, 20, 40] {
        let factor = 2f64.powi(exponent);
        let mut scaled = scene.clone();
        scaled.camera.position *= factor;
        scaled.options.near *= factor;
        for x in scaled.splats.mean.iter_mut().flatten() {
            *x *= factor as f32;
        }
        for x in scaled.splats.log_scale.iter_mut().flatten() {
            *x += (factor as f32).ln();
        }
        let filters: Vec<f32> = filters.iter().map(|f| f * factor as f32).collect();
        let found = draw_filtered(&lab, &scaled, &filters);
        // Log-scales of up to 32 round four times as coarsely.
        let error = apart(&scene, &found, &clean);
        within("frame", "f030", &format!("unit 2^{exponent}"), error, 4.0 * BAKED);
    }
}

/// Smallest standard deviation of each splat in sampling intervals of its closest view.
fn thinnest(splats: &Splats, dataset: &Dataset) -> Vec<f64> {
    let near = dataset.extent() * 0.01;
    let rates = sampling_rates(&splats.mean, &cameras(dataset, Split::Train), near, 0.15);
    let thin = |(scale, rate): (&[f32; 3], Option<f64>)| {
        let least = scale.iter().copied().fold(f32::INFINITY, f32::min);
        rate.map(|rate| f64::from(least).exp() * rate)
    };
    splats.log_scale.iter().zip(rates).filter_map(thin).collect()
}

#[test]
fn f030_no_trained_splat_is_thinner_than_what_was_seen() {
    let lab = lab();
    let dataset = dataset(&synth::scene(Kind::Demo));
    let mut config = config(ScreenFilter::Mip);
    config.iterations = 250;
    let share_thin = |config: &TrainConfig| {
        let widths = thinnest(&train(&lab, &dataset, config), &dataset);
        // Means still move after the last refinement, by less than a tenth of their depth.
        let thin = widths.iter().filter(|w| **w < 0.9 * 0.2f64.sqrt());
        thin.count() as f64 / widths.len() as f64
    };
    within("training", "f030", "share of thin splats", share_thin(&config), 1e-3);
    config.mip.smoothing = 0.0;
    let without = share_thin(&config);
    assert!(without > 0.05, "only {without} of the splats are thin without");
}

#[test]
fn f010_the_aspect_of_splats_is_bounded() {
    let lab = lab();
    let dataset = dataset(&synth::scene(Kind::Demo));
    let most = |max_aspect: f32| {
        let config = TrainConfig {
            max_aspect,
            iterations: 150,
            ..config(ScreenFilter::Classic)
        };
        let aspect = |s: &[f32; 3]| {
            let (low, high) = (s[0].min(s[1]).min(s[2]), s[0].max(s[1]).max(s[2]));
            f64::from(high - low).exp()
        };
        let splats = train(&lab, &dataset, &config);
        splats.log_scale.iter().map(aspect).fold(0.0, f64::max)
    };
    // Log-scales of up to 8 round by 8u each.
    within(
        "training",
        "f010",
        "aspect bounded by 1.5",
        most(1.5),
        1.5 * (1.0 + 20.0 * lab::U),
    );
    let free = most(0.0);
    assert!(free > 2.0, "aspects grow to {free} only");
}
