//! Pruning: the error bound against the oracle at every pixel of every view, on adversarial scenes.

use crate::common::scenes::{Random, Scene};
use ashfall::gpu::Gpu;
use ashfall::reference::frame::{center, project_all, sorted};
use ashfall::reference::rasterize::weights;
use ashfall::reference::rasterize::{discontinuity_margin, layer, rasterize};
use ashfall::reference::{Options, ScreenSplat, Splat, Thresholds, Viewpoint};
use ashfall::render::Compatibility;
use ashfall::scene::{Camera, SH_C0, Splats};
use ashfall::simplify::{ContributionPass, MeasuredChange, PassOptions, Promise, PruneResult, kept, measure, prune};

mod auto;
mod merge;
mod removal_error;
mod sh_error;
mod sh_fit;

/// A scene and several cameras.
struct World {
    name: &'static str,
    scene: Scene,
    cameras: Vec<Camera>,
}

fn world(name: &'static str, scene: Scene, views: u64) -> World {
    let Camera { width, height, .. } = scene.camera;
    let other = |seed| crate::common::scenes::camera(&mut Random::new(900 + seed), width, height);
    let cameras = std::iter::once(scene.camera).chain((1..views).map(other));
    World {
        name,
        cameras: cameras.collect(),
        scene,
    }
}

/// Many faint splats, each hardly visible, before a bright one.
fn faint_stack() -> Scene {
    let mut scene = crate::common::scenes::gentle(1, 160, 16, 25, 0);
    for i in 0..scene.splats.len() {
        scene.splats.opacity_logit[i] = -4.6 + 0.002 * i as f32;
        scene.splats.log_scale[i] = [-0.5; 3];
    }
    scene
}

/// A wall with splats before and behind it.
fn wall() -> Scene {
    let mut scene = crate::common::scenes::gentle(2, 90, 25, 18, 1);
    for i in (0..scene.splats.len()).step_by(9) {
        scene.splats.opacity_logit[i] = 12.0;
        scene.splats.log_scale[i] = [0.3; 3];
    }
    scene
}

/// Needles in all directions.
fn needles() -> Scene {
    let mut scene = crate::common::scenes::gentle(3, 120, 30, 20, 0);
    for i in 0..scene.splats.len() {
        scene.splats.log_scale[i] = [1.0, -4.5, -4.5];
        scene.splats.opacity_logit[i] = if i % 3 == 0 { 2.0 } else { -4.0 };
    }
    scene
}

/// Colours far above and below the displayable range.
fn glaring() -> Scene {
    let mut scene = faint_stack();
    for (i, value) in scene.splats.sh.iter_mut().enumerate() {
        *value *= if i % 7 == 0 { 30.0 } else { -1.0 };
    }
    scene.splats.sh[0] = 100.0 / SH_C0;
    scene
}

/// Splats of which some are in no view.
fn unseen() -> Scene {
    let mut scene = crate::common::scenes::gentle(4, 60, 20, 20, 0);
    for i in 0..20 {
        scene.splats.mean[i] = [1e4, 1e4, 1e4];
    }
    scene.splats.opacity_logit[20] = f32::NAN;
    scene
}

fn worlds() -> Vec<World> {
    vec![
        world("faint stack", faint_stack(), 2),
        world("seen by one view", faint_stack(), 1),
        world("wall", wall(), 2),
        world("needles", needles(), 2),
        world("glaring", glaring(), 1),
        world("hard", crate::common::scenes::hard(5, 90, 25, 19, 1), 2),
        world("unseen", unseen(), 2),
        world("nothing", crate::common::scenes::gentle(6, 0, 9, 9, 0), 2),
    ]
}

fn pass_options(options: &Options, compatibility: Compatibility) -> PassOptions {
    PassOptions {
        near: options.near as f32,
        background: options.background.map(|c| c as f32),
        compatibility,
    }
}

fn weigher(gpu: &Gpu, splats: &Splats, pass_options: PassOptions) -> ContributionPass {
    ContributionPass::new(gpu, splats, pass_options).unwrap()
}

fn pruned(gpu: &Gpu, world: &World, error: f64, compatibility: Compatibility) -> (PruneResult, MeasuredChange) {
    let pass_options = pass_options(&world.scene.options, compatibility);
    let mut before = weigher(gpu, &world.scene.splats, pass_options);
    pruned_by(gpu, &mut before, world, error)
}

/// Prunes a scene that is already on the device.
fn pruned_by(gpu: &Gpu, before: &mut ContributionPass, world: &World, error: f64) -> (PruneResult, MeasuredChange) {
    let found = prune(before, &world.cameras, error, &mut || true);
    let found = found.unwrap().unwrap();
    let left = kept(&world.scene.splats, &found.removed);
    let mut after = weigher(gpu, &left, *before.pass_options());
    let promise = Promise {
        weight: error,
        color: 0.0,
    };
    let change = measure(before, &mut after, &world.cameras, promise, &mut || true);
    (found, change.unwrap().unwrap())
}

