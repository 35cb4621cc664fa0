//! The device as the commands see it: opened by options, drawing pictures, training.
//!
//! All that the commands ask of `gpu`, `render` and `train`'s device side stands here, so that they can
//! be read, and tested, without it.

use super::args::DeviceArgs;
use crate::scene::{Camera, Dataset, Splats};
use crate::train::TrainConfig;
use crate::{Error, Result};
use std::path::Path;

/// An opened device.
pub(super) struct Engine {}

/// A rendering, `[row][column]`.
pub(super) struct Picture {
    pub width: u32,
    pub height: u32,
    /// Display-referred, over the background.
    pub rgb: Vec<[f32; 3]>,
    /// Coverage, 0 to 1.
    pub alpha: Vec<f32>,
    /// Along the view's z axis, world units.
    pub depth: Vec<f32>,
}

impl Engine {
    /// Opens the device that the options ask for.
    pub(crate) fn open(args: &DeviceArgs) -> Result<Engine> {
        _ = (args.name(), args.memory_limit, args.validate);
        Err(Error::Unsupported {
            what: "no device".into(),
        })
    }

    /// The device's name.
    pub(crate) fn name(&self) -> String {
        String::new()
    }

    /// Whether the device is a program on the CPU.
    pub(crate) fn is_software(&self) -> bool {
        true
    }

    /// Most bytes of device memory held at one time.
    pub(crate) fn memory_peak_bytes(&self) -> u64 {
        0
    }

    /// The validation layer's messages, if any, as an error.
    pub(crate) fn check(&self) -> Result<()> {
        Ok(())
    }

    /// What the device is and can do, and what was chosen for it: text, and the same for machines.
    pub(crate) fn describe(&self) -> (String, serde_json::Value) {
        (String::new(), serde_json::Value::Null)
    }

    /// Brings a scene to the device to be drawn; nothing nearer than `near` world units is.
    pub(crate) fn artist(&self, splats: &Splats, near: f64) -> Result<Artist> {
        _ = (splats, near);
        Ok(Artist {})
    }

    /// Begins training.
    pub(crate) fn train(&self, dataset: &Dataset, config: TrainConfig) -> Result<Training> {
        _ = (dataset, config);
        Ok(Training {})
    }

    /// Goes on training from a checkpoint.
    pub(crate) fn resume(&self, dataset: &Dataset, checkpoint: &Path) -> Result<Training> {
        _ = (dataset, checkpoint);
        Ok(Training {})
    }
}

/// All devices there are: text, and the same for machines.
pub(super) fn devices() -> Result<(String, serde_json::Value)> {
    Ok((String::new(), serde_json::Value::Null))
}

/// A scene on the device, ready to be drawn.
pub(super) struct Artist {}

impl Artist {
    /// Draws a view.
    pub(crate) fn draw(&mut self, camera: &Camera, background: [f32; 3]) -> Result<Picture> {
        _ = (camera, background);
        Err(Error::Unsupported {
            what: "no device".into(),
        })
    }
}

/// A training run on the device.
pub(super) struct Training {}

impl Training {
    /// The run's constants.
    pub(crate) fn config(&self) -> &TrainConfig {
        unreachable!()
    }
}

impl super::train::Steps for Training {
    fn iteration(&self) -> u32 {
        0
    }

    fn step(&mut self) -> Result<Vec<super::train::StepFigures>> {
        Ok(vec![])
    }

    fn finish(&mut self) -> Result<Vec<super::train::StepFigures>> {
        Ok(vec![])
    }

    fn splats(&mut self) -> Result<Splats> {
        Ok(Splats::default())
    }

    fn checkpoint(&mut self, path: &Path) -> Result<()> {
        _ = path;
        Ok(())
    }
}
