//! Projection kernels for every SH degree and both orders of slots.

use super::model::Model;
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::project::{Choice, Project};

/// Projection kernels by SH degree.
#[derive(Debug)]
pub(super) struct Projections {
    ordered: Vec<Project>,
    /// Kernels for indexed models; empty until the first of these.
    indexed: Vec<Project>,
    choices: Vec<Choice>,
}

impl Projections {
    /// Compiles a kernel for each choice; choices by SH degree from 0.
    pub(super) fn new(gpu: &Gpu, choices: Vec<Choice>) -> Result<Projections> {
        Ok(Projections {
            ordered: compiled(gpu, &choices)?,
            indexed: Vec::new(),
            choices,
        })
    }

    /// Compiles the kernels of indexed models, if the model is the first of these.
    pub(super) fn prepare(&mut self, gpu: &Gpu, model: &Model) -> Result<()> {
        if model.is_indexed() && self.indexed.is_empty() {
            let mut choices = self.choices.clone();
            choices.iter_mut().for_each(|c| c.spec.indexed = 1);
            self.indexed = compiled(gpu, &choices)?;
        }
        Ok(())
    }

    /// True if the model's kernels are compiled.
    pub(super) fn has(&self, model: &Model) -> bool {
        !model.is_indexed() || !self.indexed.is_empty()
    }

    /// Kernel for a model's splats with SH up to `degree`.
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
