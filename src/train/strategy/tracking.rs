//! Tests of every strategy: rows keep their identity and moments through a thousand refinements, and a repetition gives
//! the same bits.

use super::*;
use crate::scene::logit;
use crate::train::rng::{self, Stream};

/// Splats of given opacity and size at random places; the first colour coefficient is the row.
pub(super) fn state_of(splats: &[(f64, f64)]) -> HostState {
    let mut state = HostState::zeros(splats.len(), 0);
    for (row, &(opacity, scale)) in splats.iter().enumerate() {
        let [x, y, z, _] = rng::normal(9, 0, row as u32, Stream::RandomInit);
        let logit = logit(opacity.max(1e-9)) as f32;
        state.params[0][row] = [x, y, z, logit];
        state.params[1][row] = [1.0, 0.0, 0.0, 0.0];
        let log_scale = scale.ln() as f32;
        state.params[2][row] = [log_scale, log_scale, log_scale, 0.0];
        state.params[3][row] = [row as f32, 0.0, 0.0, 0.0];
    }
    state
}

/// Refinement after `iteration` in a scene of extent 1.
pub(super) fn context(config: &TrainConfig, iteration: u32) -> RefineContext<'_> {
    RefineContext {
        iteration,
        config,
        extent: 1.0,
        limit: config.splat_limit(),
        sky: None,
    }
}

/// Stores each row's index in its colour and moments.
fn label(state: &mut HostState) {
    for row in 0..state.len() {
        let name = row as f32;
        state.params[3][row] = [name, 0.0, 0.0, 0.0];
        for (plane, m) in state.m.iter_mut().enumerate() {
            m[row] = [name + 1.0, plane as f32, 1.0, 2.0];
        }
        for (plane, v) in state.v.iter_mut().enumerate() {
            v[row] = [-name - 1.0, plane as f32, 3.0, 4.0];
        }
    }
}

/// Every row has either all the moments of its source row, unchanged, or none.
fn check(before: &HostState, after: &HostState) {
    let mut seen = vec![false; before.len()];
    for row in 0..after.len() {
        let source = after.params[3][row][0] as usize;
        let untouched = after.m[0][row] != [0.0; 4];
        for plane in 0..after.params.len() {
            let wanted = match untouched {
                true => [before.m[plane][source], before.v[plane][source]],
                false => [[0.0; 4]; 2],
            };
            assert_eq!([after.m[plane][row], after.v[plane][row]], wanted);
        }
        if untouched {
            assert!(!std::mem::replace(&mut seen[source], true), "a row was doubled");
            // The original of a clone shares its opacity.
            let (place, from) = (after.params[0][row], before.params[0][source]);
            assert!(place[..3] == from[..3] && place[3] <= from[3]);
            for plane in 1..after.params.len() {
                assert_eq!(after.params[plane][row], before.params[plane][source]);
            }
        }
    }
}

/// Random changes of opacities and sizes, as by a few steps of training.
fn disturb(state: &mut HostState, step: u32) -> Vec<SplatStats> {
    let mut stats = Vec::with_capacity(state.len());
    for row in 0..state.len() {
        let [a, b, c, d] = rng::uniform(4, step, row as u32, Stream::Noise);
        state.params[0][row][3] = a * 14.0 - 6.0;
        state.params[2][row] = [b * 6.0 - 8.0, c * 6.0 - 8.0, -6.0, 0.0];
        stats.push([d * d * 4e-4, 1.0, c * 30.0, 0.0]);
    }
    stats
}

fn thousand_refinements(kind: StrategyKind) -> HostState {
    let mut config = TrainConfig::for_iterations(30_000).with_strategy(kind);
    config.max_splats = Some(300);
    config.adc.prune_radius_px = 28.0;
    let mut state = state_of(&[(0.5, 0.01); 40]);
    let mut touched = RefineReport::default();
    for step in 1..=1_000 {
        if state.len() < 5 {
            state.append(&state_of(&[(0.5, 0.01); 40]));
        }
        let stats = disturb(&mut state, step);
        label(&mut state);
        let before = state.clone();
        let report = refine(&mut state, &stats, context(&config, step * 10));
        check(&before, &state);
        let expected = before.len() + report.cloned + report.split - report.pruned;
        assert_eq!((report.count, state.len()), (expected, expected));
        assert!(state.len() <= 300);
        touched.cloned += report.cloned;
        touched.split += report.split;
        touched.pruned += report.pruned;
        touched.relocated += report.relocated;
    }
    match kind {
        StrategyKind::Adc => assert!(touched.cloned > 100 && touched.split > 100),
        StrategyKind::Mcmc => assert!(touched.relocated > 100 && touched.cloned > 100),
    }
    state
}

#[test]
fn moments_stay_with_their_splats_through_a_thousand_refinements() {
    for kind in [StrategyKind::Adc, StrategyKind::Mcmc] {
        let state = thousand_refinements(kind);
        let bits = |state: &HostState| -> Vec<u32> {
            let planes = state.params.iter().chain(&state.m).chain(&state.v);
            planes.flatten().flatten().map(|x| x.to_bits()).collect()
        };
        assert_eq!(bits(&state), bits(&thousand_refinements(kind)), "{kind:?}");
    }
}
