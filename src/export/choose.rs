//! Encoding of a scene within a loss or a number of bytes.

use super::geometry::round_light;
use super::harmonics::{HarmonicGrid, round_harmonics};
use super::influence::Influence;
use super::pictures::{PictureError, Pictures};
use super::sensitivity::Sensitivity;
use super::setting::{ExportFormat, Setting};
use crate::io::atomic::write_atomically;
use crate::io::gltf;
use crate::io::ply;
use crate::io::ply::compressed::{CHUNK, CompressedPlyCodes};
use crate::io::sog::{SogCodes, SogOptions, usual_entries};
use crate::io::splat32;
use crate::io::spz::{CodeCosts, LEVEL, SpzCodes, SpzOptions};
use crate::scene::{Splats, kd_order};
use crate::{Error, Result};
use std::f64::consts::LN_2;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// Bound of an export.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// Largest loss, [`PictureError::loss_db`], in decibels.
    Loss(f64),
    /// Largest file in bytes.
    Bytes(u64),
}

/// Scene in the codes of a format.
#[derive(Clone, Debug)]
pub struct EncodedScene {
    /// Choices of the encoder.
    pub setting: Setting,
    /// Length of the file.
    pub bytes: u64,
    codes: Codes,
}

#[derive(Clone, Debug)]
enum Codes {
    Ply(Arc<Splats>),
    Glb(Arc<Splats>),
    Splat(Arc<Splats>),
    CompressedPly(CompressedPlyCodes),
    /// Codes and the file.
    Spz(SpzCodes, Vec<u8>),
    /// Codes and the file.
    Sog(SogCodes, Vec<u8>),
}

impl EncodedScene {
    /// Splats that a reader of the file gets.
    pub fn decode(&self) -> Splats {
        match &self.codes {
            Codes::Ply(splats) | Codes::Glb(splats) => Splats::clone(splats),
            Codes::Splat(splats) => splat32::decoded(splats),
            Codes::CompressedPly(codes) => codes.decode(),
            Codes::Spz(codes, _) => codes.decode(),
            Codes::Sog(codes, _) => codes.decode(),
        }
    }

    /// Writes the file atomically.
    ///
    /// # Errors
    /// Those of the operating system.
    pub fn write(&self, path: &Path) -> Result<()> {
        match &self.codes {
            Codes::Ply(splats) => ply::write(path, splats),
            Codes::Glb(splats) => gltf::write(path, splats),
            Codes::Splat(splats) => splat32::write(path, splats),
            Codes::CompressedPly(codes) => codes.write(path),
            Codes::Spz(_, file) | Codes::Sog(_, file) => write_atomically(path, |into| into.write_all(file)),
        }
    }
}

/// Most splats for the slow level of zstd.
const SLOW_SPLATS_MAX: usize = 200_000;

/// Level of zstd: small gains are worth seconds, not minutes.
fn level(splats: usize) -> i32 {
    if splats <= SLOW_SPLATS_MAX { 19 } else { LEVEL }
}

/// Scene to be exported, in the order of a k-d tree, and its views if there are any.
#[derive(Debug)]
pub struct ExportSource {
    splats: Arc<Splats>,
    views: Option<SourceViews>,
}

/// Weights of splats in views, and effects of their errors there.
#[derive(Debug)]
struct SourceViews {
    influence: Influence,
    sensitivity: Sensitivity,
}

impl ExportSource {
    /// Puts a scene in order; every number is rounded by itself.
    pub fn new(splats: Splats) -> ExportSource {
        ExportSource::ordered(splats).0
    }

    /// Puts a scene in order; numbers are rounded by their effect on `pictures` of the scene, or by themselves if those
    /// show nothing of it.
    ///
    /// # Errors
    /// Those of the device.
    pub fn in_views(splats: Splats, influence: &Influence, pictures: &mut Pictures<'_>) -> Result<ExportSource> {
        let (mut source, order) = ExportSource::ordered(splats);
        let influence = influence.picked(&order);
        let sensitivity = Sensitivity::measure(&source.splats, &influence, pictures)?;
        source.views = sensitivity.map(|sensitivity| SourceViews { influence, sensitivity });
        Ok(source)
    }

    /// A scene in order, and the order.
    fn ordered(mut splats: Splats) -> (ExportSource, Vec<usize>) {
        let order: Vec<usize> = kd_order(&splats.mean, CHUNK).iter().map(|&i| i as usize).collect();
        splats.reorder(&order);
        // An empty degree costs bytes, and rounding would fill it where no code stands for zero.
        splats.cut_harmonics(splats.used_sh_degree());
        let splats = Arc::new(splats);
        (ExportSource { splats, views: None }, order)
    }

