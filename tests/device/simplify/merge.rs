//! Merging without training: order, splats left alone, and loss of image quality.

use crate::common::device;
use crate::common::scenes::{self, Random, Scene};
use crate::simplify::{pass_options, weigher};
use ashfall::gpu::Gpu;
use ashfall::render::Compatibility;
use ashfall::scene::{ScreenFilter, Splats};
use ashfall::simplify::{Difference, difference, kept, merge, rates};
use glam::{Quat, Vec3};

fn merged(splats: &Splats, rates: &[f64], share: f64) -> Splats {
    merge(splats, rates, share, &mut |_| true).unwrap().splats
}

fn crowd() -> Splats {
    scenes::gentle(31, 300, 60, 45, 0).splats
}

/// `count` splats in place of each: nearby, smaller, fainter, so that together they look about the same.
fn oversampled(scene: &Scene, count: usize, seed: u64) -> Scene {
    let random = &mut Random::new(seed);
    let indices: Vec<usize> = (0..scene.splats.len() * count).map(|i| i / count).collect();
    let mut splats = scene.splats.picked(&indices);
    for i in 0..splats.len() {
        let rotation = {
            let [w, x, y, z] = splats.quaternion[i];
            Quat::from_xyzw(x, y, z, w).normalize()
        };
        let local = splats.log_scale[i].map(|s| s.exp() * 0.35 * random.normal() as f32);
        let mean = Vec3::from(splats.mean[i]) + rotation * Vec3::from(local);
        splats.mean[i] = mean.to_array();
        splats.log_scale[i] = splats.log_scale[i].map(|s| s - 0.06);
        let alpha = 1.0 / (1.0 + (-f64::from(splats.opacity_logit[i])).exp());
        let part = 1.0 - (1.0 - alpha).powf(1.0 / count as f64);
        splats.opacity_logit[i] = (part / (1.0 - part)).ln() as f32;
    }
    Scene {
        splats,
        ..scene.clone()
    }
}

fn compared(gpu: &Gpu, scene: &Scene, after: &Splats) -> Difference {
    let pass_options = pass_options(&scene.options, Compatibility::Engine);
    let [mut before, mut after] = [
        weigher(gpu, &scene.splats, pass_options),
        weigher(gpu, after, pass_options),
    ];
    let found = difference(&mut before, &mut after, &[scene.camera], &mut || true);
    found.unwrap().unwrap()
}

/// Merging away half of the splats costs a small part of the error of leaving out half of them.
#[test]
fn merging_half_costs_far_less_than_leaving_out_half() {
    let gpu = device::gpu();
    for filter in [ScreenFilter::Classic, ScreenFilter::Mip] {
        let mut simple = scenes::gentle(32, 60, 96, 72, 1);
        simple.splats.filter = filter;
        let scene = oversampled(&simple, 4, 33);
        let count = scene.splats.len();
        let rates = rates(&scene.splats, &[scene.camera], scene.options.near);
        let half = merged(&scene.splats, &rates, 0.5);
        assert_eq!((half.len(), half.filter), (count / 2, filter));
        let by_merging = compared(&gpu, &scene, &half);
        assert!(by_merging.pixels == 96 * 72 && by_merging.most >= by_merging.rms);

        let pass_options = pass_options(&scene.options, Compatibility::Engine);
        let mut scales = weigher(&gpu, &scene.splats, pass_options);
        let weights = scales.removal_errors(&scene.camera).unwrap();
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|&a, &b| weights[a].weight.total_cmp(&weights[b].weight));
        let without = |gone: &[usize]| {
            let mut removed = vec![false; count];
            gone.iter().for_each(|&i| removed[i] = true);
            compared(&gpu, &scene, &kept(&scene.splats, &removed)).psnr_db()
        };
        let by_weight = without(&order[..count / 2]);
        let by_chance = without(&Random::new(34).permutation(count)[..count / 2]);
        let by_merging = by_merging.psnr_db();
        println!("{filter:?}: merged {by_merging:.2} dB, by weight {by_weight:.2} dB, by chance {by_chance:.2} dB");
        assert!(by_merging > 45.0, "{filter:?}: {by_merging}");
        assert!(
            by_merging > by_weight.max(by_chance) + 15.0,
            "{filter:?}: {by_weight}, {by_chance}"
        );
    }
}

#[test]
fn a_scene_is_no_different_from_itself() {
    let gpu = device::gpu();
    let scene = scenes::gentle(35, 20, 16, 16, 0);
    let none = compared(&gpu, &scene, &scene.splats);
    assert_eq!((none.pixels, none.most, none.rms), (256, 0.0, 0.0));
    assert_eq!(none.psnr_db(), f64::INFINITY);
    let nothing = scene.splats.picked(&[]);
    let all = compared(&gpu, &scene, &nothing);
    assert!(all.most > 0.05 && all.most <= 1.5 && all.rms > 0.01 && all.psnr_db() < 40.0);
}

