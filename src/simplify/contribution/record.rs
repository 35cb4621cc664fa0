//! Commands recorded after the drawing of a view.

use super::{Resources, STEPS};
use crate::gpu::{Groups, Recorder};
use crate::kernels::{contribution, prune_limit, removal_error, sum_by_splat, walker_bindings};
use crate::layout::*;
use crate::render::{Forward, tile_stride};

impl Resources {
    /// Records the search for the highest prunable rank of each pixel, then the contributions and their reduction by
    /// splat.
    pub(super) fn record_losses(&self, rec: &mut Recorder<'_>, view: &View, budget: f32) {
        let tiles = (view.tiles[0] * view.tiles[1]) as usize;
        let groups = Groups::Count(tiles as u32);
        let buffers = &self.buffers;
        let s = &buffers.scratch;
        let emitted_from_isect = &s.emitted_from_isect[Forward::sorted_index(tiles)];
        let tile_stride = tile_stride(tiles);
        rec.fill(&buffers.own.limit_from_pixel, 0);
        for step in STEPS {
            let io = walker_bindings! {
                prune_limit, s, emitted_from_isect;
                rank_from_splat: &self.sums.rank_from_splat,
                limit_from_pixel: &buffers.own.limit_from_pixel,
                spent_from_pixel: &buffers.own.spent_from_pixel,
                blue_depth_from_splat: &s.blue_depth_from_splat,
                plane_from_splat: &s.plane_from_splat,
            };
            let params = prune_limit::Params {
                tile_stride,
                step,
                budget,
            };
            self.kernels.prune_limit.record(rec, io, params, groups);
        }
        // A pair that was counted but not listed keeps this record, which lets no splat go.
        rec.fill(&buffers.own.record_from_emitted, 0);
        let io = walker_bindings! {
            contribution, s, emitted_from_isect;
            spent_from_pixel: &buffers.own.spent_from_pixel,
            limit_from_pixel: &buffers.own.limit_from_pixel,
            record_from_emitted: &buffers.own.record_from_emitted,
            blue_depth_from_splat: &s.blue_depth_from_splat,
            plane_from_splat: &s.plane_from_splat,
        };
        let params = contribution::Params { tile_stride };
        self.kernels.contribution.record(rec, io, params, groups);
        self.record_totals(rec, &self.kernels.sum_by_splat);
    }

    /// Records the removal errors after a completed drawing.
    pub(super) fn record_removal_errors(&self, rec: &mut Recorder<'_>, view: &View) {
        let tiles = (view.tiles[0] * view.tiles[1]) as usize;
        let groups = Groups::Count(tiles as u32);
        let buffers = &self.buffers;
        let s = &buffers.scratch;
        rec.fill(&buffers.own.record_from_emitted, 0);
        let io = walker_bindings! {
            removal_error, s, &s.emitted_from_isect[Forward::sorted_index(tiles)];
            blue_depth_from_splat: &s.blue_depth_from_splat,
            image: &s.image,
            record_from_emitted: &buffers.own.record_from_emitted,
            plane_from_splat: &s.plane_from_splat,
        };
        let params = removal_error::Params {
            tile_stride: tile_stride(tiles),
        };
        self.kernels.removal_error.record(rec, io, params, groups);
        self.record_totals(rec, &self.kernels.total);
    }

    fn record_totals(&self, rec: &mut Recorder<'_>, sum_by_splat: &sum_by_splat::SumBySplat) {
        let (buffers, s) = (&self.buffers, &self.buffers.scratch);
        let io = sum_by_splat::Bindings {
            counts: &s.counts,
            tile_count_from_splat: &s.tile_count_from_splat,
            emitted_from_splat: &s.emitted_from_splat,
            record_from_emitted: &buffers.own.record_from_emitted,
            sum_from_splat: &self.sums.sum_from_splat,
        };
        let params = sum_by_splat::Params {
            splat_count: self.model.splat_count as u32,
        };
        let groups = sum_by_splat.groups(self.model.splat_count);
        sum_by_splat.record(rec, io, params, groups);
    }
}
