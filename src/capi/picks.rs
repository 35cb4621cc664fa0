//! Reports on the pixels of pictures.

use super::failure::{AshfallResult, Failure, guard};
use super::memory::{check, read, sized, write};
use super::registry::{AshfallRenderer, find};
use super::session::lock;
use crate::render::{NO_SPLAT, PickPixel};

/// Instance and splat of pixels without one.
pub const ASHFALL_NO_SPLAT: u32 = 0xffff_ffff;
const _: () = assert!(ASHFALL_NO_SPLAT == NO_SPLAT);

/// Report on the pixels of a picture's AshfallPickArea.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct AshfallPickReport {
    /// sizeof(AshfallPickReport).
    pub size: u32,
    /// 1 if there is a report; else the other fields are 0.
    pub available: u32,
    /// First column of the area.
    pub x: u32,
    /// Its first row.
    pub y: u32,
    /// Its columns.
    pub width: u32,
    /// Its rows.
    pub height: u32,
}

/// Report on a pixel.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AshfallPickPixel {
    /// Instance of the splat at which the coverage reaches 1/2, or ASHFALL_NO_SPLAT.
    pub instance: u32,
    /// Index of the splat in its scene, or ASHFALL_NO_SPLAT.
    pub splat: u32,
    /// Depth of its mean along the view's z axis in world units; infinite without one.
    pub depth: f32,
    /// Transmittance of all splats, 0 to 1.
    pub transmittance: f32,
}

sized!(AshfallPickReport);

/// Takes the oldest report of a picture with AshfallDraw.pick that has not been taken. There is one once
/// ashfall_cmd_draw has reported the picture's frame, which it does without a wait, as many frames later as are in
/// flight.
///
/// `pixels`: receives the pixels of the area row by row; room for `capacity` of them. Where it is less than the report
/// has, the result is ASHFALL_ERROR_ARGUMENT, and the report stays.
///
/// # Safety
/// `report` is null or valid for its size, `pixels` is null or valid for writes of `capacity` pixels.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ashfall_take_pick(
    renderer: *mut AshfallRenderer,
    report: *mut AshfallPickReport,
    pixels: *mut AshfallPickPixel,
    capacity: u32,
) -> AshfallResult {
    guard(|| {
        check("pixels", pixels)?;
        let session = find(renderer)?;
        // SAFETY: as the caller says.
        let mut value = AshfallPickReport {
            available: 0,
            x: 0,
            y: 0,
            width: 0,
            height: 0,
            ..unsafe { read(report) }?
        };
        let mut session = lock(&session)?;
        let reports = session.reports();
        if let Some(found) = reports.front() {
            let count = found.pixels.len();
            if count > capacity as usize {
                let what = format!("capacity: {capacity}; the report has {count} pixels");
                return Err(Failure::argument(what));
            }
            for (index, pixel) in found.pixels.iter().enumerate() {
                // SAFETY: room for `capacity` pixels, as the caller says.
                unsafe { pixels.add(index).write_unaligned(reported(pixel)) };
            }
            value = AshfallPickReport {
                available: 1,
                x: found.area.x,
                y: found.area.y,
                width: found.area.width,
                height: found.area.height,
                ..value
            };
            reports.pop_front();
        }
        // SAFETY: as the caller says.
        unsafe { write(report, &value) }
    })
}

fn reported(pixel: &PickPixel) -> AshfallPickPixel {
    let (instance, splat) = match pixel.splat {
        Some((instance, splat)) => (instance as u32, splat as u32),
        None => (NO_SPLAT, NO_SPLAT),
    };
    AshfallPickPixel {
        instance,
        splat,
        depth: pixel.depth,
        transmittance: pixel.transmittance,
    }
}
