//! Refinement on the device: the same bits as of the whole state on the host.

use crate::common::device;
use ashfall::lab::synth::{Kind, SynthOptions, scene};
use ashfall::scene::Dataset;
use ashfall::train::state::HostState;
use ashfall::train::strategy::{RefineContext, refine, reset_opacity};
use ashfall::train::{StrategyKind, TrainConfig, Trainer};

/// Iteration with the refinement.
const LAST: u32 = 6;

/// More splats than a block has.
fn dataset() -> Dataset {
    scene(Kind::Demo).dataset(&SynthOptions {
        views: 6,
        width: 96,
        height: 64,
        samples: 1,
        points: 20_000,
        ..SynthOptions::default()
    })
}

/// A run up to its only refinement; splats of every third row have SH degree 1 if `is_mixed`.
fn run<'a>(dataset: &'a Dataset, config: &TrainConfig, is_mixed: bool) -> Trainer<'a> {
    let mut trainer = Trainer::new(&device::gpu(), dataset, config.clone()).unwrap();
    if is_mixed {
        let degrees: Vec<u8> = (0..trainer.splat_count())
            .map(|row| if row % 3 == 0 { 1 } else { 3 })
            .collect();
        trainer.lower_degrees(&degrees).unwrap();
    }
    for _ in 0..LAST {
        trainer.step().unwrap();
    }
    trainer.finish().unwrap();
    trainer
}

fn bits(state: &HostState) -> Vec<u32> {
    let planes = state.params.iter().chain(&state.m).chain(&state.v);
    planes.flatten().flatten().map(|x| x.to_bits()).collect()
}

#[test]
fn refined_states_equal_those_of_the_host() {
    let dataset = dataset();
    for (kind, is_mixed) in [
        (StrategyKind::Adc, false),
        (StrategyKind::Adc, true),
        (StrategyKind::Mcmc, false),
    ] {
        let mut config = TrainConfig::for_iterations(100).with_strategy(kind);
        config.adam.color_every = 1;
        config.refine.from = 1;
        config.refine.every = LAST;
        config.adc.opacity_reset_every = LAST;
        config.adc.prune_opacity = 0.9 * config.init.opacity;
        let mut without = config.clone();
        without.refine.every = 2 * LAST;
        without.adc.opacity_reset_every = 2 * LAST;
        let mut before = run(&dataset, &without, is_mixed);
        let statistics = before.statistics().unwrap();
        let mut expected = before.download().unwrap();
        let context = RefineContext {
            iteration: LAST,
            config: before.config(),
            extent: before.extent(),
            limit: before.config().splat_limit(),
            sky: None,
        };
        let report = refine(&mut expected, &statistics, context);
        assert!(report.cloned > 100, "{kind:?}: {report:?}");
        if kind == StrategyKind::Adc {
            assert!(report.pruned > 100, "{report:?}");
            reset_opacity(&mut expected, config.adc.opacity_reset_value, None);
        }
        let mut refined = run(&dataset, &config, is_mixed);
        let found = refined.download().unwrap();
        assert_eq!(found.degrees, expected.degrees, "{kind:?}");
        assert!(bits(&found) == bits(&expected), "{kind:?}, mixed: {is_mixed}");
        assert!(refined.statistics().unwrap().iter().all(|four| *four == [0.0; 4]));
    }
}
