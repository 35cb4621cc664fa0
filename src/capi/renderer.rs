//! Renderers of C: creation, memory, and recording into the host's commands.

use super::draw::{Canvas, Shot};
use super::failure::{AshfallResult, Failure, guard};
use super::memory::{check, optional, read, sized, store, write};
use super::picture::AshfallDraw;
use super::registry::{AshfallDevice, AshfallModel, AshfallRenderer, AshfallScene, LiveObject, find, insert, remove};
use super::scene::{AshfallPrecision, precision};
use super::session::{RendererSession, lock};
use crate::gpu::ash::vk::CommandBuffer as VkCommandBuffer;
use crate::render::{RenderOptions, Renderer, Stats, isects_expected};
use crate::scene::Projection;
use std::sync::{Arc, Mutex};

/// Flag of AshfallRendererInfo: for pictures behind the host's surfaces.
pub const ASHFALL_HOST_DEPTH: u32 = 1;
/// Flag of AshfallRendererInfo: for pictures over the host's pixels.
pub const ASHFALL_HOST_COLOR: u32 = 2;

/// Flag of AshfallRendererInfo: for splats and depths of pixels.
pub const ASHFALL_IDS: u32 = 4;

/// Flag of AshfallRendererInfo: for orthographic pictures, in which the focal lengths of AshfallCamera are pixels per
/// world unit.
pub const ASHFALL_ORTHOGRAPHIC: u32 = 8;

/// Flag of AshfallRendererInfo: for device times of the stages (ashfall_timings).
pub const ASHFALL_TIMINGS: u32 = 16;

/// Flag of AshfallRendererInfo: for expected depths (AshfallDraw.depth_out_expected).
pub const ASHFALL_EXPECTED_DEPTH: u32 = 32;

/// All flags of AshfallRendererInfo.
const FLAGS: u32 = ASHFALL_HOST_DEPTH
    | ASHFALL_HOST_COLOR
    | ASHFALL_IDS
    | ASHFALL_ORTHOGRAPHIC
    | ASHFALL_TIMINGS
    | ASHFALL_EXPECTED_DEPTH;
/// Frames in flight if the host does not say.
const IN_FLIGHT: u32 = 2;
/// Most frames in flight.
const IN_FLIGHT_MAX: u32 = 16;

/// Options of a renderer.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct AshfallRendererInfo {
    /// sizeof(AshfallRendererInfo).
    pub size: u32,
    /// Frames that may be in flight at once, up to 16; 0 for 2.
    pub frames_in_flight: u32,
    /// Storage precision of the models.
    pub precision: AshfallPrecision,
    /// ASHFALL_HOST_DEPTH, ASHFALL_HOST_COLOR, ASHFALL_IDS, ASHFALL_ORTHOGRAPHIC, ASHFALL_TIMINGS,
    /// ASHFALL_EXPECTED_DEPTH.
    pub flags: u32,
}

/// Statistics of the pictures of an earlier frame.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct AshfallReport {
    /// sizeof(AshfallReport).
    pub size: u32,
    /// 1 if a frame has been finished since the last report; else the other fields are 0.
    pub available: u32,
    /// (Splat, tile) pairs of the complete frame: the wanted capacity.
    pub pairs: u64,
    /// Capacity of the buffers in pairs; a frame with more is drawn in several passes.
    pub capacity: u64,
    /// Passes that were recorded.
    pub passes: u32,
    /// 1 for a complete picture, 0 if splats are missing.
    pub complete: u32,
    /// Splats not drawn because of a non-finite parameter.
    pub not_finite: u64,
}

sized!(AshfallRendererInfo, AshfallReport);

/// Creates a renderer. All its frames go to one queue, in the order of their recording.
///
/// # Safety
/// `info` is null, for the defaults, or valid for its size; `renderer` is null or valid for a write.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ashfall_renderer_create(
    device: *mut AshfallDevice,
    info: *const AshfallRendererInfo,
    renderer: *mut *mut AshfallRenderer,
) -> AshfallResult {
    guard(|| {
        check("renderer", renderer)?;
        let gpu = find(device)?;
        let mut options = RenderOptions {
            frames_in_flight: IN_FLIGHT as usize,
            ..RenderOptions::default()
        };
        // SAFETY: as the caller says.
        if let Some(info) = unsafe { optional(info) }? {
            let (frames, flags) = (info.frames_in_flight, info.flags);
            if frames > IN_FLIGHT_MAX {
                return Err(Failure::argument(format!(
                    "frames_in_flight: {frames}; up to {IN_FLIGHT_MAX}"
                )));
            }
            if flags & !FLAGS != 0 {
                return Err(Failure::argument(format!("flags: {flags:#x} has unknown ones")));
            }
            if frames > 0 {
                options.frames_in_flight = frames as usize;
            }
            options.precision = precision(info.precision)?;
            options.with_host_depth = flags & ASHFALL_HOST_DEPTH != 0;
            options.with_host_color = flags & ASHFALL_HOST_COLOR != 0;
            options.with_ids = flags & ASHFALL_IDS != 0;
            options.with_depth = flags & ASHFALL_EXPECTED_DEPTH != 0;
            options.with_timings = flags & ASHFALL_TIMINGS != 0;
            if flags & ASHFALL_ORTHOGRAPHIC != 0 {
                options.projection = Projection::Orthographic;
            }
        }
        let session = RendererSession::new(Renderer::new(&gpu, options)?);
        let object = LiveObject::Renderer(Arc::new(Mutex::new(session)));
        // SAFETY: checked above.
        unsafe { store("renderer", renderer, insert(object)) }
    })
}

