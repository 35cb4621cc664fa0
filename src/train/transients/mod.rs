//! Transients: things that one photograph shows and the others do not, people and cars that moved on. Training leaves
//! out the patches of a photograph that show them.
//!
//! Each step adds up, in every patch of its photograph, the signed residual of each channel: detail that the splats
//! lack yet cancels within a patch, a foreign object does not. The scores of patches, root mean squares over the
//! channels of the mean residual, are smoothed over visits. After each epoch a photograph's patches are ignored where
//! they form a region that stands out from the typical photograph, see [`regions()`]: hard parts of a scene, which all
//! photographs share, raise the threshold. Ignored patches go on being scored, and come back when the scene, taught by
//! the other photographs, agrees with them.
//!
//! **Invariant:** patches change at the end of an epoch alone, so that a step does not depend on steps in flight.

mod grid;
mod regions;
mod state;

pub(crate) use grid::PATCH_WORDS;
pub use grid::PatchGrid;
pub use regions::{RegionRule, regions};
pub use state::{IgnoredPatches, TransientState};
