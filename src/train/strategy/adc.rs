//! Adaptive density control as in 3DGS: at large screen gradients, small splats are cloned and large ones split in two;
//! transparent and oversized ones are removed.
//!
//! Two rules differ from 3DGS, so that a refinement changes the picture less. The halves of a split splat lie on both
//! sides of its mean along its longest axis (after Improved-GS, Deng et al. 2025), where 3DGS draws their means from
//! the splat's Gaussian. A clone and its original share the opacity (Bulò et al. 2024), where 3DGS doubles the optical
//! depth.

use super::relocation::relocated;
use super::{RefineContext, RefineReport, Row, RowChange, RowOrigin, SplatStats, gather};
use crate::scene::logit;
use crate::train::config::AdcConfig;
use crate::train::sky::SkyShell;
use crate::train::state::HostState;
use glam::{Quat, Vec3};

/// Decision on a row.
#[derive(Clone, Copy, Debug, PartialEq)]
enum AdcDecision {
    Keep,
    Prune,
    Clone,
    Split,
}

pub(super) fn refine(
    state: &mut HostState,
    stats: &[SplatStats],
    context: RefineContext<'_>,
) -> (RefineReport, Vec<RowOrigin>) {
    let fates = decide(state, stats, context);
    let mut rows = Vec::with_capacity(state.len() * 2);
    for (&fate, row) in fates.iter().zip(0..) {
        let kept = Row {
            source: row,
            mean: state.mean(row as usize),
            change: RowChange::Kept,
        };
        match fate {
            AdcDecision::Prune => {}
            AdcDecision::Keep => rows.push(kept),
            AdcDecision::Clone => rows.extend(pair(state, kept)),
            AdcDecision::Split => rows.extend(halves(state, row, &context.config.adc)),
        }
    }
    let (refined, origins) = gather(state, &rows);
    *state = refined;
    let count = |fate| fates.iter().filter(|&&f| f == fate).count();
    let report = RefineReport {
        cloned: count(AdcDecision::Clone),
        split: count(AdcDecision::Split),
        pruned: count(AdcDecision::Prune),
        relocated: 0,
        count: state.len(),
    };
    (report, origins)
}

/// Lowers all opacities, as drawn, to at most `value` (strictly between 0 and 1) and clears their moments, so that
/// splats must regain their opacity.
///
/// 3DGS resets to 0.01, where only the inner 1.37 standard deviations stay above the 1/255 cut: a splat of which only
/// the rest is visible gets no gradient any more and is pruned.
///
/// Splats of the sky keep theirs: nothing else explains it meanwhile.
pub fn reset_opacity(state: &mut HostState, value: f32, sky: Option<SkyShell>) {
    for row in 0..state.len() {
        if is_sky(state, row, sky) {
            continue;
        }
        // Smoothing lowers the opacity further; if that alone suffices, the logit stays.
        let before = f64::from(value) / state.smoothing_factor(row);
        if before < 1.0 {
            let most = logit(before) as f32;
            let place = &mut state.params[0][row];
            place[3] = place[3].min(most);
        }
    }
    // A state of geometry alone has no moments.
    let moments = state.m.first_mut().into_iter().chain(state.v.first_mut());
    for moment in moments.flatten() {
        moment[3] = 0.0;
    }
}

fn is_sky(state: &HostState, row: usize, sky: Option<SkyShell>) -> bool {
    sky.is_some_and(|shell| shell.holds(state.mean(row)))
}

fn decide(state: &HostState, stats: &[SplatStats], context: RefineContext<'_>) -> Vec<AdcDecision> {
    let mut fates: Vec<AdcDecision> = (0..state.len())
        .map(|row| prune_or_keep(state, row, stats[row], context))
        .collect();
    let survivors = fates.iter().filter(|&&fate| fate == AdcDecision::Keep).count();
    let mut wanted: Vec<(f32, usize, AdcDecision)> = (0..state.len())
        .filter_map(|row| {
            let fate = grow(state, row, stats[row], fates[row], context)?;
            Some((mean_gradient(stats[row]), row, fate))
        })
        .collect();
    wanted.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut count = survivors;
    for (_, row, fate) in wanted {
        // A clone adds a row; a split replaces one by two, and the row of a splat to be pruned is free already.
        let added = 1 + usize::from(fates[row] == AdcDecision::Prune);
        if count + added <= context.limit {
            fates[row] = fate;
            count += added;
        }
    }
    fates
}

/// Whether a row is pruned in its current state.
fn prune_or_keep(state: &HostState, row: usize, stats: SplatStats, context: RefineContext<'_>) -> AdcDecision {
    let adc = &context.config.adc;
    let faint = is_faint(state, row, context);
    let seen_big = adc.prune_radius_px > 0.0 && stats[2] > adc.prune_radius_px;
    let big = is_big(state.max_scale(row), context) || seen_big && prunes_big(context);
    if faint || big && !is_sky(state, row, context.sky) || !state.is_finite(row) {
        AdcDecision::Prune
    } else {
        AdcDecision::Keep
    }
}

