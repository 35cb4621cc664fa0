//! Splats of C: from files and arrays, and to the device.

use super::failure::{AshfallResult, Failure, guard};
use super::memory::{check, numbers, read, sized, store, text, write};
use super::registry::{AshfallDevice, AshfallModel, AshfallScene, LiveObject, find, insert, remove};
use crate::render::{Model, Precision};
use crate::scene::{ScreenFilter, Splats, sh_coefficient_count};
use std::ffi::c_char;
use std::path::Path;
use std::sync::Arc;

/// Filter of splats on the screen, that of their training.
pub type AshfallFilter = u32;
/// Screen covariance dilated by 0.3 px² (3DGS).
pub const ASHFALL_FILTER_CLASSIC: AshfallFilter = 0;
/// Dilated by 0.1 px², and opacities lowered so that no light is added (Mip-Splatting).
pub const ASHFALL_FILTER_MIP: AshfallFilter = 1;

/// Storage precision of a model; its renderer's is the same.
pub type AshfallPrecision = u32;
/// 32-bit floats.
pub const ASHFALL_PRECISION_FULL: AshfallPrecision = 0;
/// Spherical harmonics as halves.
pub const ASHFALL_PRECISION_HALF_HARMONICS: AshfallPrecision = 1;
/// All but means as halves.
pub const ASHFALL_PRECISION_HALF: AshfallPrecision = 2;

/// Splats in arrays. World axes are free; the camera's are x right, y down, z forward.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct AshfallArrays {
    /// sizeof(AshfallArrays).
    pub size: u32,
    /// Number of splats.
    pub count: u32,
    /// Highest degree of the spherical harmonics, 0 to 3.
    pub sh_degree: u32,
    /// ASHFALL_FILTER_CLASSIC or ASHFALL_FILTER_MIP.
    pub filter: AshfallFilter,
    /// `[splat][3]`: centres in world units.
    pub mean: *const f32,
    /// `[splat][4]`: rotations, as w, x, y, z; normalised on use.
    pub quaternion: *const f32,
    /// `[splat][3]`: natural logarithms of the standard deviations along the local axes.
    pub log_scale: *const f32,
    /// `[splat]`: logits of the opacities.
    pub opacity_logit: *const f32,
    /// `[splat][(sh_degree + 1)²][3]`: coefficients of red, green and blue.
    pub sh: *const f32,
}

/// Properties of a scene.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct AshfallSceneInfo {
    /// sizeof(AshfallSceneInfo).
    pub size: u32,
    /// Number of splats.
    pub count: u32,
    /// Highest degree of the spherical harmonics.
    pub sh_degree: u32,
    /// Filter on the screen.
    pub filter: AshfallFilter,
    /// Origin of the means in the coordinates of the data set; cameras are relative to it.
    pub origin: [f64; 3],
    /// Splats with a non-finite parameter, which are not drawn.
    pub not_finite: u64,
}

sized!(AshfallArrays, AshfallSceneInfo);

/// Filter of a number of C.
pub(super) fn filter(number: AshfallFilter) -> Result<ScreenFilter, Failure> {
    match number {
        ASHFALL_FILTER_CLASSIC => Ok(ScreenFilter::Classic),
        ASHFALL_FILTER_MIP => Ok(ScreenFilter::Mip),
        _ => Err(Failure::argument(format!("filter: {number} is none"))),
    }
}

/// Precision of a number of C.
pub(super) fn precision(number: AshfallPrecision) -> Result<Precision, Failure> {
    match number {
        ASHFALL_PRECISION_FULL => Ok(Precision::Full),
        ASHFALL_PRECISION_HALF_HARMONICS => Ok(Precision::HalfHarmonics),
        ASHFALL_PRECISION_HALF => Ok(Precision::Half),
        _ => Err(Failure::argument(format!("precision: {number} is none"))),
    }
}

