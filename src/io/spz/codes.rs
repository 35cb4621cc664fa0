//! A scene in the codes of SPZ.

use super::super::loaded::{Collector, StoredAs, StoredSplat, logit_of_byte};
use super::header::FRACTIONAL_BITS_MAX;
use super::steps;
use crate::scene::{Axes, ScreenFilter, Splats, sh_coefficient_count};
use rayon::prelude::*;
use std::path::Path;

/// Splats that are turned at a time.
const PART: usize = 1 << 15;

/// Precision and axes of a scene in codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpzOptions {
    /// Largest number of bits after the point of positions in world units, 0 to 24. Fewer are taken if a position needs
    /// the range: 12 reach ±2048. The `spz` library always takes 12.
    pub fractional_bits: u32,
    /// Bits of the harmonics of degrees 1, 2 and 3, 1 to 8 each. The `spz` library takes 5, 4, 4 by default.
    pub sh_bits: [u32; 3],
    /// Axes of the stored splats. RUB by the text of the format; version 3 cannot say others.
    pub axes: Axes,
}

impl Default for SpzOptions {
    fn default() -> SpzOptions {
        SpzOptions {
            fractional_bits: 12,
            sh_bits: [5, 4, 4],
            axes: Axes::RUB,
        }
    }
}

/// A scene in the codes of SPZ versions 3 and 4, splats in the order of the source. All vectors but `sh` have an entry
/// for each splat.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SpzCodes {
    /// Positions in world units · 2^`fractional_bits`, in `axes`; 24 bits in two's complement, of which files keep
    /// the lower.
    pub position: Vec<[i32; 3]>,
    /// Opacities · 255.
    pub alpha: Vec<u8>,
    /// Harmonics of degree 0, red, green, blue: 255 · (0.15 · coefficient + 0.5).
    pub color: Vec<[u8; 3]>,
    /// Natural logarithms of scales: 16 · (logarithm + 10), from e⁻¹⁰ to e^5.94 world units.
    pub scale: Vec<[u8; 3]>,
    /// Rotations: index of the largest component of x, y, z, w in the two upper bits; the others in this order, 10 bits
    /// each, the first in the highest: a sign bit and the magnitude in √½ / 511.
    pub rotation: Vec<u32>,
    /// Harmonics `[splat][coefficient from 1][rgb]`, in `axes`: 128 + 128 · coefficient. Any code is valid; files are
    /// smaller if the codes have low bits of zero.
    pub sh: Vec<u8>,
    /// Highest SH degree, 0 to 3.
    pub sh_degree: u32,
    /// Bits after the point of positions, 0 to 24.
    pub fractional_bits: u32,
    /// Whether the splats are for [`ScreenFilter::Mip`].
    pub antialiased: bool,
    /// Axes of positions, rotations and harmonics.
    pub axes: Axes,
}

impl SpzCodes {
    /// Nearest codes of splats in RDF axes. Values beyond the range of codes have the code at its end, NaN that of
    /// zero.
    ///
    /// # Panics
    /// If an option is out of its range, or arrays of `splats` differ in length.
    pub fn nearest(splats: &Splats, options: &SpzOptions) -> SpzCodes {
        assert!(options.fractional_bits <= FRACTIONAL_BITS_MAX, "fractional bits");
        assert!(
            options.sh_bits.iter().all(|bits| (1..=8).contains(bits)),
            "bits of harmonics"
        );
        let (count, stride) = (splats.len(), splats.sh_stride());
        assert_eq!(splats.quaternion.len(), count, "quaternions of all splats");
        assert_eq!(splats.log_scale.len(), count, "scales of all splats");
        assert_eq!(splats.opacity_logit.len(), count, "opacities of all splats");
        assert_eq!(splats.sh.len(), count * stride, "harmonics");
        // Axes that change places keep magnitudes, so that the bits are those of any axes.
        let bits = fractional_bits(&splats.mean, options.fractional_bits);
        let mut codes = SpzCodes {
            position: Vec::with_capacity(count),
            alpha: Vec::with_capacity(count),
            color: Vec::with_capacity(count),
            scale: Vec::with_capacity(count),
            rotation: Vec::with_capacity(count),
            sh: Vec::with_capacity(count * (stride - 3)),
            sh_degree: splats.sh_degree,
            fractional_bits: bits,
            antialiased: splats.filter == ScreenFilter::Mip,
            axes: options.axes,
        };
        // Parts are turned one at a time: a copy of the whole scene would double its memory.
        for start in (0..count).step_by(PART) {
            let part: Vec<usize> = (start..count.min(start + PART)).collect();
            let mut part = splats.picked(&part);
            part.change_axes(Axes::RDF, options.axes);
            codes.push(&part, options);
        }
        codes
    }