/// A view's projected and sorted splats by the oracle.
struct Seen {
    splats: Vec<ScreenSplat<f64>>,
    splat_from_rank: Vec<usize>,
    order: Vec<usize>,
    background: [f64; 3],
}

impl Seen {
    fn new(splats: &Splats, camera: &Camera, options: &Options) -> Seen {
        let view = Viewpoint::new(camera, options, splats.filter);
        let (list, splat_from_rank) = sorted(&project_all(&Splat::<f64>::all(splats), &view));
        Seen {
            order: (0..list.len()).collect(),
            splats: list,
            splat_from_rank,
            background: options.background,
        }
    }

    /// Pairs of splat index and weight at a pixel.
    fn weights(&self, at: [f64; 2]) -> Vec<(usize, f64)> {
        let weights = weights(&self.splats, &self.order, at, &Thresholds::ENGINE);
        let named = |(rank, weight)| (self.splat_from_rank[rank], weight);
        weights.into_iter().map(named).collect()
    }

    fn color(&self, at: [f64; 2], skipped: &[bool]) -> ([f64; 3], f64) {
        let shown: Vec<usize> = self
            .order
            .iter()
            .copied()
            .filter(|&rank| !skipped.get(self.splat_from_rank[rank]).unwrap_or(&false))
            .collect();
        let pixel = rasterize(&self.splats, &shown, at, self.background, &Thresholds::ENGINE);
        (pixel.color, pixel.transmittance)
    }

    /// Largest range of a channel over the background and the splats that cover a pixel.
    fn range(&self, at: [f64; 2]) -> f64 {
        let mut range = self.background.map(|c| [c, c]);
        for splat in self
            .splats
            .iter()
            .filter(|s| layer(s, at, &Thresholds::ENGINE).is_some())
        {
            for (range, c) in range.iter_mut().zip(splat.color) {
                *range = [range[0].min(c), range[1].max(c)];
            }
        }
        range.iter().map(|[low, high]| high - low).fold(0.0, f64::max)
    }

    fn is_near(&self, at: [f64; 2]) -> bool {
        let margin = discontinuity_margin(&self.splats, &self.order, at, &Thresholds::ENGINE);
        margin.alpha_min.min(margin.transmittance) < 1e-4 || margin.order < 1e-6
    }
}

/// M16, by the oracle: removed weights stay within the limit at every pixel, the picture changes by at most their sum
/// times its range, and almost every remaining splat would exceed the limit somewhere.
fn check(world: &World, found: &PruneResult, error: f64) {
    let (name, splats) = (world.name, &world.scene.splats);
    let mut most_with = vec![0.0_f64; splats.len()];
    let (mut pixels, mut excused) = (0, 0);
    for camera in &world.cameras {
        let seen = Seen::new(splats, camera, &world.scene.options);
        let (width, height) = (camera.width as usize, camera.height as usize);
        for pixel in 0..width * height {
            let at = center(pixel, width);
            let weights = seen.weights(at);
            let gone = weights.iter().filter(|(splat, _)| found.removed[*splat]);
            let spent: f64 = gone.map(|(_, weight)| weight).sum();
            for &(splat, weight) in &weights {
                most_with[splat] = most_with[splat].max(spent + weight);
            }
            pixels += 1;
            let (before, passing) = seen.color(at, &[]);
            let (after, _) = seen.color(at, &found.removed);
            let leak = if passing < 1e-4 { passing } else { 0.0 };
            let bound = (spent + leak) * seen.range(at) + 1e-12;
            let moved = |(a, b): (&f64, f64)| (a - b).abs() <= bound;
            if spent > error || !before.iter().zip(after).all(moved) {
                // One weight may have appeared or vanished by rounding.
                excused += 1;
                assert!(seen.is_near(at), "{name}, {error}: {spent} at pixel {pixel}");
            }
        }
    }
    assert!(excused * 200 <= pixels, "{name}: {excused} of {pixels} pixels");
    // 2e-3: the device's margin for rounding, and its rounding error.
    let could_go = |&i: &usize| !found.removed[i] && most_with[i] <= error * (1.0 - 2e-3);
    let could = (0..splats.len()).filter(could_go).count();
    assert!(
        could <= splats.len() / 50,
        "{name}, {error}: {could} of {} could still go",
        splats.len()
    );
}

