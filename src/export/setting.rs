//! Settings of formats, from the fewest bytes to the most.

use super::harmonics::{HarmonicGrid, step_of};
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
                let steps = (0..SPZ_RUNGS).map(|rung| SPZ_STEPS[1] * (-f64::from(rung) / 4.0).exp2());
                steps.map(|sh_step| Setting { sh_step, ..base }).collect()
            }
        }
    }
}

/// Choices of an encoder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Highest degree of harmonics kept.
    pub sh_degree: u32,
    /// SPZ: step of the harmonics of a splat of mean weight.
    pub sh_step: f64,
    /// SOG: the usual size of the palette of harmonics, that of splat-transform, over this.
    pub palette: usize,
}

impl Default for Setting {
    fn default() -> Setting {
        Setting {
            sh_degree: 3,
            sh_step: 0.0625,
            palette: 1,
        }
    }
}

impl Setting {
    /// Grid of harmonics; `None` for formats that hold floats.
    pub(super) fn grid(&self, target: ExportFormat) -> Option<HarmonicGrid<'static>> {
        let steps = |step: f64, range, offset, end, bit_price| HarmonicGrid::Steps {
            degree: self.sh_degree,
            step,
            range,
            offset,
            end,
            bit_price,
        };
        match target {
            ExportFormat::Ply | ExportFormat::Glb | ExportFormat::Sog => None,
            ExportFormat::Splat => Some(steps(1.0, [1.0; 2], 0.0, 1.0, 0.0)),
            ExportFormat::CompressedPly => Some(steps(1.0 / 32.0, [1.0 / 32.0; 2], 1.0 / 64.0, 4.0 - 1.0 / 64.0, 0.0)),
            // Codes end one step below 1; in other axes signs change.
            ExportFormat::Spz(_) => Some(steps(self.sh_step, SPZ_STEPS, 0.0, 1.0, BIT_PRICE)),
        }
    }

    /// Step of the harmonics of a splat of this weight in SPZ.
    pub(super) fn spz_step(&self, weight: f64) -> f64 {
        step_of(self.sh_step, weight, SPZ_STEPS)
    }

    /// Price of a bit in SPZ, in the unit of the harmonics' errors.
    pub(super) fn spz_bit_price(&self) -> f64 {
        BIT_PRICE * self.sh_step * self.sh_step
    }

    /// Text for tables.
    pub fn describe(&self, target: ExportFormat) -> String {
        match target {
            ExportFormat::Spz(_) if self.sh_degree > 0 => {
                format!("harmonics in steps of {:.3} at mean weight", self.sh_step)
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

/// Settings of SPZ, each with steps smaller by the fourth root of ½.
const SPZ_RUNGS: u32 = 24;

/// Finest and coarsest step of harmonics in SPZ.
const SPZ_STEPS: [f64; 2] = [1.0 / 128.0, 0.25];

/// Price of a bit in squared steps: the slope 2 ln 2 of the error s²/12 of a step s over bits, times 1/2π, the mean
/// weight of a coefficient in the views and in all directions.
const BIT_PRICE: f64 = 0.0184;