/// Destroys a renderer; null is ignored. Its frames have run, or never will.
#[unsafe(no_mangle)]
pub extern "C" fn ashfall_renderer_destroy(renderer: *mut AshfallRenderer) -> AshfallResult {
    guard(|| remove(renderer))
}

/// Compiles the kernels and grows the buffers for pictures like `draw`, with up to `pairs` (splat, tile) pairs; 0 for
/// an estimate. Compiles and allocates: to be called outside of frames. The images of `draw` are not read.
///
/// # Safety
/// The pointers of `draw` are null or valid for their counts and sizes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ashfall_renderer_reserve(
    renderer: *mut AshfallRenderer,
    draw: *const AshfallDraw,
    pairs: u64,
) -> AshfallResult {
    guard(|| {
        let session = find(renderer)?;
        // SAFETY: as the caller says.
        let shot = unsafe { Shot::of(&read(draw)?) }?;
        let (instances, camera) = (shot.instances(), &shot.camera);
        let pairs = match pairs {
            0 => {
                let splats = instances.iter().map(|instance| instance.model.splat_count).sum();
                isects_expected(splats, camera.width, camera.height)
            }
            some => usize::try_from(some).unwrap_or(usize::MAX),
        };
        Ok(lock(&session)?
            .renderer()
            .reserve_instances(&instances, camera, pairs)?)
    })
}

/// Copies a scene to the device when the recorded commands run; pictures of the model may follow in the same commands.
/// `commands` and `frame` as of ashfall_cmd_draw.
///
/// # Safety
/// As ashfall_cmd_draw; `model` is null or valid for a write.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ashfall_cmd_upload(
    renderer: *mut AshfallRenderer,
    commands: VkCommandBuffer,
    frame: u64,
    scene: *mut AshfallScene,
    model: *mut *mut AshfallModel,
) -> AshfallResult {
    guard(|| {
        check("model", model)?;
        let (session, splats) = (find(renderer)?, find(scene)?);
        let mut session = lock(&session)?;
        // SAFETY: as the caller says.
        unsafe { session.begin(commands, frame) }?;
        let (renderer, commands) = session.parts()?;
        let uploaded = renderer.record_upload(commands, &splats)?;
        // SAFETY: checked above.
        unsafe { store("model", model, insert(LiveObject::Model(Arc::new(uploaded)))) }
    })
}

/// Records a picture into a host's command buffer: nothing is submitted or waited for.
///
/// `commands`: in the recording state, outside of a render pass, submitted once. `frame`: the host's number of the
/// frame; all recordings of one frame have the same number and commands. A frame's commands have run before as many
/// further frames as are in flight are recorded. `report`: receives the statistics of an earlier frame; null if not
/// wanted.
///
/// After ASHFALL_ERROR_ARGUMENT nothing is recorded. After other errors the commands can be submitted, and the images
/// are in their states after, with undefined contents; after ASHFALL_ERROR_INTERNAL the commands are to be dropped.
///
/// # Safety
/// The pointers of `draw` are null or valid for their counts and sizes; images and commands are as stated.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ashfall_cmd_draw(
    renderer: *mut AshfallRenderer,
    commands: VkCommandBuffer,
    frame: u64,
    draw: *const AshfallDraw,
    report: *mut AshfallReport,
) -> AshfallResult {
    guard(|| {
        let session = find(renderer)?;
        // SAFETY: as the caller says.
        let draw = unsafe { read(draw) }?;
        // SAFETY: as the caller says.
        let (shot, canvas) = unsafe { (Shot::of(&draw)?, Canvas::of(&draw)?) };
        if !report.is_null() {
            // SAFETY: as the caller says; refused before anything is recorded.
            unsafe { read(report.cast_const()) }?;
        }
        let mut session = lock(&session)?;
        // SAFETY: as the caller says.
        unsafe { session.begin(commands, frame) }?;
        let (renderer, commands) = session.parts()?;
        let (instances, options) = (shot.instances(), &canvas.options);
        let stats = renderer.record_instances(commands, &instances, &shot.camera, options, canvas.target())?;
        match report.is_null() {
            true => Ok(()),
            // SAFETY: read above.
            false => unsafe { write(report, &reported(stats)) },
        }
    })
}

fn reported(stats: Option<Stats>) -> AshfallReport {
    AshfallReport {
        size: 0,
        available: stats.is_some().into(),
        pairs: stats.map_or(0, |s| s.isects as u64),
        capacity: stats.map_or(0, |s| s.isect_capacity as u64),
        passes: stats.map_or(0, |s| s.bands),
        complete: stats.map_or(0, |s| s.complete.into()),
        not_finite: stats.and_then(|s| s.not_finite).map_or(0, |found| found.count as u64),
    }
}
