//! What is recorded behind the drawing of a view, for what it is drawn for.

use super::{Purpose, STEPS, Scales};
use crate::gpu::Recorder;
use crate::kernels::{afford, influence, tally, weigh};
use crate::layout::*;
use crate::render::{Forward, tile_stride};

impl Scales {
    /// Records what a purpose asks for behind the drawing.
    pub(super) fn record(&self, rec: &mut Recorder<'_>, view: &View, purpose: Purpose) {
        if let Purpose::Losses(budget) = purpose {
            self.record_limits(rec, view, budget);
            self.record_weights(rec, view);
        }
    }

    /// Records the search for what pixels can afford.
    fn record_limits(&self, rec: &mut Recorder<'_>, view: &View, budget: f32) {
        let tiles = (view.tiles[0] * view.tiles[1]) as usize;
        let room = &self.room;
        let s = &room.scratch;
        let source_from_isect = &s.by_tile.values[Forward::sorted_index(tiles)];
        let tile_stride = tile_stride(tiles);
        rec.fill(&room.limit, 0);
        for step in STEPS {
            let io = afford::Bindings {
                view: &s.view,
                range_from_tile: &s.range_from_tile,
                source_from_isect,
                splat_from_source: &s.splat_from_source,
                shape_from_splat: &s.shape_from_splat,
                tone_from_splat: &s.tone_from_splat,
                rank_from_splat: &self.ranks,
                limit_from_pixel: &room.limit,
                spent_from_pixel: &room.spent,
            };
            let params = afford::Params {
                tile_stride,
                step,
                budget,
            };
            self.afford.record(rec, io, params, tiles);
        }
    }

    /// Records the weighing, and the sums by splat.
    fn record_weights(&self, rec: &mut Recorder<'_>, view: &View) {
        let tiles = (view.tiles[0] * view.tiles[1]) as usize;
        let room = &self.room;
        let s = &room.scratch;
        let source_from_isect = &s.by_tile.values[Forward::sorted_index(tiles)];
        let tile_stride = tile_stride(tiles);
        // A pair that was counted and then not listed has a record that nobody writes: one that lets nothing go.
        rec.fill(&room.records, 0);
        let io = weigh::Bindings {
            view: &s.view,
            range_from_tile: &s.range_from_tile,
            source_from_isect,
            splat_from_source: &s.splat_from_source,
            shape_from_splat: &s.shape_from_splat,
            tone_from_splat: &s.tone_from_splat,
            spent_from_pixel: &room.spent,
            limit_from_pixel: &room.limit,
            loss_from_source: &room.records,
        };
        let params = weigh::Params { tile_stride };
        self.weigh.record(rec, io, params, tiles);
        self.record_totals(rec, &self.tally);
    }

    /// Records, behind a drawing that is done, what splats do to it, whose pixels' errors are where else is what they
    /// have spent.
    pub(super) fn record_influences(&self, rec: &mut Recorder<'_>, view: &View) {
        let tiles = (view.tiles[0] * view.tiles[1]) as usize;
        let room = &self.room;
        let s = &room.scratch;
        rec.fill(&room.records, 0);
        let io = influence::Bindings {
            view: &s.view,
            range_from_tile: &s.range_from_tile,
            source_from_isect: &s.by_tile.values[Forward::sorted_index(tiles)],
            splat_from_source: &s.splat_from_source,
            shape_from_splat: &s.shape_from_splat,
            tone_from_splat: &s.tone_from_splat,
            rest_from_splat: &s.rest_from_splat,
            image: &s.image,
            error_from_pixel: &room.spent,
            influence_from_source: &room.records,
        };
        let params = influence::Params {
            tile_stride: tile_stride(tiles),
        };
        self.influence.record(rec, io, params, tiles);
        self.record_totals(rec, &self.total);
    }

    fn record_totals(&self, rec: &mut Recorder<'_>, tally: &tally::Tally) {
        let (room, s) = (&self.room, &self.room.scratch);
        let io = tally::Bindings {
            counts: &s.counts,
            tile_count_from_splat: &s.tile_count_from_splat,
            source_from_splat: &s.source_from_splat,
            loss_from_source: &room.records,
            loss_from_splat: &self.totals,
        };
        let params = tally::Params {
            splat_count: self.model.splat_count as u32,
        };
        tally.record(rec, io, params);
    }
}