    /// The splats in order.
    pub fn splats(&self) -> &Splats {
        &self.splats
    }

    /// Encodes the scene by a setting.
    ///
    /// # Errors
    /// A lack of memory.
    pub fn encode(&self, target: ExportFormat, setting: Setting) -> Result<EncodedScene> {
        self.coded(self.rounded(target, setting), target, setting)
    }

    /// As [`encode`](ExportSource::encode), but the memory of the scene is free before its codes are compressed.
    ///
    /// # Errors
    /// A lack of memory.
    pub fn into_encoded(mut self, target: ExportFormat, setting: Setting) -> Result<EncodedScene> {
        if self.views.is_none() {
            // In place; `rounded` would copy.
            Arc::make_mut(&mut self.splats).cut_harmonics(setting.sh_degree);
        }
        let rounded = self.rounded(target, setting);
        self.splats = Arc::default();
        self.coded(rounded, target, setting)
    }

    fn coded(&self, rounded: Arc<Splats>, target: ExportFormat, setting: Setting) -> Result<EncodedScene> {
        let codes = match target {
            ExportFormat::Ply => Codes::Ply(rounded),
            ExportFormat::Glb => Codes::Glb(rounded),
            ExportFormat::Splat => Codes::Splat(rounded),
            ExportFormat::CompressedPly => Codes::CompressedPly(CompressedPlyCodes::nearest(&rounded)),
            ExportFormat::Sog => {
                let codes = self.sog(&rounded, setting);
                drop(rounded);
                let file = codes.bytes()?;
                Codes::Sog(codes, file)
            }
            ExportFormat::Spz(version) => {
                let codes = self.spz(rounded, setting);
                let file = codes.bytes(version, level(codes.len()));
                let file = file.map_err(|error| Error::Config(format!("zstd: {error}")))?;
                Codes::Spz(codes, file)
            }
        };
        let bytes = match &codes {
            Codes::Ply(splats) => ply::byte_count(splats),
            Codes::Glb(splats) => gltf::byte_count(splats),
            Codes::Splat(splats) => splat32::byte_count(splats),
            Codes::CompressedPly(codes) => codes.byte_count(),
            Codes::Spz(_, file) | Codes::Sog(_, file) => file.len() as u64,
        };
        Ok(EncodedScene { setting, bytes, codes })
    }

    /// Encodes the scene by a setting and compares its pictures.
    ///
    /// # Errors
    /// Those of [`encode`](ExportSource::encode) and of the device.
    pub fn measure(&self, target: ExportFormat, setting: Setting, pictures: &mut Pictures<'_>) -> Result<Measurement> {
        let encoded = self.encode(target, setting)?;
        let error = pictures.error(&encoded.decode())?;
        Ok(Measurement { encoded, error })
    }

    /// Codes of splats in this setting; with views, those of large steps last, so that each has its own statistics.
    fn spz(&self, mut splats: Arc<Splats>, setting: Setting) -> SpzCodes {
        let Some(SourceViews { influence, sensitivity }) = &self.views else {
            return SpzCodes::nearest(&splats, &SpzOptions::default());
        };
        // A weight is a sum over all views: once.
        let weight: Vec<f64> = (0..splats.len()).map(|i| influence.of(i)).collect();
        let step: Vec<f64> = weight.iter().map(|&weight| setting.spz_step(weight)).collect();
        let mut order: Vec<usize> = (0..splats.len()).collect();
        order.sort_by(|&a, &b| step[a].total_cmp(&step[b]));
        Arc::make_mut(&mut splats).reorder(&order);
        let costs = |i: usize| sensitivity.costs(weight[order[i]], splats.log_scale[i], setting.spz_bit_price());
        let options = SpzOptions {
            fractional_bits: fractional_bits(splats.len(), costs),
            sh_bits: [8; 3],
            ..SpzOptions::default()
        };
        let mut codes = SpzCodes::nearest(&splats, &options);
        codes.economize(&splats, costs);
        codes
    }

    /// Codes with palette and codebooks by weight; constant colours make up for the errors of the palette in the views.
    fn sog(&self, splats: &Splats, setting: Setting) -> SogCodes {
        let entries = Some(usual_entries(splats.len()) / setting.palette);
        let Some(SourceViews { influence, .. }) = &self.views else {
            let options = SogOptions {
                palette_entries: entries,
                weights: None,
            };
            return SogCodes::quantise(splats, &options);
        };
        let weight = |i: usize| influence.of(i) as f32;
        let weights: Vec<f32> = (0..splats.len()).map(weight).collect();
        let options = SogOptions {
            palette_entries: entries,
            weights: Some(&weights),
        };
        let mut codes = SogCodes::quantise(splats, &options);
        let (decoded, stride) = (codes.decode(), splats.sh_stride());
        let mut given = splats.sh.clone();
        // A splat that is not finite is left out by the format.
        if decoded.sh_stride() == stride {
            for (row, &i) in decoded.sh.chunks_exact(stride).zip(&codes.order) {
                given[i as usize * stride..][..stride].copy_from_slice(row);
            }
            let grid = HarmonicGrid::Given(&given);
            codes.set_colors(&round_harmonics(splats, influence, grid));
        }
        codes
    }

