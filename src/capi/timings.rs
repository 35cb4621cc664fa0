//! Device times of pictures.

use super::failure::{AshfallResult, guard};
use super::memory::check;
use super::registry::{AshfallRenderer, find};
use super::session::lock;
use std::ffi::c_char;

/// Device time of a stage.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct AshfallStageTime {
    /// Name of the stage, ending with 0: project, sort_depth, expand, sort_tile, rasterize, present; between for the
    /// host's commands between two pictures; and others.
    pub name: [c_char; 24],
    /// Nanoseconds.
    pub nanoseconds: f64,
}

/// Stages of the pictures of the last frame that ashfall_cmd_draw has reported; for renderers with ASHFALL_TIMINGS.
///
/// `times`: receives the stages, up to `*count`; null to ask for their number. `count`: receives their number, 0 on
/// devices without timestamps.
///
/// # Safety
/// `times` is null or valid for writes of `*count` elements, `count` is null or valid for a write.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ashfall_timings(
    renderer: *mut AshfallRenderer,
    times: *mut AshfallStageTime,
    count: *mut u32,
) -> AshfallResult {
    guard(|| {
        check("count", count)?;
        let session = find(renderer)?;
        let mut session = lock(&session)?;
        let stages = session.renderer().host_timings();
        // SAFETY: not null.
        let room = unsafe { count.replace(stages.len() as u32) };
        if times.is_null() {
            return Ok(());
        }
        for (at, &(label, nanoseconds)) in stages.iter().enumerate().take(room as usize) {
            let mut name = [0; 24];
            let characters = label.bytes().take(name.len() - 1);
            name.iter_mut()
                .zip(characters)
                .for_each(|(to, from)| *to = from as c_char);
            // SAFETY: within the array's room.
            unsafe { times.add(at).write_unaligned(AshfallStageTime { name, nanoseconds }) };
        }
        Ok(())
    })
}
