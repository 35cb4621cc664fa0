//! C interface: opaque handles, structures with sizes, results with messages.
//!
//! `include/ashfall.h` is generated from these files and compared with them by `tests/host/header.rs`. Handles are
//! numbers in a registry and never dereferenced, so that destroyed and foreign ones are refused. Panics become results.
//!
//! **Invariant:** no rendering here; every function converts its arguments and calls the Rust interface.
//!
#![doc = include_str!("../../docs/c.md")]
#![allow(
    unsafe_code,
    reason = "pointers of C are read and written; nothing else is unsafe in here"
)]

mod device;
mod draw;
mod failure;
mod memory;
mod picks;
mod picture;
mod projection;
mod registry;
mod renderer;
mod scene;
mod session;
mod timings;

pub use device::{
    ASHFALL_DEBUG_UTILS, ASHFALL_HEADER_VERSION, ASHFALL_MEMORY_BUDGET, AshfallDeviceInfo, AshfallMissing,
    PFN_vkGetInstanceProcAddr, ashfall_adopt, ashfall_device_destroy, ashfall_enable_features, ashfall_version,
};
pub use failure::{
    ASHFALL_ERROR_ARGUMENT, ASHFALL_ERROR_CONFIG, ASHFALL_ERROR_FILE, ASHFALL_ERROR_INTERNAL, ASHFALL_ERROR_MEMORY,
    ASHFALL_ERROR_UNSUPPORTED, ASHFALL_ERROR_VULKAN, ASHFALL_OK, AshfallResult, ashfall_last_error,
};
pub use picks::{ASHFALL_NO_SPLAT, AshfallPickPixel, AshfallPickReport, ashfall_take_pick};
pub use picture::{
    ASHFALL_BLEND_OVER_DISPLAY, ASHFALL_BLEND_OVER_LINEAR, ASHFALL_BLEND_PREMULTIPLIED, ASHFALL_BLEND_REPLACE,
    AshfallBlend, AshfallCamera, AshfallClip, AshfallDepth, AshfallDraw, AshfallImage, AshfallInstance,
    AshfallPickArea, AshfallState,
};
pub use projection::{
    ashfall_camera_from_matrix, ashfall_camera_from_orthographic, ashfall_depth_from_orthographic,
    ashfall_depth_from_projection,
};
pub use registry::{AshfallDevice, AshfallModel, AshfallRenderer, AshfallScene};
pub use renderer::{
    ASHFALL_EXPECTED_DEPTH, ASHFALL_HOST_COLOR, ASHFALL_HOST_DEPTH, ASHFALL_IDS, ASHFALL_ORTHOGRAPHIC, ASHFALL_TIMINGS,
    AshfallRendererInfo, AshfallReport, ashfall_cmd_draw, ashfall_cmd_upload, ashfall_renderer_create,
    ashfall_renderer_destroy, ashfall_renderer_reserve,
};
pub use scene::{
    ASHFALL_FILTER_CLASSIC, ASHFALL_FILTER_MIP, ASHFALL_PRECISION_FULL, ASHFALL_PRECISION_HALF,
    ASHFALL_PRECISION_HALF_HARMONICS, AshfallArrays, AshfallFilter, AshfallPrecision, AshfallSceneInfo,
    ashfall_model_destroy, ashfall_model_upload, ashfall_scene_destroy, ashfall_scene_from_arrays, ashfall_scene_info,
    ashfall_scene_read,
};
pub use timings::{AshfallStageTime, ashfall_timings};
