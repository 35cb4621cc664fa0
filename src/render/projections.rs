//! Projection, compiled for every degree of harmonics and for both orders of slots.

use super::model::Model;
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::project::{Choice, Project};

/// The kernels of every degree.
#[derive(Debug)]
pub(super) struct Projections {
    ordered: Vec<Project>,
    /// For slots in an order of their own: none until a model has such.
    indexed: Vec<Project>,
    choices: Vec<Choice>,
}

impl Projections {
    /// By a choice for every degree from 0 on.
    pub(super) fn new(gpu: &Gpu, choices: Vec<Choice>) -> Result<Projections> {
        Ok(Projections {
            ordered: compiled(gpu, &choices)?,
            indexed: Vec::new(),
            choices,
        })
    }

    /// Compiles what a model needs beyond what others do.
    pub(super) fn prepare(&mut self, gpu: &Gpu, model: &Model) -> Result<()> {
        if model.is_indexed() && self.indexed.is_empty() {
            let mut choices = self.choices.clone();
            choices.iter_mut().for_each(|c| c.spec.indexed = 1);
            self.indexed = compiled(gpu, &choices)?;
        }
        Ok(())
    }

    /// For splats of a model with harmonics up to a degree.
    pub(super) fn of(&self, model: &Model, degree: u32) -> &Project {
        let kernels = match model.is_indexed() {
            true => &self.indexed,
            false => &self.ordered,
        };
        &kernels[degree as usize]
    }
}

fn compiled(gpu: &Gpu, choices: &[Choice]) -> Result<Vec<Project>> {
    let each = choices.iter().map(|&choice| Project::new(gpu, choice));
    each.collect()
}
