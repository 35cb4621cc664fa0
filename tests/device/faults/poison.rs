//! NaN and overflowing parameters during training.

use crate::common::device;
use crate::faults::run::dataset;
use ashfall::gpu::Gpu;
use ashfall::train::{HostState, StepReport, StrategyKind, TrainConfig, Trainer, initial_splats};

const POISONED: usize = 17;

/// Six steps from a state in which splat [`POISONED`] has this log-scale along x.
fn train(gpu: &Gpu, log_scale: f32) -> (HostState, HostState, Vec<StepReport>) {
    let mut config = TrainConfig::for_iterations(6).with_strategy(StrategyKind::Mcmc);
    config.sh_degree = 1;
    config.refine.from = 100;
    let splats = initial_splats(dataset(), dataset().extent(), &config).unwrap();
    let mut before = HostState::from_splats(&splats, config.sh_degree);
    before.params[2][POISONED][0] = log_scale;
    let mut trainer = Trainer::from_state(gpu, dataset(), config, &before, 0).unwrap();
    let mut reports = Vec::new();
    while !trainer.is_done() {
        reports.extend(trainer.step().unwrap());
    }
    reports.extend(trainer.finish().unwrap());
    (before, trainer.download().unwrap(), reports)
}

/// The bits of all rows except the poisoned splat's.
fn others(state: &HostState) -> Vec<u32> {
    let planes = state.params.iter().chain(&state.m).chain(&state.v);
    let rows = planes.flat_map(|plane| plane.iter().enumerate());
    let sound = rows.filter(|(splat, _)| *splat != POISONED);
    sound.flat_map(|(_, four)| four.map(f32::to_bits)).collect()
}

/// The penalty on scales has a gradient of the scale itself: e^88 is finite and its square is not. Such a splat is not
/// drawn; the step reports it by index; its log-scale and moments stay as they were. A splat with a NaN has no
/// gradient. All other splats are equal in both runs, to the bit.
#[test]
fn f076_a_poisoned_gradient_reaches_no_moment_and_is_named() {
    let gpu = device::gpu();
    let runs = [(88.0, (1, Some(POISONED))), (f32::NAN, (0, None))].map(|(log_scale, expected)| {
        let (before, after, reports) = train(&gpu, log_scale);
        for (report, iteration) in reports.iter().zip(1..) {
            assert_eq!(report.iteration, iteration);
            assert_eq!((report.poisoned, report.poisoned_first), expected, "{log_scale}");
            assert!(report.loss.is_finite(), "{log_scale}");
        }
        assert_eq!(reports.len(), 6);
        let bits = |state: &HostState| state.params[2][POISONED].map(f32::to_bits);
        assert_eq!(bits(&after), bits(&before), "{log_scale}: the last good state");
        for moments in [&after.m, &after.v] {
            assert_eq!(moments[2][POISONED], [0.0; 4], "{log_scale}: a poisoned moment");
            assert!(moments.iter().flatten().flatten().all(|v| v.is_finite()));
        }
        others(&after)
    });
    assert!(runs[0] == runs[1], "another splat noticed");
}
