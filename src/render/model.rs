//! Splats on the device, as planes of vec4.

use super::blocks::{Block, Blocks};
use super::memory::{Need, buffers};
use super::precision::Precision;
use super::slots::{ByDegree, Slots};
use crate::Result;
use crate::gpu::{Buffer, Gpu};
use crate::scene::{NotFinite, Primitive, ScreenFilter, Splats};
use std::ops::Range;

/// Planes of vec4 of splats of a degree in full precision: three of geometry, then SH.
pub const fn plane_count(sh_degree: u32) -> usize {
    Precision::Full.plane_count(sh_degree)
}

/// A scene on the device.
#[derive(Clone, Debug)]
pub struct Model {
    /// `[block][plane][slot]`: mean and opacity logit; quaternion; log-scale and standard deviation of the 3D smoothing
    /// filter (0 except in training); spherical harmonics. Halves take fewer planes ([`Precision`]).
    pub params: Vec<Buffer<[f32; 4]>>,
    /// Layout of the slots in blocks.
    pub blocks: Blocks,
    /// Number of splats.
    pub splat_count: usize,
    /// Number of splats stored with each SH degree.
    pub counts: ByDegree,
    /// `[block][slot]`: splat index of each slot; empty if all splats have one SH degree (slot = splat).
    pub splat_from_slot: Vec<Buffer<u32>>,
    /// Highest SH degree in `params`.
    pub sh_degree: u32,
    /// Storage precision of `params`.
    pub precision: Precision,
    /// Kind of the splats.
    pub primitive: Primitive,
    /// Filter on the screen.
    pub filter: ScreenFilter,
    /// Splats with a non-finite parameter when uploaded: they are not drawn.
    pub not_finite: Option<NotFinite>,
}

buffers! {
    /// Buffers of [`Model::params`] and [`Model::splat_from_slot`].
    struct Planes(blocks: Blocks) {
        params: Vec<Buffer<[f32; 4]>>, Parameters, blocks.sizes();
        splat_from_slot: Vec<Buffer<u32>>, Parameters, blocks.index_sizes();
    }
}

impl Model {
    /// Copies a scene to the device, without the zero SH coefficients above each splat's degree if enough splats share
    /// that degree ([`super::merge_degrees`]). Pictures are the same as with all.
    pub fn upload(gpu: &Gpu, splats: &Splats) -> Result<Model> {
        Model::upload_as(gpu, splats, Precision::Full)
    }

    /// Copies a scene to the device in another precision, for renderers with the same one.
    pub fn upload_as(gpu: &Gpu, splats: &Splats, precision: Precision) -> Result<Model> {
        let slots = Slots::of_scene(splats);
        let model = Model::reserve(gpu, splats, &slots, precision)?;
        for block in model.blocks.of(model.counts) {
            let splats_of_block = slots.of_slots(block.slots());
            let planes = precision.planes_of(splats, &splats_of_block, block.degree);
            gpu.upload(&model.params[block.index], 0, &planes)?;
            if let Some(index) = model.splat_from_slot.get(block.index) {
                gpu.upload(index, 0, &splats_of_block)?;
            }
        }
        Ok(model)
    }

    /// Buffers of a scene, without its splats.
    pub(super) fn reserve(gpu: &Gpu, splats: &Splats, slots: &Slots, precision: Precision) -> Result<Model> {
        let blocks = Blocks::new(gpu.caps(), slots.counts, precision);
        Ok(Model {
            splat_count: splats.len(),
            counts: slots.counts,
            precision,
            not_finite: splats.not_finite(),
            primitive: splats.primitive,
            ..Model::empty(gpu, blocks, slots.sh_degree(), splats.filter)?
        })
    }

    /// Buffers without a splat in them.
    pub(crate) fn empty(gpu: &Gpu, blocks: Blocks, sh_degree: u32, filter: ScreenFilter) -> Result<Model> {
        let planes = Planes::new(gpu, blocks)?;
        Ok(Model {
            params: planes.params,
            splat_from_slot: planes.splat_from_slot,
            blocks,
            splat_count: 0,
            counts: ByDegree::default(),
            sh_degree,
            precision: Precision::Full,
            primitive: Primitive::default(),
            filter,
            not_finite: None,
        })
    }

    /// Bytes of the buffers.
    pub fn needs(blocks: Blocks) -> Vec<Need> {
        Planes::needs(blocks)
    }

    /// Whether slots are in an order of their own.
    pub fn is_indexed(&self) -> bool {
        !self.splat_from_slot.is_empty()
    }

    /// Bindings for access to the splats of a block's slots.
    pub(crate) fn places(&self, block: &Block) -> Places {
        match self.splat_from_slot.get(block.index) {
            Some(index) => Places {
                splats: 0..self.splat_count,
                splat_from_slot: index.clone(),
            },
            None => Places {
                splats: block.slots(),
                // Not read; a placeholder.
                splat_from_slot: self.params[block.index].cast(),
            },
        }
    }
}

/// Location of the splats of a block's slots in arrays with one element per splat.
#[derive(Debug)]
pub(crate) struct Places {
    /// Range of the elements to bind.
    pub(crate) splats: Range<usize>,
    /// Splat index of each slot within that range, if the model is indexed; else a placeholder (slots in order).
    pub(crate) splat_from_slot: Buffer<u32>,
}

/// The planes of a scene, one after the other, each `splats.len()` long.
pub fn planes_from_splats(splats: &Splats) -> Vec<[f32; 4]> {
    let all: Vec<u32> = (0..splats.len() as u32).collect();
    Precision::Full.planes_of(splats, &all, splats.sh_degree)
}
