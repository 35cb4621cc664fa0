//! Cache of decoded photographs within a memory budget.

use super::super::parallel::try_map;
use super::load;
use crate::error::Result;
use crate::scene::{Dataset, Photo};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

/// Photographs by view index. The first to be loaded stay, up to the budget; later ones are decoded on each access.
/// Training reads every view once in random order and then again, for which no eviction rule has more hits. Shared
/// between threads, for prefetching.
#[derive(Debug)]
pub struct PhotoCache {
    slots: Vec<OnceLock<Arc<Photo>>>,
    kept_bytes: AtomicU64,
    budget_bytes: u64,
}

impl PhotoCache {
    /// An empty cache for the views of `dataset`; photographs already in memory count as well.
    pub fn new(dataset: &Dataset, budget_bytes: u64) -> PhotoCache {
        PhotoCache {
            slots: dataset.views.iter().map(|_| OnceLock::new()).collect(),
            kept_bytes: AtomicU64::new(0),
            budget_bytes,
        }
    }

    /// The photograph of view `index`, from memory or the file.
    pub fn get(&self, dataset: &Dataset, index: usize) -> Result<Arc<Photo>> {
        let slot = &self.slots[index];
        if let Some(photo) = slot.get() {
            return Ok(Arc::clone(photo));
        }
        let photo = Arc::new(load(&dataset.views[index])?);
        let bytes = 4 * photo.rgba.len() as u64;
        if self.reserve(bytes) && slot.set(Arc::clone(&photo)).is_err() {
            // Another thread was faster; its copy is kept.
            self.kept_bytes.fetch_sub(bytes, Ordering::Relaxed);
        }
        Ok(photo)
    }

    /// Loads the photographs of `indices` in parallel until the budget is spent, and returns the number in memory. The
    /// first error ends it.
    pub fn load_all(&self, dataset: &Dataset, indices: &[usize]) -> Result<usize> {
        // Sizes come from the cameras, so that nothing is decoded and then discarded.
        let mut planned = self.kept_bytes();
        let fitting: Vec<usize> = indices
            .iter()
            .copied()
            .filter(|&index| self.slots[index].get().is_none())
            .take_while(|&index| {
                let camera = &dataset.views[index].camera;
                planned += 4 * u64::from(camera.width) * u64::from(camera.height);
                planned <= self.budget_bytes
            })
            .collect();
        try_map(fitting.par_iter(), |&index| self.get(dataset, index).map(drop))?;
        let kept = |index: &&usize| self.slots[**index].get().is_some();
        Ok(indices.iter().filter(kept).count())
    }

    /// Bytes of the photographs in memory.
    pub fn kept_bytes(&self) -> u64 {
        self.kept_bytes.load(Ordering::Relaxed)
    }

    fn reserve(&self, bytes: u64) -> bool {
        self.kept_bytes
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |kept| {
                kept.checked_add(bytes).filter(|sum| *sum <= self.budget_bytes)
            })
            .is_ok()
    }
}
