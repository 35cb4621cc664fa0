//! Codes of a version 2 scene, and the tables that turn codes of either version into splats.

use super::super::loaded::{Collector, StoredAs, StoredSplat, logit_of_byte};
use crate::scene::{ScreenFilter, Splats, sh_coefficient_count};
use std::path::Path;

/// Quantised scene, splat by splat in the order of the file. All vectors of a splat's codes have the same length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SogCodes {
    /// Index of each splat in the scene that was quantised; not part of the file.
    pub order: Vec<u32>,
    /// Codes of the means: t = min + (max − min) · code / 65535 along each axis, and the mean is sign(t) (e^|t| − 1)
    /// world units.
    pub mean: Vec<[u16; 3]>,
    /// t of code 0 along each axis.
    pub mean_min: [f64; 3],
    /// t of code 65535 along each axis.
    pub mean_max: [f64; 3],
    /// Bytes of the three smaller components of w, x, y, z in this order, (byte / 255 · 2 − 1) / √2 each, and 252 plus
    /// the index of the largest, which is positive.
    pub quaternion: Vec<[u8; 4]>,
    /// Indices into `scale_codebook`.
    pub scale: Vec<[u8; 3]>,
    /// Logarithms of scales, at most 256.
    pub scale_codebook: Vec<f32>,
    /// Indices of red, green and blue into `color_codebook`, and the opacity in 255ths.
    pub color: Vec<[u8; 4]>,
    /// Harmonics of degree 0 (`f_dc` of a `.ply`), at most 256.
    pub color_codebook: Vec<f32>,
    /// Harmonics of degree 1 and up, if there are any.
    pub palette: Option<SogPalette>,
    /// Filter on the screen.
    pub filter: ScreenFilter,
}

/// Palette of harmonics of degree 1 and up, shared by the splats.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SogPalette {
    /// Highest degree, 1 to 3.
    pub sh_degree: u32,
    /// Values of coefficients, at most 256.
    pub codebook: Vec<f32>,
    /// Indices into `codebook`, `[entry][coefficient][rgb]`; at most 65,536 entries.
    pub centroids: Vec<u8>,
    /// Entry of every splat; one beyond the last stands for zeros.
    pub labels: Vec<u16>,
}

impl SogPalette {
    /// Numbers of an entry: 9, 24 or 45.
    pub fn entry_length(&self) -> usize {
        numbers_of(self.sh_degree)
    }

    /// Number of entries.
    pub fn entries(&self) -> usize {
        self.centroids.len() / self.entry_length().max(1)
    }
}

/// Coefficients of degree 1 to `sh_degree`, times three channels.
pub(super) fn numbers_of(sh_degree: u32) -> usize {
    3 * (sh_coefficient_count(sh_degree) - 1)
}

impl SogCodes {
    /// Number of splats.
    pub fn len(&self) -> usize {
        self.mean.len()
    }

    /// True without splats.
    pub fn is_empty(&self) -> bool {
        self.mean.is_empty()
    }

    /// The splats that reading the file of these codes gives, in its order.
    pub fn decode(&self) -> Splats {
        let degree = self.palette.as_ref().map_or(0, |palette| palette.sh_degree);
        let tables = Tables {
            mean_min: self.mean_min,
            mean_max: self.mean_max,
            scale: [(); 3].map(|()| self.scale_codebook.clone()),
            color: [(); 3].map(|()| self.color_codebook.clone()),
            opacity_logit: opacity_logits(),
        };
        let harmonics = self.palette.as_ref().map(|palette| Harmonics {
            sh_degree: palette.sh_degree,
            entries: palette
                .centroids
                .iter()
                .map(|&code| value(&palette.codebook, code))
                .collect(),
        });
        let mut collector = Collector::new(self.len(), degree, self.filter);
        let mut decoder = Decoder::new(&tables, harmonics.as_ref());
        for i in 0..self.len() {
            let row = SplatCodes {
                mean: self.mean[i],
                quaternion: self.quaternion[i],
                scale: self.scale[i],
                color: self.color[i],
                label: self.palette.as_ref().map_or(0, |palette| palette.labels[i]),
            };
            decoder.push(&row, &mut collector);
        }
        collector
            .finish(Path::new("codes"), StoredAs::ply("SOG 2"), Vec::new())
            .splats
    }
}

