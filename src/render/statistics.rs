//! Statistics of a host's pictures.

use crate::scene::NotFinite;

/// Statistics of recorded pictures: pairs, bands, completeness.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stats {
    /// (Splat, tile) pairs of the complete frame.
    pub isects: usize,
    /// Capacity of the buffers in pairs. A frame with more is drawn in bands, one after the other, which takes longer:
    /// [`Renderer::reserve`](super::Renderer::reserve) raises the capacity.
    pub isect_capacity: usize,
    /// Recorded bands. If they did not suffice, pictures recorded after this one is finished have more.
    pub bands: u32,
    /// True for a complete picture. Else the splats behind some depth are missing, or all.
    pub complete: bool,
    /// Splats not drawn because of a non-finite parameter.
    pub not_finite: Option<NotFinite>,
}

impl Stats {
    /// True if all pairs fitted the buffers at once.
    pub fn fits(&self) -> bool {
        self.isects <= self.isect_capacity
    }

    /// The worse of both in each field.
    pub(super) fn worse(self, other: Stats) -> Stats {
        Stats {
            isects: self.isects.max(other.isects),
            isect_capacity: self.isect_capacity.min(other.isect_capacity),
            bands: self.bands.max(other.bands),
            complete: self.complete && other.complete,
            not_finite: self.not_finite.or(other.not_finite),
        }
    }
}
