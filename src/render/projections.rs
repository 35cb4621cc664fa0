//! Projection kernels for every SH degree, both orders of slots, and instances.

use super::model::Model;
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::project::{Choice, Project};

/// Projection kernels by SH degree.
#[derive(Debug)]
pub(super) struct Projections {
    /// Kernels by [`kind`]; empty until the first such model.
    kernels: [Vec<Project>; 4],
    choices: Vec<Choice>,
}

/// Kind of kernels: for indexed models, for instances, for both, or for neither.
fn kind(model: &Model, is_instance: bool) -> usize {
    usize::from(model.is_indexed()) + 2 * usize::from(is_instance)
}

impl Projections {
    /// Compiles a kernel for each choice; choices by SH degree from 0.
    pub(super) fn new(gpu: &Gpu, choices: Vec<Choice>) -> Result<Projections> {
        let mut kernels = [const { Vec::new() }; 4];
        kernels[0] = compiled(gpu, &choices)?;
        Ok(Projections { kernels, choices })
    }

    /// Compiles the kernels of a model, if it is the first of its kind.
    pub(super) fn prepare(&mut self, gpu: &Gpu, model: &Model, is_instance: bool) -> Result<()> {
        let kernels = &mut self.kernels[kind(model, is_instance)];
        if kernels.is_empty() {
            let mut choices = self.choices.clone();
            for choice in &mut choices {
                choice.spec.indexed = model.is_indexed().into();
                choice.spec.instanced = is_instance.into();
            }
            *kernels = compiled(gpu, &choices)?;
        }
        Ok(())
    }

    /// True if the model's kernels are compiled.
    pub(super) fn has(&self, model: &Model, is_instance: bool) -> bool {
        !self.kernels[kind(model, is_instance)].is_empty()
    }

    /// Kernel for a model's splats with SH up to `degree`.
    pub(super) fn of(&self, model: &Model, is_instance: bool, degree: u32) -> &Project {
        &self.kernels[kind(model, is_instance)][degree as usize]
    }
}

fn compiled(gpu: &Gpu, choices: &[Choice]) -> Result<Vec<Project>> {
    gpu.compile_all(choices, |choice| Project::new(gpu, choice))
}