/// Meaning of the codes of a file.
pub(super) struct Tables {
    pub(super) mean_min: [f64; 3],
    pub(super) mean_max: [f64; 3],
    /// Log-scales by axis and code.
    pub(super) scale: [Vec<f32>; 3],
    /// Harmonics of degree 0 by channel and code.
    pub(super) color: [Vec<f32>; 3],
    /// By code.
    pub(super) opacity_logit: Vec<f32>,
}

/// Decoded palette.
pub(super) struct Harmonics {
    pub(super) sh_degree: u32,
    /// `[entry][coefficient][rgb]`.
    pub(super) entries: Vec<f32>,
}

/// Codes of a splat.
pub(super) struct SplatCodes {
    pub(super) mean: [u16; 3],
    pub(super) quaternion: [u8; 4],
    pub(super) scale: [u8; 3],
    pub(super) color: [u8; 4],
    pub(super) label: u16,
}

/// Opacity logits of version 2, by byte.
pub(super) fn opacity_logits() -> Vec<f32> {
    (0..=255).map(logit_of_byte).collect()
}

/// Value of a code; NaN, which the collector drops, beyond the table. Readers refuse such files before.
fn value(table: &[f32], code: u8) -> f32 {
    table.get(usize::from(code)).copied().unwrap_or(f32::NAN)
}

/// Decoder of rows, with counts of irregular codes.
pub(super) struct Decoder<'a> {
    tables: &'a Tables,
    harmonics: Option<&'a Harmonics>,
    sh: Vec<f32>,
    /// Rotations without the number of a component, read as none.
    pub(super) unrotated: usize,
    /// Labels beyond the palette, read as zeros.
    pub(super) unlabelled: usize,
}

impl<'a> Decoder<'a> {
    pub(super) fn new(tables: &'a Tables, harmonics: Option<&'a Harmonics>) -> Decoder<'a> {
        let numbers = harmonics.map_or(0, |harmonics| numbers_of(harmonics.sh_degree));
        Decoder {
            tables,
            harmonics,
            sh: vec![0.0; 3 + numbers],
            unrotated: 0,
            unlabelled: 0,
        }
    }

    /// Decodes a splat.
    pub(super) fn push(&mut self, row: &SplatCodes, collector: &mut Collector) {
        let tables = self.tables;
        let [r, g, b, opacity] = row.color;
        for ((sh, table), code) in self.sh.iter_mut().zip(&tables.color).zip([r, g, b]) {
            *sh = value(table, code);
        }
        if let Some(harmonics) = self.harmonics {
            let rest = &mut self.sh[3..];
            let start = usize::from(row.label) * rest.len();
            match harmonics.entries.get(start..start + rest.len()) {
                Some(entry) => rest.copy_from_slice(entry),
                None => {
                    rest.fill(0.0);
                    self.unlabelled += 1;
                }
            }
        }
        let quaternion = quaternion(row.quaternion);
        self.unrotated += usize::from(quaternion.is_none());
        let log_scale = |axis: usize| value(&tables.scale[axis], row.scale[axis]);
        collector.push(&StoredSplat {
            mean: mean(tables, row.mean),
            quaternion: quaternion.unwrap_or([1.0, 0.0, 0.0, 0.0]),
            log_scale: [log_scale(0), log_scale(1), log_scale(2)],
            opacity_logit: value(&tables.opacity_logit, opacity),
            sh: &self.sh,
        });
    }
}

fn mean(tables: &Tables, codes: [u16; 3]) -> [f32; 3] {
    let mut axis = 0;
    codes.map(|code| {
        let (min, max) = (tables.mean_min[axis], tables.mean_max[axis]);
        axis += 1;
        let t = min + (max - min) * (f64::from(code) / 65535.0);
        t.abs().exp_m1().copysign(t) as f32
    })
}

/// Tag of a rotation whose largest component is w.
pub(super) const QUATERNION_TAG: u8 = 252;

fn quaternion([a, b, c, tag]: [u8; 4]) -> Option<[f32; 4]> {
    let largest = usize::from(tag.checked_sub(QUATERNION_TAG)?);
    let small = [a, b, c].map(|byte| (f64::from(byte) / 255.0 * 2.0 - 1.0) * std::f64::consts::FRAC_1_SQRT_2);
    let rest: f64 = small.iter().map(|v| v * v).sum();
    let mut quaternion = [0.0; 4];
    let mut small = small.into_iter();
    for (i, component) in quaternion.iter_mut().enumerate() {
        *component = match i == largest {
            true => (1.0 - rest).max(0.0).sqrt(),
            false => small.next().unwrap_or(0.0),
        } as f32;
    }
    Some(quaternion)
}
