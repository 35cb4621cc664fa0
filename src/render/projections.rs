//! Projection kernels, and others that depend on a model's order of slots and on the SH degree of its splats.

use super::model::Model;
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::project::{Choice, Project};
use std::collections::BTreeMap;

/// Kernels of one shader for models of every kind, by SH degree; each compiled for the first model that needs it.
#[derive(Debug)]
pub(crate) struct ModelKernels<K> {
    /// By [`kind`] and degree.
    kernels: BTreeMap<((bool, bool), u32), K>,
}

/// Whether a model has an order of slots of its own, and whether it is one of instances.
fn kind(model: &Model, is_instance: bool) -> (bool, bool) {
    (model.is_indexed(), is_instance)
}

/// Degrees of the kernels for frames of a model with SH up to `highest`.
fn degrees(model: &Model, highest: u32) -> impl Iterator<Item = u32> {
    let blocks = model.blocks.of(model.counts);
    blocks.map(move |block| highest.min(block.degree))
}

impl<K: Send> ModelKernels<K> {
    /// None yet.
    pub(crate) fn new() -> Self {
        let kernels = BTreeMap::new();
        ModelKernels { kernels }
    }

    /// Compiles, by their degrees, those kernels for frames of a model with SH up to `highest` that are missing.
    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        (model, is_instance): (&Model, bool),
        highest: u32,
        compile: impl Fn(u32) -> Result<K> + Sync,
    ) -> Result<()> {
        let kind = kind(model, is_instance);
        let mut missing: Vec<u32> = degrees(model, highest).collect();
        missing.retain(|&degree| !self.kernels.contains_key(&(kind, degree)));
        missing.dedup();
        let made = gpu.compile_all(&missing, compile)?;
        let keys = missing.into_iter().map(|degree| (kind, degree));
        self.kernels.extend(keys.zip(made));
        Ok(())
    }

    /// True if the kernels for frames of a model with SH up to `highest` are compiled.
    fn has(&self, model: &Model, is_instance: bool, highest: u32) -> bool {
        let kind = kind(model, is_instance);
        degrees(model, highest).all(|degree| self.kernels.contains_key(&(kind, degree)))
    }

    /// Kernel for a prepared model's splats with SH up to `degree`.
    pub(crate) fn of(&self, model: &Model, is_instance: bool, degree: u32) -> &K {
        &self.kernels[&(kind(model, is_instance), degree)]
    }
}

/// Projection kernels of frames with some options.
#[derive(Debug)]
pub(super) struct Projections {
    kernels: ModelKernels<Project>,
    /// By SH degree from 0.
    choices: Vec<Choice>,
}

impl Projections {
    /// With choices by SH degree from 0. On a host's device, the kernels of models without an order of their own are
    /// compiled, for its frames must not wait for them.
    pub(super) fn new(gpu: &Gpu, choices: Vec<Choice>) -> Result<Projections> {
        let mut kernels = ModelKernels::new();
        if !gpu.is_owned() {
            for (degree, &choice) in (0..).zip(&choices) {
                kernels
                    .kernels
                    .insert(((false, false), degree), Project::new(gpu, choice)?);
            }
        }
        Ok(Projections { kernels, choices })
    }

    /// Compiles the kernels for frames of a model with SH up to `highest`, if it is the first that needs them.
    pub(super) fn prepare(&mut self, gpu: &Gpu, model: &Model, is_instance: bool, highest: u32) -> Result<()> {
        let choices = &self.choices;
        self.kernels.prepare(gpu, (model, is_instance), highest, |degree| {
            let mut choice = choices[degree as usize];
            choice.spec.indexed = model.is_indexed().into();
            choice.spec.instanced = is_instance.into();
            Project::new(gpu, choice)
        })
    }

    /// True if the kernels are compiled.
    pub(super) fn has(&self, model: &Model, is_instance: bool, highest: u32) -> bool {
        self.kernels.has(model, is_instance, highest)
    }

    /// Kernel for a prepared model's splats with SH up to `degree`.
    pub(super) fn of(&self, model: &Model, is_instance: bool, degree: u32) -> &Project {
        self.kernels.of(model, is_instance, degree)
    }
}