/// Invariance under rotation, translation and change of unit.
#[test]
fn prices_know_no_unit_and_no_direction() {
    let splats = crowd();
    let plain = merged(&splats, &vec![25.0; splats.len()], 0.4);
    let turn = Quat::from_xyzw(0.3, -0.5, 0.2, 0.7).normalize();
    for (turn, shift, scale) in [
        (turn, Vec3::ZERO, 1.0),
        (Quat::IDENTITY, Vec3::new(0.5, -1.0, 2.0), 1.0),
        (Quat::IDENTITY, Vec3::ZERO, 2f32.powi(40)),
        (turn, Vec3::new(3.0, -1.0, 2.0), 0.01),
    ] {
        let place = |mean: &[f32; 3]| (turn * Vec3::from(*mean) * scale + shift * scale).to_array();
        let mut other = splats.clone();
        other.mean = splats.mean.iter().map(place).collect();
        for q in &mut other.quaternion {
            let [w, x, y, z] = *q;
            let length = Quat::from_xyzw(x, y, z, w).length();
            let q_new = turn * Quat::from_xyzw(x, y, z, w) / length;
            *q = [q_new.w, q_new.x, q_new.y, q_new.z];
        }
        other.log_scale.iter_mut().flatten().for_each(|s| *s += scale.ln());
        let other = merged(&other, &vec![25.0 / f64::from(scale); splats.len()], 0.4);
        assert_eq!(other.len(), plain.len());
        for (i, mean) in plain.mean.iter().enumerate() {
            let off = (Vec3::from(place(mean)) - Vec3::from(other.mean[i])).length();
            assert!(off < 1e-4 * scale, "{i}: {off}");
            let off = other.opacity_logit[i] - plain.opacity_logit[i];
            assert!(off.abs() < 1e-2, "{i}: {off}");
            for c in 0..3 {
                assert!((other.sh[3 * i + c] - plain.sh[3 * i + c]).abs() < 1e-4);
            }
        }
    }
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let splats = scenes::hard(36, 700, 60, 45, 2).splats;
    let rates = vec![30.0; splats.len()];
    let by = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| merged(&splats, &rates, 0.6))
    };
    let one = by(1);
    assert!(one.len() >= 280 && one.len() < 700);
    for threads in [2, 3, 7] {
        assert_eq!(one, by(threads), "{threads} threads");
    }
}

/// Two clusters of coincident splats in a scene of others: they are merged first, and no other splat changes.
#[test]
fn what_lies_in_one_place_goes_first() {
    let mut splats = crowd();
    for cluster in [10, 200] {
        for i in cluster + 1..cluster + 5 {
            splats = copied(splats, cluster, i);
        }
    }
    splats.opacity_logit.fill(-6.0);
    let rates = vec![25.0; splats.len()];
    let left = merged(&splats, &rates, 8.5 / 300.0);
    assert_eq!(left.len(), 292);
    let others: Vec<usize> = (0..300)
        .filter(|i| !(11..15).contains(i) && !(201..205).contains(i))
        .collect();
    let wanted = splats.picked(&others);
    for (place, &i) in others.iter().enumerate() {
        if i == 10 || i == 200 {
            let off = (Vec3::from(left.mean[place]) - Vec3::from(splats.mean[i])).length();
            assert!(off < 1e-5, "{off}");
            // Five faint splats cover five times as much, less their mutual occlusion.
            let gain = left.opacity_logit[place] - splats.opacity_logit[i];
            assert!((gain - 5f32.ln()).abs() < 0.05, "{gain}");
        } else {
            assert_eq!(left.picked(&[place]), wanted.picked(&[place]), "{i}");
        }
    }
}

/// The same scene with splat `from` copied over splat `to`.
fn copied(mut splats: Splats, from: usize, to: usize) -> Splats {
    splats.mean[to] = splats.mean[from];
    splats.quaternion[to] = splats.quaternion[from];
    splats.log_scale[to] = splats.log_scale[from];
    splats.opacity_logit[to] = splats.opacity_logit[from];
    let stride = splats.sh_stride();
    splats.sh.copy_within(from * stride..(from + 1) * stride, to * stride);
    splats
}

