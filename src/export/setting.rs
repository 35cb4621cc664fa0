//! Settings of formats, from the fewest bytes to the most.

use super::harmonics::HarmonicGrid;
use crate::io::spz::SpzVersion;
use crate::{Error, Result};
use std::path::Path;

/// Format of an exported file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportFormat {
    /// `.ply` of the 3DGS reference code.
    Ply,
    /// Compressed `.ply`.
    CompressedPly,
    /// `.splat`.
    Splat,
    /// `.spz`.
    Spz(SpzVersion),
    /// `.glb` with KHR_gaussian_splatting.
    Glb,
    /// `.sog` of version 2.
    Sog,
}

/// Name on the command line, end of the file name and format.
const FORMATS: [(&str, &str, ExportFormat); 7] = [
    ("compressed-ply", ".compressed.ply", ExportFormat::CompressedPly),
    ("ply", ".ply", ExportFormat::Ply),
    ("splat", ".splat", ExportFormat::Splat),
    ("spz", ".spz", ExportFormat::Spz(SpzVersion::V4)),
    ("spz3", "", ExportFormat::Spz(SpzVersion::V3)),
    ("sog", ".sog", ExportFormat::Sog),
    ("glb", ".glb", ExportFormat::Glb),
];

impl ExportFormat {
    /// Names of all formats.
    pub fn names() -> impl Iterator<Item = &'static str> {
        FORMATS.iter().map(|(name, ..)| *name)
    }

    /// Format of a name.
    pub fn parse(name: &str) -> Option<ExportFormat> {
        FORMATS.iter().find(|(known, ..)| *known == name).map(|found| found.2)
    }

    fn row(self) -> Option<&'static (&'static str, &'static str, ExportFormat)> {
        FORMATS.iter().find(|(.., format)| *format == self)
    }

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        self.row().map_or("", |(name, ..)| name)
    }

    /// Name of a file of the format, for [`losses`](crate::io::splats::losses).
    pub fn end(self) -> &'static Path {
        let end = match self {
            ExportFormat::Spz(_) => ".spz",
            other => other.row().map_or("", |(_, end, _)| end),
        };
        Path::new(end)
    }

    /// Format by the end of a file's name.
    ///
    /// # Errors
    /// For other ends, with those that there are.
    pub fn of(path: &Path) -> Result<ExportFormat> {
        let name = path.to_string_lossy().to_ascii_lowercase();
        let ends = || FORMATS.iter().filter(|(_, end, _)| !end.is_empty());
        let found = ends().find(|(_, end, _)| name.ends_with(end));
        found.map(|found| found.2).ok_or_else(|| {
            let ends: Vec<&str> = ends().map(|(_, end, _)| *end).collect();
            Error::file(
                path,
                format!(
                    "scenes are exported to {} files; --format forces one",
                    ends.join(" or ")
                ),
            )
        })
    }

    /// Settings from the fewest bytes to the most.
    pub fn settings(self, sh_degree: u32) -> Vec<Setting> {
        let base = Setting {
            sh_degree,
            ..Setting::default()
        };
        match self {
            ExportFormat::Ply | ExportFormat::Glb => vec![base],
            ExportFormat::Splat => vec![Setting { sh_degree: 0, ..base }],
            ExportFormat::CompressedPly => (0..=sh_degree).map(|sh_degree| Setting { sh_degree, ..base }).collect(),
            ExportFormat::Spz(_) | ExportFormat::Sog if sh_degree == 0 => vec![base],
            ExportFormat::Sog => {
                let palettes = SOG_PALETTES.iter();
                palettes.map(|&palette| Setting { palette, ..base }).collect()
            }
            ExportFormat::Spz(_) => {
                let rungs = SPZ_RUNGS.iter();
                rungs
                    .map(|&(sh_bits, reference, bit_price)| Setting {
                        sh_bits,
                        reference,
                        bit_price,
                        ..base
                    })
                    .collect()
            }
        }
    }
}