/// Whether a row is below the pruning opacity, as drawn.
fn is_faint(state: &HostState, row: usize, context: RefineContext<'_>) -> bool {
    let drawn = state.opacity(row) * state.smoothing_factor(row);
    drawn < f64::from(context.config.adc.prune_opacity)
}

fn prunes_big(context: RefineContext<'_>) -> bool {
    context.iteration > context.config.adc.prune_big_from
}

fn is_big(scale: f64, context: RefineContext<'_>) -> bool {
    prunes_big(context) && scale > f64::from(context.config.adc.prune_scale) * context.extent
}

/// Clone or split, if any, of a row with the decision `fate` so far. A row too big in the world may still be split if
/// its children are not (3DGS prunes after splitting).
fn grow(
    state: &HostState,
    row: usize,
    stats: SplatStats,
    fate: AdcDecision,
    context: RefineContext<'_>,
) -> Option<AdcDecision> {
    let adc: &AdcConfig = &context.config.adc;
    if !state.is_finite(row) || is_faint(state, row, context) {
        return None;
    }
    // NaN is not above the threshold; a splat never seen has no gradient.
    if mean_gradient(stats) < adc.grad_threshold || stats[1] < 1.0 {
        return None;
    }
    let scale = state.max_scale(row);
    if scale > f64::from(adc.dense_fraction) * context.extent {
        let child = scale / f64::from(adc.split_factor);
        (!is_big(child, context) || is_sky(state, row, context.sky)).then_some(AdcDecision::Split)
    } else {
        (fate == AdcDecision::Keep).then_some(AdcDecision::Clone)
    }
}

/// Mean gradient over the steps that saw the splat; 0 if there were none or it is not finite.
fn mean_gradient(stats: SplatStats) -> f32 {
    let mean = stats[0] / stats[1];
    if mean.is_finite() { mean } else { 0.0 }
}

/// A row and its clone, each with half of the optical depth; the row keeps its moments.
fn pair(state: &HostState, kept: Row) -> [Row; 2] {
    let (opacity, _) = relocated(state.opacity(kept.source as usize), 2);
    let logit = logit(opacity) as f32;
    let log_factors = [0.0; 3];
    [RowChange::Faded(logit), RowChange::Renewed { logit, log_factors }].map(|change| Row { change, ..kept })
}

