//! What the harmonics that went would have been worth: the scene as it ended is fitted on twice, for as many steps as it
//! was after they went, from the same state with the same constants: with the degrees that are left and with all of them.
//! Nothing else tells the two apart.

use super::Task;
use crate::Result;
use crate::bench::judge::Judge;
use crate::gpu::Gpu;
use crate::scene::Splats;
use crate::train::{HostState, TrainConfig, Trainer};

/// Decibels of test views that all harmonics have over those of these degrees, fitted on from an iteration to the end of
/// the run; `None` where `progress` ends it or a scene has no decibels.
pub(super) fn worth(
    task: &Task<'_>,
    gpu: &Gpu,
    judge: &mut Judge,
    (splats, degrees, from): (&Splats, &[u8], u32),
    progress: &mut dyn FnMut(u32) -> bool,
) -> Result<Option<f64>> {
    let config = task.config();
    let whole = HostState::from_splats(splats, config.sh_degree);
    let mut less = whole.clone();
    less.lower_degrees(degrees);
    let mut scores = Vec::new();
    for state in [less, whole] {
        let Some(fitted) = fitted(task, gpu, (&config, &state, from), progress)? else {
            return Ok(None);
        };
        scores.extend(judge.score(&fitted)?.psnr_db);
    }
    Ok(match scores[..] {
        [less, whole] => Some(whole - less),
        _ => None,
    })
}

fn fitted(
    task: &Task<'_>,
    gpu: &Gpu,
    (config, state, from): (&TrainConfig, &HostState, u32),
    progress: &mut dyn FnMut(u32) -> bool,
) -> Result<Option<Splats>> {
    let mut trainer = Trainer::from_state(gpu, task.dataset, config.clone(), state, from)?;
    trainer.set_limit(0);
    while !trainer.is_done() {
        if !progress(trainer.iteration()) {
            return Ok(None);
        }
        trainer.step()?;
    }
    trainer.splats().map(Some)
}
