//! Steps whose gradients of colours wait for the next update of the harmonics.

use super::config::TrainConfig;
use super::schedule;
use crate::layout::COLOR_STEPS;
use std::collections::VecDeque;

/// Steps remembered: those of an update, and those in flight that may be repeated.
const REMEMBERED: u32 = 4 * COLOR_STEPS;

/// Gradients of colours that wait for an update of the harmonics.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PendingColors {
    /// Camera centre of each step, world units.
    pub positions: Vec<[f32; 3]>,
    /// dL/d colour, `[step][splat]`.
    pub gradients: Vec<[f32; 3]>,
}

/// Colours in a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ColorStep {
    /// Steps whose gradients wait already.
    pub(crate) number: u32,
    /// Update of the harmonics after the step, if there is one.
    pub(crate) update: Option<ColorUpdate>,
}

/// Update of the harmonics by the gradients of several steps, listed from the last back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ColorUpdate {
    /// Number of the steps.
    pub(crate) steps: u32,
    /// Camera centres, world units.
    pub(crate) position: [[f32; 3]; COLOR_STEPS as usize],
    /// Bias corrections of the first moment.
    pub(crate) correction1: [f32; COLOR_STEPS as usize],
    /// Bias corrections of the second moment before the steps, and after.
    pub(crate) correction2: [f32; 2],
    /// First moments by which the harmonics lie ahead before the steps, and after.
    pub(crate) look_ahead: [f32; 2],
}

/// Camera centres of the last steps.
#[derive(Clone, Debug)]
pub(crate) struct ColorQueue {
    /// Iteration after which no gradient waited.
    updated: u32,
    /// Iterations with their camera centres.
    steps: VecDeque<(u32, [f32; 3])>,
}

impl ColorQueue {
    /// Queue after an iteration, with the camera centres of the last steps if their gradients wait.
    pub(crate) fn new(iteration: u32, waiting: &[[f32; 3]]) -> ColorQueue {
        let updated = iteration - waiting.len() as u32;
        ColorQueue {
            updated,
            steps: (updated + 1..).zip(waiting.iter().copied()).collect(),
        }
    }

    /// Adds the step of an iteration; later ones, and itself, are forgotten.
    pub(crate) fn push(&mut self, config: &TrainConfig, iteration: u32, position: [f32; 3]) -> ColorStep {
        self.steps
            .retain(|&(step, _)| step < iteration && step + REMEMBERED > iteration);
        self.steps.push_back((iteration, position));
        let first = schedule::first_color_step(config, self.updated, iteration);
        let update = || {
            let mut update = ColorUpdate {
                steps: iteration + 1 - first,
                position: [position; COLOR_STEPS as usize],
                correction1: [0.0; COLOR_STEPS as usize],
                correction2: [first - 1, iteration].map(|step| schedule::bias_corrections(config, step)[1]),
                look_ahead: [first - 1, iteration].map(|step| schedule::look_ahead(config, step)),
            };
            let waiting = self.steps.iter().rev().take_while(|&&(step, _)| step >= first);
            for (i, &(step, position)) in waiting.enumerate() {
                update.position[i] = position;
                update.correction1[i] = schedule::bias_corrections(config, step)[0];
            }
            update
        };
        ColorStep {
            number: iteration - first,
            update: schedule::is_color_step(config, iteration).then(update),
        }
    }

    /// Camera centres of the steps whose gradients wait after an iteration, the last pushed.
    pub(crate) fn waiting(&self, config: &TrainConfig, iteration: u32) -> Vec<[f32; 3]> {
        if iteration <= self.updated || schedule::is_color_step(config, iteration) {
            return Vec::new();
        }
        let first = schedule::first_color_step(config, self.updated, iteration);
        let steps = self.steps.iter().filter(|&&(step, _)| step >= first);
        steps.map(|&(_, position)| position).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(iteration: u32) -> [f32; 3] {
        [iteration as f32, 0.0, 0.0]
    }

    fn config() -> TrainConfig {
        TrainConfig {
            sh_degree_from: [6, 30, 30],
            refine: crate::train::RefineTimes {
                from: 0,
                until: 15,
                every: 9,
            },
            ..TrainConfig::for_iterations(19)
        }
    }

    #[test]
    fn updates_come_every_fourth_step_and_before_changes() {
        let config = config();
        let mut queue = ColorQueue::new(0, &[]);
        let steps: Vec<ColorStep> = (1..=19).map(|i| queue.push(&config, i, at(i))).collect();
        let numbers: Vec<u32> = steps.iter().map(|step| step.number).collect();
        // Degree 1 begins at 6, splats change after 9, the run ends at 19.
        assert_eq!(numbers, [0, 1, 2, 3, 0, 0, 1, 2, 0, 0, 1, 2, 0, 1, 2, 3, 0, 1, 2]);
        let updates = (1..).zip(&steps).filter_map(|(i, step)| Some((i, step.update?)));
        for (iteration, update) in updates {
            let waiting = update.steps as usize;
            let expected: Vec<[f32; 3]> = (0..update.steps).map(|back| at(iteration - back)).collect();
            assert_eq!(update.position[..waiting], expected);
            assert!(update.correction1[..waiting].iter().all(|&c| c >= 1.0));
            assert!(update.correction1[waiting..].iter().all(|&c| c == 0.0));
        }
    }

    #[test]
    fn a_queue_goes_on_where_another_was_saved_and_steps_can_be_repeated() {
        let config = config();
        for saved in 0..19 {
            let mut whole = ColorQueue::new(0, &[]);
            (1..=saved).for_each(|i| {
                whole.push(&config, i, at(i));
            });
            let mut resumed = ColorQueue::new(saved, &whole.waiting(&config, saved));
            let again = whole.push(&config, saved + 1, at(0));
            for iteration in saved + 1..=19 {
                let step = whole.push(&config, iteration, at(iteration));
                assert_eq!(step.number, resumed.push(&config, iteration, at(iteration)).number);
                assert!(iteration > saved + 1 || step.number == again.number);
            }
            assert_eq!(whole.waiting(&config, 19), Vec::<[f32; 3]>::new());
        }
    }

    #[test]
    fn steps_of_a_replaced_state_wait_no_more() {
        let config = config();
        let mut queue = ColorQueue::new(2, &[]);
        assert_eq!(queue.push(&config, 3, at(3)).number, 0);
        assert_eq!(queue.waiting(&config, 3), [at(3)]);
        let update = queue.push(&config, 4, at(4)).update;
        assert_eq!(update.map(|update| update.steps), Some(2));
    }
}
