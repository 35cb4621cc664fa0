//! Depth maps of a data set's views.

use super::align::{DepthCorrection, align};
use super::depth_map::DepthMap;
use crate::Result;

/// Bytes of the maps that are kept by default.
const MEMORY: u64 = 128 << 20;

/// Depth maps of views: drawn on request, kept as far as memory allows, and drawn again beyond.
pub struct DepthMaps<'a> {
    draw: Box<dyn FnMut(usize) -> Result<DepthMap> + 'a>,
    kept: Vec<Option<DepthMap>>,
    room: u64,
    /// By view; empty without an alignment.
    corrections: Vec<DepthCorrection>,
    /// Median of all depths; infinite before it is known.
    depth_median: f32,
}

impl<'a> DepthMaps<'a> {
    /// Maps of `count` views, of which `draw` gives one; it may be called several times for each.
    pub fn new(count: usize, draw: impl FnMut(usize) -> Result<DepthMap> + 'a) -> DepthMaps<'a> {
        DepthMaps {
            draw: Box::new(draw),
            kept: vec![None; count],
            room: MEMORY,
            corrections: Vec::new(),
            depth_median: f32::INFINITY,
        }
    }

    /// The same, with at most `bytes` of maps that are kept.
    #[must_use]
    pub fn within(self, bytes: u64) -> DepthMaps<'a> {
        DepthMaps { room: bytes, ..self }
    }

    /// Moves the depths of all views so that their pictures agree: by smooth changes of depth, the squared differences
    /// between the colours of a view's pixels and those of the same points in other views become least. To be called
    /// first. Pictures that memory does not hold together are compared at a whole fraction of their size. `progress` is
    /// told twice a view, and may end the alignment with an error.
    ///
    /// # Errors
    /// Those of drawing and of `progress`.
    pub fn align(&mut self, progress: impl Fn() -> Result<()> + Sync) -> Result<()> {
        let each = self.room / self.count().max(1) as u64;
        let mut whole = true;
        let mut maps = Vec::new();
        for view in 0..self.count() {
            progress()?;
            let map = (self.draw)(view)?;
            let reduced = map.reduced_to(each);
            whole &= reduced.is_none();
            maps.push(reduced.unwrap_or(map));
        }
        self.corrections = align(&maps, progress)?;
        if whole {
            for (map, correction) in maps.iter_mut().zip(&self.corrections) {
                correction.apply(map);
                map.limit(self.depth_median);
                self.room -= DepthMap::bytes(map.depth.len());
            }
            self.kept = maps.into_iter().map(Some).collect();
        }
        Ok(())
    }

    /// Views.
    pub(super) fn count(&self) -> usize {
        self.kept.len()
    }

    /// Removes depths far beyond the median from all maps.
    pub(super) fn limit(&mut self, depth_median: f32) {
        self.depth_median = depth_median;
        self.kept.iter_mut().flatten().for_each(|map| map.limit(depth_median));
    }

    /// Calls `with` with the map of a view.
    pub(super) fn with<T>(&mut self, view: usize, with: impl FnOnce(&DepthMap) -> Result<T>) -> Result<T> {
        if let Some(map) = &self.kept[view] {
            return with(map);
        }
        let mut map = (self.draw)(view)?;
        if let Some(correction) = self.corrections.get(view) {
            correction.apply(&mut map);
        }
        map.limit(self.depth_median);
        let result = with(&map)?;
        let bytes = DepthMap::bytes(map.depth.len());
        if bytes <= self.room {
            self.room -= bytes;
            self.kept[view] = Some(map);
        }
        Ok(result)
    }
}
