//! Determinism: repeated work gives the same bits.

use super::step::{StepResult, steps};
use super::{StressRun, differing, subject, unequal};
use crate::Result;
use crate::render::{Model, RenderOptions, Renderer};

const CHANGED: &str = "pixels that changed";

pub(super) fn run(lab: &mut StressRun<'_>) -> Result<()> {
    let (splats, near) = (lab.subject.splats.clone(), lab.subject.near);
    let cameras = lab.subject.cameras.clone();
    let first = cameras.iter().map(|camera| lab.draw(&splats, camera, near));
    let first = first.collect::<Result<Vec<_>>>()?;
    let mut again = 0;
    for _ in 0..4 {
        for (camera, first) in cameras.iter().zip(&first) {
            again += differing(&lab.draw(&splats, camera, near)?, first);
        }
    }
    let what = format!("{} views in turns, five times", cameras.len());
    lab.none("frames again", what, again, CHANGED);
    let mut other = Renderer::new(lab.gpu, RenderOptions::default())?;
    let model = Model::upload(lab.gpu, &splats)?;
    let view = subject::view_options(&splats, near);
    let drawn = other.render(&model, &cameras[0], &view)?;
    let what = "a second renderer, whose buffers have never held anything";
    lab.none("another renderer", what, differing(&drawn, &first[0]), CHANGED);
    if lab.subject.is_made {
        // All depths differ, so that the splats' order does not matter.
        let backwards: Vec<usize> = (0..splats.len()).rev().collect();
        let turned = lab.draw(&splats.picked(&backwards), &cameras[0], near)?;
        let what = "the splats in the reverse order";
        lab.none("order of splats", what, differing(&turned, &first[0]), CHANGED);
    }
    let few = subject::thinned(&splats, 2_000);
    for (count, name) in [(1, "a training step again"), (20, "20 training steps again")] {
        let run = |lab: &StressRun<'_>| steps(lab.gpu, &few, &cameras[0], near, count);
        let (a, b) = (run(lab)?, run(lab)?);
        let what = format!("parameters and moments of {} splats", a.after.len());
        lab.none(name, what, unequal(&bits(&a), &bits(&b)), "numbers that changed");
    }
    Ok(())
}

/// Bits of the optimiser's state.
fn bits(StepResult { after, .. }: &StepResult) -> Vec<u32> {
    let planes = after.params.iter().chain(&after.m).chain(&after.v);
    planes.flatten().flatten().map(|x| x.to_bits()).collect()
}