    /// Adds the nearest codes of splats in the axes of the codes.
    fn push(&mut self, splats: &Splats, options: &SpzOptions) {
        let bits = self.fractional_bits;
        let rows = || splats.sh.par_chunks_exact(splats.sh_stride());
        let bits_of = |i: usize| match 1 + i / 3 {
            1..4 => options.sh_bits[0],
            4..9 => options.sh_bits[1],
            _ => options.sh_bits[2],
        };
        let row = |row: &[f32]| -> Vec<u8> {
            let rest = row[3..].iter().enumerate();
            rest.map(|(i, value)| steps::sh_code(*value, bits_of(i))).collect()
        };
        let position = splats.mean.par_iter();
        self.position
            .par_extend(position.map(|p| p.map(|v| steps::position_code(v, bits))));
        let opacity = splats.opacity_logit.par_iter();
        self.alpha.par_extend(opacity.map(|v| steps::alpha_code(*v)));
        self.color
            .par_extend(rows().map(|sh| [sh[0], sh[1], sh[2]].map(steps::color_code)));
        let scale = splats.log_scale.par_iter();
        self.scale.par_extend(scale.map(|s| s.map(steps::scale_code)));
        let rotation = splats.quaternion.par_iter();
        self.rotation.par_extend(rotation.map(|q| steps::rotation_code(*q)));
        self.sh.par_extend(rows().flat_map_iter(row));
    }

    /// Number of splats.
    pub fn len(&self) -> usize {
        self.position.len()
    }

    /// True without splats.
    pub fn is_empty(&self) -> bool {
        self.position.is_empty()
    }

    /// Harmonics of a splat in `sh`: 0, 9, 24 or 45.
    pub fn sh_stride(&self) -> usize {
        3 * (sh_coefficient_count(self.sh_degree) - 1)
    }

    /// The splats of the codes, in RDF axes: equal to those that [`splats::read`](crate::io::splats::read) returns for
    /// a file of version 4, and of version 3 if the axes are RUB.
    pub fn decode(&self) -> Splats {
        let filter = match self.antialiased {
            true => ScreenFilter::Mip,
            false => ScreenFilter::Classic,
        };
        let mut collector = Collector::new(self.len(), self.sh_degree, filter);
        let stride = self.sh_stride();
        let mut sh = Vec::with_capacity(3 + stride);
        for i in 0..self.len() {
            sh.clear();
            sh.extend(self.color[i].map(steps::color));
            sh.extend(self.sh[i * stride..][..stride].iter().map(|code| steps::sh(*code)));
            collector.push(&StoredSplat {
                mean: self.position[i].map(|code| steps::position(code, self.fractional_bits)),
                quaternion: steps::rotation(self.rotation[i]),
                log_scale: self.scale[i].map(steps::scale),
                opacity_logit: logit_of_byte(self.alpha[i]),
                sh: &sh,
            });
        }
        let loaded = collector.finish(Path::new(""), StoredAs::default(), Vec::new());
        let mut splats = loaded.splats;
        splats.change_axes(self.axes, Axes::RDF);
        splats
    }
}

/// Most bits after the point, up to `most`, with which all finite positions are within the range.
fn fractional_bits(mean: &[[f32; 3]], most: u32) -> u32 {
    let finite = mean.as_flattened().iter().filter(|v| v.is_finite());
    let (least, greatest) = finite.fold((0.0f32, 0.0f32), |(least, greatest), v| {
        (least.min(*v), greatest.max(*v))
    });
    let fits = |bits: &u32| steps::position_fits(least, *bits) && steps::position_fits(greatest, *bits);
    (0..=most).rev().find(fits).unwrap_or(0)
}