/// Reads a scene from a file: .ply, .compressed.ply, .splat, .spz, .ksplat, .glb, .gltf, and .sog in builds with the
/// feature `train`. `path` is UTF-8.
///
/// # Safety
/// `path` is null or ends with a zero byte, `scene` is null or valid for a write.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ashfall_scene_read(path: *const c_char, scene: *mut *mut AshfallScene) -> AshfallResult {
    guard(|| {
        check("scene", scene)?;
        // SAFETY: as the caller says.
        let path = unsafe { text("path", path) }?;
        let splats = crate::io::splats::read(Path::new(path))?.splats;
        // SAFETY: checked above.
        unsafe { store("scene", scene, insert(LiveObject::Scene(Arc::new(splats)))) }
    })
}

/// Copies splats from arrays.
///
/// # Safety
/// `arrays` and its pointers are null or valid for its counts, `scene` is null or valid for a write.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ashfall_scene_from_arrays(
    arrays: *const AshfallArrays,
    scene: *mut *mut AshfallScene,
) -> AshfallResult {
    guard(|| {
        check("scene", scene)?;
        // SAFETY: as the caller says.
        let from = unsafe { read(arrays) }?;
        if from.sh_degree > 3 {
            return Err(Failure::argument(format!("sh_degree: {}; 0 to 3", from.sh_degree)));
        }
        let count = from.count as usize;
        let coefficients = 3 * sh_coefficient_count(from.sh_degree);
        // SAFETY: as the caller says, each by its count.
        let splats = unsafe {
            Splats {
                mean: numbers("mean", from.mean.cast(), count)?,
                quaternion: numbers("quaternion", from.quaternion.cast(), count)?,
                log_scale: numbers("log_scale", from.log_scale.cast(), count)?,
                opacity_logit: numbers("opacity_logit", from.opacity_logit, count)?,
                sh: numbers("sh", from.sh, coefficients * count)?,
                sh_degree: from.sh_degree,
                filter: filter(from.filter)?,
                ..Splats::default()
            }
        };
        // SAFETY: checked above.
        unsafe { store("scene", scene, insert(LiveObject::Scene(Arc::new(splats)))) }
    })
}

/// Properties of a scene.
///
/// # Safety
/// `info` is null or valid for its size.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ashfall_scene_info(scene: *mut AshfallScene, info: *mut AshfallSceneInfo) -> AshfallResult {
    guard(|| {
        let splats = find(scene)?;
        let value = AshfallSceneInfo {
            size: 0,
            count: splats.len() as u32,
            sh_degree: splats.sh_degree,
            filter: match splats.filter {
                ScreenFilter::Classic => ASHFALL_FILTER_CLASSIC,
                ScreenFilter::Mip => ASHFALL_FILTER_MIP,
            },
            origin: splats.origin.to_array(),
            not_finite: splats.not_finite().map_or(0, |found| found.count as u64),
        };
        // SAFETY: as the caller says.
        unsafe { write(info, &value) }
    })
}

/// Destroys a scene; null is ignored. Models made from it are not affected.
#[unsafe(no_mangle)]
pub extern "C" fn ashfall_scene_destroy(scene: *mut AshfallScene) -> AshfallResult {
    guard(|| remove(scene))
}

/// Copies a scene to the device and waits for it: for devices with a queue. ashfall_cmd_upload does without.
///
/// # Safety
/// `model` is null or valid for a write.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ashfall_model_upload(
    device: *mut AshfallDevice,
    scene: *mut AshfallScene,
    precision: AshfallPrecision,
    model: *mut *mut AshfallModel,
) -> AshfallResult {
    guard(|| {
        check("model", model)?;
        let (gpu, splats) = (find(device)?, find(scene)?);
        let uploaded = Model::upload_as(&gpu, &splats, self::precision(precision)?)?;
        // SAFETY: checked above.
        unsafe { store("model", model, insert(LiveObject::Model(Arc::new(uploaded)))) }
    })
}

/// Destroys a model; null is ignored. Frames in flight keep its memory until they have run.
#[unsafe(no_mangle)]
pub extern "C" fn ashfall_model_destroy(model: *mut AshfallModel) -> AshfallResult {
    guard(|| remove(model))
}