/// Choices of an encoder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Highest degree of harmonics kept.
    pub sh_degree: u32,
    /// SPZ: bits of harmonics of degrees 1, 2 and 3.
    pub sh_bits: [u32; 3],
    /// SPZ: weight above which splats have more bits,
    /// [`RoundingOptions::reference`](super::RoundingOptions::reference).
    pub reference: f64,
    /// SPZ: price of a bit of a harmonic, [`RoundingOptions::bit_price`](super::RoundingOptions::bit_price).
    pub bit_price: f64,
    /// SOG: the usual size of the palette of harmonics, that of splat-transform, over this.
    pub palette: usize,
    /// SPZ: bits after the point of positions; `None`: chosen by the error of the harmonics.
    pub fractional_bits: Option<u32>,
}

impl Default for Setting {
    fn default() -> Setting {
        Setting {
            sh_degree: 3,
            sh_bits: [5, 4, 4],
            reference: 2.0,
            bit_price: 0.0,
            palette: 1,
            fractional_bits: None,
        }
    }
}

impl Setting {
    /// Grid of harmonics; `None` for formats that hold floats.
    pub(super) fn grid(&self, target: ExportFormat) -> Option<HarmonicGrid<'static>> {
        let degree = self.sh_degree;
        let kept = |step: [f64; 3]| [1, 2, 3].map(|d| if d <= degree { step[d as usize - 1] } else { 0.0 });
        match target {
            ExportFormat::Ply | ExportFormat::Glb | ExportFormat::Sog => None,
            ExportFormat::Splat => Some(HarmonicGrid::Steps {
                step: [0.0; 3],
                finest: 0.0,
                offset: 0.0,
                limit: 0.0,
            }),
            ExportFormat::CompressedPly => Some(HarmonicGrid::Steps {
                step: kept([1.0 / 32.0; 3]),
                finest: 1.0 / 32.0,
                offset: 1.0 / 64.0,
                limit: 4.0 - 1.0 / 64.0,
            }),
            ExportFormat::Spz(_) => {
                let step = self.sh_bits.map(|bits| 2.0_f64.powi(1 - bits as i32));
                // Codes end one step below 1; in other axes signs change.
                Some(HarmonicGrid::Steps {
                    step: kept(step),
                    finest: 1.0 / 128.0,
                    offset: 0.0,
                    limit: 1.0 - step[0].max(step[1]).max(step[2]),
                })
            }
        }
    }

    /// Text for tables.
    pub fn describe(&self, target: ExportFormat) -> String {
        match target {
            ExportFormat::Spz(_) if self.sh_degree > 0 => {
                let [a, b, c] = self.sh_bits;
                let more = match self.reference.is_finite() {
                    true => format!(", more above weight {}", self.reference),
                    false => String::new(),
                };
                format!("harmonics of {a}/{b}/{c} bits{more}")
            }
            ExportFormat::Sog if self.sh_degree > 0 => match self.palette {
                1 => "palette of the usual size".to_owned(),
                part => format!("palette of 1/{part} of the usual size"),
            },
            ExportFormat::Splat | ExportFormat::Sog | ExportFormat::Spz(_) => "harmonics of degree 0".to_owned(),
            ExportFormat::Ply | ExportFormat::Glb | ExportFormat::CompressedPly => {
                format!("harmonics to degree {}", self.sh_degree)
            }
        }
    }
}

/// Parts of the usual palette, from the fewest bytes to the most.
const SOG_PALETTES: [usize; 5] = [64, 16, 4, 2, 1];

/// Bits of harmonics, weight above which splats have more, and price of a bit, from the fewest bytes to the most.
const SPZ_RUNGS: [([u32; 3], f64, f64); 12] = [
    ([4, 3, 3], 8.0, 3e-4),
    ([4, 3, 3], 4.0, 1e-4),
    ([4, 3, 3], 2.0, 0.0),
    ([5, 4, 4], 8.0, 3e-5),
    ([5, 4, 4], 4.0, 0.0),
    ([5, 4, 4], 2.0, 0.0),
    ([5, 4, 4], 1.0, 0.0),
    ([5, 4, 4], 0.5, 0.0),
    ([5, 4, 4], 0.25, 0.0),
    ([6, 5, 5], 0.5, 0.0),
    ([6, 5, 5], 0.125, 0.0),
    ([8, 8, 8], f64::INFINITY, 0.0),
];