#[test]
fn what_goes_keeps_to_its_bound_at_every_pixel() {
    let gpu = crate::common::device::gpu();
    for world in worlds() {
        let pass_options = pass_options(&world.scene.options, Compatibility::Engine);
        let mut before = weigher(&gpu, &world.scene.splats, pass_options);
        for error in [1.0 / 512.0, 1.0 / 64.0, 0.3] {
            let (found, change) = pruned_by(&gpu, &mut before, &world, error);
            check(&world, &found, error);
            assert_eq!(change.broken, 0, "{}: {change:?}", world.name);
            assert!(change.nearest <= 1.0, "{}: {change:?}", world.name);
            println!(
                "{:18} {error:.4}: {:3} of {:3} went in {:2} rounds, {:.3} of the bound",
                world.name,
                found.count,
                world.scene.splats.len(),
                found.rounds,
                change.nearest
            );
        }
    }
}

/// The same set as sequential greedy removal by the oracle's weights.
#[test]
fn rounds_take_what_the_greedy_rule_takes() {
    let gpu = crate::common::device::gpu();
    for world in worlds() {
        let error = 1.0 / 32.0;
        let (found, _) = pruned(&gpu, &world, error, Compatibility::Engine);
        let count = world.scene.splats.len();
        let mut entries = vec![Vec::new(); count];
        let mut pixels = 0;
        for camera in &world.cameras {
            let seen = Seen::new(&world.scene.splats, camera, &world.scene.options);
            for pixel in 0..(camera.width * camera.height) as usize {
                for (splat, weight) in seen.weights(center(pixel, camera.width as usize)) {
                    entries[splat].push((pixels, weight));
                }
                pixels += 1;
            }
        }
        let sum = |i: usize| entries[i].iter().map(|(_, weight)| weight).sum::<f64>();
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|&a, &b| sum(a).total_cmp(&sum(b)));
        let (mut spent, mut gone) = (vec![0.0; pixels], vec![false; count]);
        for i in order {
            let fits = |&(pixel, weight): &(usize, f64)| spent[pixel] + weight <= error * 0.999;
            gone[i] = entries[i].iter().all(fits);
            for &(pixel, weight) in entries[i].iter().filter(|_| gone[i]) {
                spent[pixel] += weight;
            }
        }
        // Splats with an alpha of 1/255 at some pixel, and near ties, may differ.
        let differ = (0..count).filter(|&i| gone[i] != found.removed[i]).count();
        assert!(differ <= count / 20, "{}: {differ} of {count}", world.name);
    }
}

#[test]
fn the_same_is_found_again() {
    let gpu = crate::common::device::gpu();
    let world = &worlds()[2];
    let once = pruned(&gpu, world, 1.0 / 64.0, Compatibility::Engine);
    assert_eq!(once, pruned(&gpu, world, 1.0 / 64.0, Compatibility::Engine));
}

#[test]
fn splats_that_nobody_sees_go_first() {
    let gpu = crate::common::device::gpu();
    let world = worlds().into_iter().find(|w| w.name == "unseen").unwrap();
    let (found, _) = pruned(&gpu, &world, 1e-6, Compatibility::Engine);
    assert!(found.removed[..21].iter().all(|&gone| gone));
    assert!(found.unseen >= 21 && found.count >= found.unseen);
}

/// The bound also holds under the 3DGS rules, which end pixels differently.
#[test]
fn scenes_of_others_are_weighed_by_their_rules() {
    let gpu = crate::common::device::gpu();
    for world in worlds() {
        let (found, change) = pruned(&gpu, &world, 1.0 / 64.0, Compatibility::Inria);
        assert_eq!(change.broken, 0, "{}: {change:?}", world.name);
        assert_eq!(found.removed.len(), world.scene.splats.len());
    }
}

#[test]
fn who_says_stop_is_heard() {
    let gpu = crate::common::device::gpu();
    let world = &worlds()[0];
    let pass_options = pass_options(&world.scene.options, Compatibility::Engine);
    for views in 0..8 {
        let mut left = views;
        let mut go_on = || {
            left -= 1;
            left >= 0
        };
        let mut weigher = weigher(&gpu, &world.scene.splats, pass_options);
        let found = prune(&mut weigher, &world.cameras, 0.01, &mut go_on).unwrap();
        assert!(found.is_none(), "after {views} views");
    }
}

/// Intersections beyond one binding are an error that names a remedy.
#[test]
fn too_many_pairs_for_a_binding_are_refused() {
    let gpu = crate::common::device::narrow(1 << 16);
    let mut scene = crate::common::scenes::gentle(7, 300, 64, 64, 0);
    scene.splats.log_scale.fill([1.0; 3]);
    let world = world("too much", scene, 1);
    let pass_options = pass_options(&world.scene.options, Compatibility::Engine);
    let mut weigher = weigher(&gpu, &world.scene.splats, pass_options);
    let found = prune(&mut weigher, &world.cameras, 0.01, &mut || true);
    let text = found.unwrap_err().to_string();
    assert!(text.contains("--downscale"), "{text}");
}
