//! Device memory by buffer: groups of buffers declare names, purposes and sizes once, for allocation and prediction.

use crate::Result;
use crate::gpu::{Buffer, Gpu};
use crate::layout::*;
use bytemuck::Pod;

/// Purpose of a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Purpose {
    /// Parameters of the scene.
    Parameters,
    /// State of the optimiser.
    Moments,
    /// Photographs.
    Photos,
    /// Lists of (splat, tile) pairs, and data of each pair.
    Intersections,
    /// Gradients and statistics of splats.
    Gradients,
    /// A frame's data of each splat.
    Splats,
    /// A frame's data of each pixel or tile.
    Pixels,
    /// Data on their way to and from the device, and counts.
    Transfer,
}

impl Purpose {
    /// True for the indispensable memory of a run; the rest is working memory.
    pub fn is_essential(self) -> bool {
        use Purpose::*;
        matches!(self, Parameters | Moments | Photos | Intersections)
    }

    /// Name in one word.
    pub fn name(self) -> &'static str {
        match self {
            Purpose::Parameters => "parameters",
            Purpose::Moments => "moments",
            Purpose::Photos => "photos",
            Purpose::Intersections => "intersections",
            Purpose::Gradients => "gradients",
            Purpose::Splats => "splats",
            Purpose::Pixels => "pixels",
            Purpose::Transfer => "transfer",
        }
    }
}

/// Memory of the buffers of one name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Need {
    /// Name of the buffers.
    pub name: &'static str,
    /// Purpose of the buffers.
    pub purpose: Purpose,
    /// Total bytes.
    pub bytes: u64,
}

impl Need {
    /// `count` elements of `size` bytes.
    pub fn new(name: &'static str, purpose: Purpose, size: usize, count: usize) -> Need {
        Need {
            name,
            purpose,
            bytes: size as u64 * count as u64,
        }
    }
}

/// Sum of all bytes.
pub fn total(needs: &[Need]) -> u64 {
    needs.iter().map(|need| need.bytes).sum()
}

/// Buffers under one name.
pub(crate) trait Allocate: Sized {
    /// Elements, of each buffer where there are several.
    type Size;
    fn allocate(gpu: &Gpu, name: &str, size: Self::Size) -> Result<Self>;
    fn needs(name: &'static str, purpose: Purpose, size: Self::Size) -> Vec<Need>;
}

impl<T: Pod> Allocate for Buffer<T> {
    type Size = usize;

    fn allocate(gpu: &Gpu, name: &str, size: usize) -> Result<Self> {
        gpu.buffer(name, size)
    }

    fn needs(name: &'static str, purpose: Purpose, size: usize) -> Vec<Need> {
        vec![Need::new(name, purpose, size_of::<T>(), size)]
    }
}

impl<T: Pod> Allocate for Vec<Buffer<T>> {
    type Size = Vec<usize>;

    fn allocate(gpu: &Gpu, name: &str, sizes: Vec<usize>) -> Result<Self> {
        let buffers = sizes.into_iter().map(|size| gpu.buffer(name, size));
        buffers.collect()
    }

    fn needs(name: &'static str, purpose: Purpose, sizes: Vec<usize>) -> Vec<Need> {
        Buffer::<T>::needs(name, purpose, sizes.iter().sum())
    }
}

/// Declares a struct of buffers that are sized by its arguments: `field: type, purpose, size;`. `new` allocates them
/// under the names of their fields, `needs` says what that takes. Further fields stand in `beside`, with their values.
macro_rules! buffers {
    ($(#[$about:meta])* $vis:vis struct $group:ident($($arg:ident: $type:ty),*)
    $(beside { $($(#[$doc:meta])* $own_vis:vis $own:ident: $own_type:ty = $value:expr,)* })?
    { $($(#[$note:meta])* $field:ident: $buffers:ty, $purpose:expr, $size:expr;)* }) => {
        $(#[$about])*
        #[derive(Clone, Debug)]
        $vis struct $group {
            $($($(#[$doc])* $own_vis $own: $own_type,)*)?
            $($(#[$note])* pub(crate) $field: $buffers,)*
        }

        impl $group {
            /// Allocates the buffers.
            $vis fn new(gpu: &$crate::gpu::Gpu, $($arg: $type),*) -> $crate::Result<$group> {
                use $crate::render::Allocate;
                Ok($group {
                    $($field: Allocate::allocate(gpu, stringify!($field), $size)?,)*
                    $($($own: $value,)*)?
                })
            }

            /// Bytes of the buffers.
            $vis fn needs($($arg: $type),*) -> Vec<$crate::render::Need> {
                use $crate::render::{Allocate, Purpose::*};
                [$(<$buffers>::needs(stringify!($field), $purpose, $size)),*].concat()
            }
        }
    };
}
pub(crate) use buffers;

/// Estimated (splat, tile) pairs of a frame, for capacities before the first frame.
///
/// A splat of w pixels square meets (w/8 + 1)(w/16 + 1) tiles. The coverage of a pixel hardly depends on the number of
/// splats, so w² is `OVERLAP` · pixels / splats, and the pairs are
/// splats + (1/8 + 1/16) √(`OVERLAP` · pixels · splats) + `OVERLAP` · pixels / 128.
pub fn isects_expected(splats: usize, width: u32, height: u32) -> usize {
    let (splats, pixels) = (splats as f64, f64::from(width) * f64::from(height));
    let [tile_width, tile_height] = [TILE_WIDTH, TILE_HEIGHT].map(f64::from);
    let edges = 1.0 / tile_width + 1.0 / tile_height;
    let tiles = OVERLAP * pixels / (tile_width * tile_height);
    (splats + edges * (OVERLAP * pixels * splats).sqrt() + tiles) as usize
}

/// Bounding squares over a pixel, all splats of the scene counted. Fitted to trained scenes: the fox at 270×480
/// with 62,840 splats had 215,856 pairs (211,350 by the formula), the built-in scene at 160×120 with 12,000
/// splats 36,204 (36,000), with 15,000 splats 46,231 (41,123).
const OVERLAP: f64 = 40.0;