#[test]
fn what_has_no_shape_is_left_alone() {
    let sound = scenes::gentle(37, 60, 20, 20, 1).splats;
    let mut splats = sound.clone();
    splats.mean[0][1] = f32::NAN;
    splats.mean[1][0] = f32::INFINITY;
    splats.quaternion[2] = [0.0; 4];
    splats.log_scale[3][2] = f32::NAN;
    splats.log_scale[4] = [f32::MAX; 3];
    splats.opacity_logit[5] = f32::NEG_INFINITY;
    splats.opacity_logit[6] = -2000.0;
    splats.sh[7 * 12 + 4] = f32::NAN;
    splats.quaternion[8][0] = f32::NAN;
    let mut rates = vec![30.0; 60];
    for (rate, i) in [0.0, -1.0, f64::NAN, f64::INFINITY].into_iter().zip(9..) {
        rates[i] = rate;
    }
    let left = merge(&splats, &rates, 1.0, &mut |_| true).unwrap();
    // The valid splats become one; the invalid ones stay unchanged.
    assert_eq!((left.splats.len(), left.gone), (14, 46));
    let bits = |splats: &Splats, i: usize| {
        let rest = [splats.opacity_logit[i]];
        let sh = &splats.sh[i * splats.sh_stride()..][..splats.sh_stride()];
        let geometry = splats.mean[i].iter().chain(&splats.quaternion[i]);
        let all = geometry.chain(&splats.log_scale[i]).chain(&rest).chain(sh);
        all.map(|v| v.to_bits()).collect::<Vec<_>>()
    };
    for i in 0..13 {
        assert_eq!(bits(&left.splats, i), bits(&splats, i), "{i}");
    }
    assert_eq!(left.splats.picked(&[13]).not_finite(), None);
}

#[test]
fn few_many_far_and_extreme_splats_merge_to_numbers() {
    for count in [0, 1, 2] {
        let splats = scenes::gentle(38, count, 20, 20, 3).splats;
        let left = merged(&splats, &vec![30.0; count], 1.0);
        assert_eq!(left.len(), count.min(1));
        assert_eq!(left.not_finite(), None);
        assert_eq!(merged(&splats, &vec![30.0; count], 0.0), splats);
    }
    let crowd = crowd();
    let twins = crowd.picked(&[5; 2_000]);
    let left = merged(&twins, &[30.0; 2_000], 0.9);
    assert_eq!((left.len(), left.not_finite()), (200, None));
    let off = |mean: &[f32; 3]| (Vec3::from(*mean) - Vec3::from(crowd.mean[5])).length();
    assert!(left.mean.iter().all(|mean| off(mean) < 1e-5));
    for (scale, shift, opacity) in [
        (0.0, 1e6, 0.0),
        (80.0, 1e37, 40.0),
        (-80.0, 0.0, -40.0),
        (3.0, 1e30, 90.0),
    ] {
        let mut far = crowd.clone();
        far.mean.iter_mut().for_each(|mean| mean[0] += shift);
        far.log_scale.iter_mut().flatten().for_each(|s| *s += scale);
        far.opacity_logit.iter_mut().for_each(|o| *o += opacity);
        let left = merged(&far, &vec![30.0; 300], 0.5);
        assert_eq!(left.not_finite(), None, "{scale}, {shift}");
        assert!(left.len() >= 150, "{}", left.len());
    }
    let mut needles = crowd;
    for (i, scale) in needles.log_scale.iter_mut().enumerate() {
        *scale = if i % 2 == 0 {
            [1.0, -9.0, -9.0]
        } else {
            [0.5, 0.5, -14.0]
        };
    }
    let left = merged(&needles, &[30.0; 300], 0.5);
    assert_eq!((left.len(), left.not_finite()), (150, None));
}

#[test]
fn who_says_stop_is_heard_while_merging() {
    let splats = crowd();
    let rates = vec![30.0; splats.len()];
    let mut asked = 0;
    let whole = merge(&splats, &rates, 0.5, &mut |gone| {
        assert!(gone <= 150);
        asked += 1;
        true
    });
    assert_eq!(whole.map(|m| m.gone), Some(150));
    for stop in 0..asked {
        let mut left: i32 = stop;
        let stopped = merge(&splats, &rates, 0.5, &mut |_| {
            left -= 1;
            left >= 0
        });
        assert_eq!(stopped, None, "after {stop}");
    }
}

/// Rates are those of the nearest view; an unseen splat gets the lowest rate.
#[test]
fn rates_are_pixels_per_world_unit() {
    let scene = scenes::gentle(39, 30, 40, 30, 0);
    let mut splats = scene.splats.clone();
    splats.mean[3] = [1e6, 0.0, 0.0];
    let rates = rates(&splats, &[scene.camera], 0.05);
    let focal = scene.camera.focal.max_element();
    let depth = |i: usize| {
        let mean = glam::DVec3::from(splats.mean[i].map(f64::from));
        scene.camera.view_from_world(mean).z
    };
    let mut lowest = f64::INFINITY;
    for i in (0..30).filter(|&i| i != 3) {
        assert!((rates[i] * depth(i) / focal - 1.0).abs() < 1e-12);
        lowest = lowest.min(rates[i]);
    }
    assert_eq!(rates[3], lowest);
    assert_eq!(ashfall::simplify::rates(&splats, &[], 0.05), [1.0; 30]);
}