    /// Splats with harmonics and scales on the format's grid.
    fn rounded(&self, target: ExportFormat, setting: Setting) -> Arc<Splats> {
        let mut rounded = match (&self.views, setting.grid(target)) {
            (Some(views), Some(grid)) => round_harmonics(&self.splats, &views.influence, grid),
            _ if setting.sh_degree >= self.splats.sh_degree => return self.splats.clone(),
            _ => Splats::clone(&self.splats),
        };
        rounded.cut_harmonics(setting.sh_degree);
        Arc::new(match (&self.views, target) {
            (Some(_), ExportFormat::Spz(_)) => round_light(&rounded, SPZ_SCALE_STEP),
            _ => rounded,
        })
    }
}

/// Bits after the point of positions: a bit more would cost as much as it gains, s² c ln 2 / 6 for the step s of the
/// codes and the mean cost c of a squared unit.
fn fractional_bits(count: usize, costs: impl Fn(usize) -> CodeCosts) -> u32 {
    let relative = |CodeCosts { position, bit, .. }| position / bit;
    let total: f64 = (0..count).map(|i| relative(costs(i))).sum();
    let gain = total / count as f64 * LN_2 / 6.0;
    match gain > 0.0 {
        true => (gain.log2() / 2.0).ceil().clamp(0.0, 24.0) as u32,
        false => SpzOptions::default().fractional_bits,
    }
}

/// Step of log-scales in SPZ.
const SPZ_SCALE_STEP: f64 = 1.0 / 16.0;

/// Encoded scene and its error in the views.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// Encoded scene.
    pub encoded: EncodedScene,
    /// Error of its pictures.
    pub error: PictureError,
}

/// Settings of a format, measured when asked.
pub struct Ladder<'a, 'd> {
    source: &'a ExportSource,
    target: ExportFormat,
    pictures: &'a mut Pictures<'d>,
    settings: Vec<Setting>,
    measured: Vec<Option<Measurement>>,
}

impl<'a, 'd> Ladder<'a, 'd> {
    /// Settings of a format for a scene, from the fewest bytes to the most.
    pub fn new(source: &'a ExportSource, target: ExportFormat, pictures: &'a mut Pictures<'d>) -> Ladder<'a, 'd> {
        let settings = target.settings(source.splats.sh_degree);
        Ladder {
            source,
            target,
            pictures,
            measured: vec![None; settings.len()],
            settings,
        }
    }

    /// Number of settings.
    pub fn rung_count(&self) -> usize {
        self.settings.len()
    }

    /// Encodes by a setting and measures it, once.
    ///
    /// # Errors
    /// Those of the device.
    pub fn measure(&mut self, rung: usize) -> Result<&Measurement> {
        let known = self.measured[rung].take();
        let measured = match known {
            Some(measured) => measured,
            None => self.source.measure(self.target, self.settings[rung], self.pictures)?,
        };
        Ok(self.measured[rung].insert(measured))
    }

    /// The setting of fewest bytes within a loss, or of least error within a number of bytes: by halving, as bytes grow
    /// and errors fall along the ladder. `None` if there is none.
    ///
    /// # Errors
    /// Those of the device.
    pub fn choose(&mut self, budget: Budget) -> Result<Option<Measurement>> {
        let (mut low, mut high) = (0, self.rung_count());
        // Rungs below `low` lose too much, or are small enough; those from `high` on are not.
        while low < high {
            let middle = (low + high) / 2;
            let Measurement { encoded, error } = self.measure(middle)?;
            let goes_up = match budget {
                Budget::Loss(most) => error.loss_db() > most,
                Budget::Bytes(most) => encoded.bytes <= most,
            };
            match goes_up {
                true => low = middle + 1,
                false => high = middle,
            }
        }
        let chosen = match budget {
            Budget::Loss(_) => low,
            Budget::Bytes(_) => low.wrapping_sub(1),
        };
        match chosen < self.rung_count() {
            true => self.measure(chosen).cloned().map(Some),
            false => Ok(None),
        }
    }
}