/// The two halves of a row, on both sides of its mean along its longest axis.
fn halves(state: &HostState, row: u32, adc: &AdcConfig) -> [Row; 2] {
    let index = row as usize;
    let [w, x, y, z] = state.params[1][index];
    let rotation = Quat::from_xyzw(x, y, z, w);
    // A zero quaternion has no direction; such a splat is not drawn and splits along an axis of the world.
    let rotation = if rotation.length_squared() > 0.0 {
        rotation.normalize()
    } else {
        Quat::IDENTITY
    };
    let log_scales = state.params[2][index];
    // A surfel has no third axis.
    let axes = 1..state.primitive.scale_count();
    let longest = axes.fold(0, |longest, axis| {
        if log_scales[axis] > log_scales[longest] {
            axis
        } else {
            longest
        }
    });
    let offset = rotation * Vec3::AXES[longest] * (log_scales[longest].exp() * adc.split_offset);
    let change = RowChange::Renewed {
        logit: state.params[0][index][3],
        log_factors: [-adc.split_factor.ln(); 3],
    };
    let parent = Vec3::from(state.mean(index));
    [-1.0, 1.0].map(|side| {
        // At an infinite scale the halves stay at the mean.
        let mean = Some(parent + offset * side).filter(|mean| mean.is_finite());
        Row {
            source: row,
            mean: mean.unwrap_or(parent).to_array(),
            change,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::super::tracking::{context, state_of};
    use super::*;
    use crate::scene::Primitive;
    use crate::train::TrainConfig;

    const SEEN: SplatStats = [1.0, 1.0, 1.0, 0.0];
    const QUIET: SplatStats = [0.0, 1.0, 1.0, 0.0];

    fn refine(state: &mut HostState, stats: &[SplatStats], config: &TrainConfig) -> RefineReport {
        super::refine(state, stats, context(config, 100)).0
    }

    #[test]
    fn halves_of_an_infinite_scale_have_a_place() {
        let config = TrainConfig::for_iterations(1_000);
        let mut state = state_of(&[(0.5, 0.5)]);
        state.params[2][0] = [200.0, -1.0, 0.0, 0.0];
        let report = refine(&mut state, &[SEEN], &config);
        assert_eq!((report.split, state.len()), (1, 2));
        assert!((0..2).all(|row| state.mean(row).iter().all(|v| v.is_finite())));
    }

    #[test]
    fn small_splats_are_cloned_and_large_ones_split() {
        let config = TrainConfig::for_iterations(1_000);
        let mut state = state_of(&[(0.5, 0.009), (0.5, 0.011), (0.5, 0.5), (0.004, 0.009)]);
        let report = refine(&mut state, &[SEEN, SEEN, QUIET, SEEN], &config);
        let expected = RefineReport {
            cloned: 1,
            split: 1,
            pruned: 1,
            relocated: 0,
            count: 5,
        };
        assert_eq!(report, expected);
        let mut scales: Vec<f64> = (0..5).map(|row| state.max_scale(row)).collect();
        scales.sort_unstable_by(f64::total_cmp);
        let wanted = [0.011 / 1.6, 0.011 / 1.6, 0.009, 0.009, 0.5];
        for (scale, wanted) in scales.iter().zip(wanted) {
            assert!((scale / wanted - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn halves_lie_on_both_sides_along_the_longest_axis() {
        let config = TrainConfig::for_iterations(1_000);
        let mut state = state_of(&[(0.8, 0.1)]);
        let turn = Quat::from_rotation_z(std::f32::consts::FRAC_PI_4);
        state.params[0][0][..3].copy_from_slice(&[1.0, 2.0, 3.0]);
        state.params[1][0] = [turn.w, turn.x, turn.y, turn.z];
        state.params[2][0] = [0.1_f32.ln(), 0.4_f32.ln(), 0.2_f32.ln(), 0.0];
        state.m[0][0] = [1.0; 4];
        assert_eq!(refine(&mut state, &[SEEN], &config).split, 1);
        // The y axis points to (-1, 1, 0) / √2.
        let step = 0.4 / 2_f32.sqrt();
        let mut means = [0, 1].map(|row| Vec3::from(state.mean(row)));
        means.sort_unstable_by(|a, b| a.x.total_cmp(&b.x));
        for (mean, side) in means.into_iter().zip([1.0, -1.0]) {
            let wanted = Vec3::new(1.0 - side * step, 2.0 + side * step, 3.0);
            assert!((mean - wanted).length() < 1e-5, "{mean}");
        }
        for row in 0..2 {
            let scales = state.params[2][row].map(f32::exp);
            for (found, wanted) in scales.into_iter().zip([0.0625, 0.25, 0.125]) {
                assert!((found / wanted - 1.0).abs() < 1e-5, "{scales:?}");
            }
            assert!((state.opacity(row) - 0.8).abs() < 1e-6);
            assert_eq!(state.m[0][row], [0.0; 4]);
        }
    }

    #[test]
    fn a_clone_and_its_original_look_like_one_splat() {
        let config = TrainConfig::for_iterations(1_000);
        let mut state = state_of(&[(0.9, 0.001)]);
        state.m[0][0] = [1.0; 4];
        assert_eq!(refine(&mut state, &[SEEN], &config).cloned, 1);
        let transmittance = (1.0 - state.opacity(0)) * (1.0 - state.opacity(1));
        assert!((transmittance - 0.1).abs() < 1e-6);
        // Only the original keeps its moments.
        let mut moments = [state.m[0][0], state.m[0][1]];
        moments.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
        assert_eq!(moments, [[0.0; 4], [1.0; 4]]);
    }

    #[test]
    fn halves_of_surfels_lie_in_their_planes() {
        let config = TrainConfig::for_iterations(1_000);
        let mut state = state_of(&[(0.5, 0.1); 50]);
        state.primitive = Primitive::Surfel;
        let turn = Quat::from_xyzw(0.3, -0.5, 0.2, 0.7).normalize();
        for row in 0..50 {
            state.params[0][row][..3].copy_from_slice(&[1.0, 2.0, 3.0]);
            state.params[1][row] = [turn.w, turn.x, turn.y, turn.z];
            // The third scale is the largest, and not looked at.
            state.params[2][row] = [0.4_f32.ln(), 0.1_f32.ln(), 5.0, 0.0];
        }
        assert!((state.max_scale(0) - 0.4).abs() < 1e-6);
        let report = refine(&mut state, &[SEEN; 50], &config);
        assert_eq!((report.split, state.primitive), (50, Primitive::Surfel));
        let mut moved = 0.0_f32;
        for row in 0..state.len() {
            let offset = Vec3::from(state.mean(row)) - Vec3::new(1.0, 2.0, 3.0);
            assert!((turn * Vec3::Z).dot(offset).abs() < 1e-5, "{offset}");
            moved = moved.max(offset.length());
        }
        assert!((moved - 0.4).abs() < 1e-5, "{moved}");
    }

    #[test]
    fn oversized_splats_are_gone_after_one_refinement_late_enough() {
        let mut config = TrainConfig::for_iterations(30_000);
        let sizes = [(0.5, 0.2), (0.5, 0.05), (0.5, 0.005)];
        let wide = [0.0, 1.0, 21.0, 0.0];
        let stats = [QUIET, QUIET, wide];
        let pruned = |config: &TrainConfig, iteration| {
            let mut state = state_of(&sizes);
            super::refine(&mut state, &stats, context(config, iteration)).0.pruned
        };
        assert_eq!(pruned(&config, 3_000), 0);
        assert_eq!(pruned(&config, 3_100), 1);
        config.adc.prune_radius_px = 20.0;
        assert_eq!(pruned(&config, 3_100), 2);
        // A big splat with a large gradient is split first, and its children are tested.
        let mut state = state_of(&[(0.5, 0.15), (0.5, 0.3)]);
        let report = super::refine(&mut state, &[SEEN; 2], context(&config, 3_100)).0;
        assert_eq!((report.split, report.pruned, report.count), (1, 1, 2));
    }

    #[test]
    fn a_cap_takes_the_largest_gradients_and_the_first_of_equals() {
        let mut config = TrainConfig::for_iterations(1_000);
        config.max_splats = Some(6);
        let mut state = state_of(&[(0.5, 0.001); 4]);
        let stats = [[1.0, 1.0, 0.0, 0.0], [2.0, 1.0, 0.0, 0.0], SEEN, SEEN];
        let report = refine(&mut state, &stats, &config);
        assert_eq!((report.cloned, report.count), (2, 6));
        let mut from: Vec<f32> = state.params[3].iter().map(|sh| sh[0]).collect();
        from.sort_unstable_by(f32::total_cmp);
        assert_eq!(from, [0.0, 0.0, 1.0, 1.0, 2.0, 3.0]);
        config.max_splats = Some(3);
        let report = refine(&mut state, &[SEEN; 6], &config);
        assert_eq!((report.cloned, report.split, report.count), (0, 0, 6));
    }

    #[test]
    fn nothing_one_and_only_dead_splats_are_handled() {
        let config = TrainConfig::for_iterations(1_000);
        let mut none = state_of(&[]);
        assert_eq!(refine(&mut none, &[], &config), RefineReport::default());
        let mut one = state_of(&[(0.5, 0.001)]);
        let never_seen = [[f32::NAN, 0.0, 0.0, 0.0]];
        assert_eq!(refine(&mut one, &never_seen, &config).count, 1);
        let mut dead = state_of(&[(0.001, 0.001); 9]);
        assert_eq!(refine(&mut dead, &[SEEN; 9], &config).pruned, 9);
        assert!(dead.is_empty());
        let mut broken = state_of(&[(0.5, 0.001); 2]);
        broken.params[1][0][2] = f32::NAN;
        assert_eq!(refine(&mut broken, &[SEEN; 2], &config).pruned, 1);
    }

    #[test]
    fn a_reset_lowers_opacities_and_forgets_only_their_moments() {
        let mut state = state_of(&[(0.5, 0.1), (0.006, 0.1)]);
        state.m[0] = vec![[1.0; 4]; 2];
        reset_opacity(&mut state, 0.01, None);
        assert!((state.opacity(0) - 0.01).abs() < 1e-6);
        assert!((state.opacity(1) - 0.006).abs() < 1e-6);
        assert_eq!(state.m[0], vec![[1.0, 1.0, 1.0, 0.0]; 2]);
    }

    #[test]
    fn smoothed_splats_are_judged_and_reset_as_they_are_drawn() {
        let config = TrainConfig::for_iterations(1_000);
        // A filter as wide as the splat leaves 2^(-3/2) of its opacity; a hundredth of it leaves 1 - 1.5e-4.
        let filtered = || {
            let mut state = state_of(&[(0.012, 0.1), (0.012, 0.1), (0.9, 0.1)]);
            for (row, sigma) in state.params[2].iter_mut().zip([0.1, 0.001, 0.1]) {
                row[3] = sigma;
            }
            state
        };
        assert_eq!(refine(&mut filtered(), &[QUIET; 3], &config).pruned, 1);
        let mut state = filtered();
        reset_opacity(&mut state, 0.01, None);
        let drawn = |row| state.opacity(row) * state.smoothing_factor(row);
        let kept = 0.012 / 8_f64.sqrt();
        for (row, wanted) in [kept, 0.01, 0.01].into_iter().enumerate() {
            assert!((drawn(row) / wanted - 1.0).abs() < 1e-5, "{}", drawn(row));
        }
    }
}
