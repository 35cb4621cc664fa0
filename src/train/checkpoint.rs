//! Checkpoint of a run: its whole state, so that a resumed run equals the uninterrupted one.
//!
//! Random numbers have no state: they are a function of (seed, iteration). Photographs are not stored, but a
//! fingerprint of the views is, because other data would make another run.

use super::colors::PendingColors;
use super::config::{ExposureModel, TrainConfig};
use super::exposure::ExposureGains;
use super::poses::PoseState;
use super::state::{HostState, Planes};
use super::strategy::SplatStats;
use super::transients::TransientState;
use crate::io::Source;
use crate::io::checkpoint::{self, Section};
use crate::layout::COLOR_STEPS;
use crate::render::plane_count;
use crate::scene::{Dataset, Split};
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::Path;

/// A run between two steps.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// Constants of the run.
    pub config: TrainConfig,
    /// Steps done.
    pub iteration: u32,
    /// Parameters and moments.
    pub state: HostState,
    /// Statistics of density control since the last refinement, one per splat.
    pub statistics: Vec<SplatStats>,
    /// Gradients of colours that wait for an update of the harmonics.
    pub colors: PendingColors,
    /// [`fingerprint`] of the data set trained on.
    pub fingerprint: u32,
    /// State of the run's controller, if any.
    pub controller: Option<ControllerState>,
    /// Exposures of the photographs, if the run has them.
    pub exposure: Option<ExposureGains>,
    /// Poses of the photographs, if the run refines them.
    pub poses: Option<PoseState>,
    /// Patches of the photographs that are left out, if the run ignores transients.
    pub transients: Option<TransientState>,
}

/// State of a [`Controller`](super::Controller) between two steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControllerState {
    /// [`Controller::NAME`](super::Controller::NAME).
    pub name: String,
    /// [`Controller::VERSION`](super::Controller::VERSION) of the program that wrote it.
    pub version: u32,
    /// [`Controller::State`](super::Controller::State) as JSON.
    #[serde(default)]
    pub state: serde_json::Value,
    /// Second scene state that the run may go back to.
    #[serde(skip)]
    pub kept: Option<HostState>,
}

/// Name and version of the controller in checkpoints from before these were written.
const UNNAMED: (&str, u32) = ("count", 1);

/// A checksum of a data set's training views: names, sizes and poses, in their order.
pub fn fingerprint(dataset: &Dataset) -> u32 {
    let mut hash = crc32fast::Hasher::new();
    for index in dataset.split(Split::Train) {
        let view = &dataset.views[index];
        let camera = &view.camera;
        hash.update(view.name.as_bytes());
        hash.update(bytemuck::bytes_of(&[camera.width, camera.height]));
        hash.update(bytemuck::bytes_of(&camera.focal.to_array()));
        hash.update(bytemuck::bytes_of(&camera.center.to_array()));
        hash.update(bytemuck::bytes_of(&camera.rotation.to_cols_array()));
        hash.update(bytemuck::bytes_of(&camera.position.to_array()));
    }
    hash.finalize()
}

impl Checkpoint {
    /// Writes the file atomically.
    pub fn write(&self, path: &Path) -> Result<()> {
        assert_eq!(self.statistics.len(), self.state.len(), "one statistic per splat");
        let mut meta = json!({
            "kind": "training",
            "config": self.config,
            "iteration": self.iteration,
            "splat_count": self.state.len(),
            "fingerprint": self.fingerprint,
            "controller": self.controller,
            "kept_count": self.kept().map(HostState::len),
        });
        if let Some(exposure) = &self.exposure {
            meta["exposure"] = json!(exposure);
        }
        if let Some(poses) = &self.poses {
            meta["poses"] = json!(poses);
        }
        let [params, m, v] = numbers(&self.state);
        let mut sections = vec![
            Section::new("degrees", &self.state.degrees),
            Section::new("params", &params),
            Section::new("m", &m),
            Section::new("v", &v),
            Section::new("statistics", self.statistics.as_flattened()),
        ];
        if !self.colors.positions.is_empty() {
            let PendingColors { positions, gradients } = &self.colors;
            meta["pending_colors"] = json!(positions.len());
            sections.push(Section::new("color positions", positions.as_flattened()));
            sections.push(Section::new("color gradients", gradients.as_flattened()));
        }
        if let Some(TransientState {
            scores,
            ignored,
            visits,
        }) = &self.transients
        {
            sections.push(Section::new("patch scores", scores));
            sections.push(Section::new("patches ignored", ignored));
            sections.push(Section::new("patch visits", visits));
        }
        let kept = self.kept().map(numbers);
        if let (Some(kept), Some([params, m, v])) = (self.kept(), &kept) {
            sections.push(Section::new("kept degrees", &kept.degrees));
            sections.push(Section::new("kept params", params));
            sections.push(Section::new("kept m", m));
            sections.push(Section::new("kept v", v));
        }
        checkpoint::write(path, &meta, &sections)
    }

    fn kept(&self) -> Option<&HostState> {
        self.controller.as_ref()?.kept.as_ref()
    }

    /// Reads a file and checks that its parts fit together.
    pub fn read<'a>(source: impl Into<Source<'a>>) -> Result<Checkpoint> {
        let source = source.into();
        let path = source.name();
        let file = checkpoint::Checkpoint::open(source)?;
        let fault = |what: &str| Error::file(path, format!("is no training checkpoint: {what}"));
        let meta = file.meta();
        let number = |name: &str| {
            let value = meta.get(name).and_then(|value| value.as_u64());
            let value = value.and_then(|value| u32::try_from(value).ok());
            value.ok_or_else(|| fault(&format!("{name} is missing from its header")))
        };
        let config = meta.get("config").cloned().unwrap_or_default();
        let config =
            TrainConfig::from_saved(config).map_err(|e| fault(&format!("the configuration cannot be read: {e}")))?;
        config.validate().map_err(|e| fault(&e.to_string()))?;
        let count = number("splat_count")? as usize;
        let iteration = number("iteration")?;
        if iteration > config.iterations {
            return Err(fault("it is beyond its own end"));
        }
        let planes = |name: &str, count: usize| {
            let numbers = file.read::<f32>(name)?;
            unflat(&numbers, plane_count(config.sh_degree), count)
                .ok_or_else(|| fault(&format!("{name} has not {count} splats")))
        };
        let state = |prefix: &str, count: usize| -> Result<HostState> {
            let degrees = file.read::<u8>(&format!("{prefix}degrees"))?;
            let is_below = degrees.iter().all(|&d| u32::from(d) <= config.sh_degree);
            if degrees.len() != count || !is_below {
                let most = config.sh_degree;
                return Err(fault(&format!("{prefix}degrees are not {count} of at most {most}")));
            }
            let planes = |name: &str| planes(&format!("{prefix}{name}"), count);
            Ok(HostState {
                primitive: config.kind,
                sh_degree: config.sh_degree,
                degrees,
                params: planes("params")?,
                m: planes("m")?,
                v: planes("v")?,
            })
        };
        let present = |name: &str| meta.get(name).filter(|value| !value.is_null());
        let kept = present("kept_count").map(|_| state("kept ", number("kept_count")? as usize));
        let kept = kept.transpose()?;
        let controller = controller(meta, kept).map_err(|what| fault(&what))?;
        let exposure = exposure(meta, config.exposure).map_err(fault)?;
        let poses = poses(meta, config.refine_poses).map_err(fault)?;
        let transients = config.ignore_transients.then(|| transients(&file)).transpose()?;
        let state = state("", count)?;
        let waiting = present("pending_colors").map_or(Ok(0), |_| number("pending_colors"))?;
        let colors = colors(&file, waiting.min(iteration), count).map_err(|what| fault(&what))?;
        let statistics = file.read::<f32>("statistics")?;
        if statistics.len() != count * 4 {
            return Err(fault(&format!("statistics has not {count} splats")));
        }
        Ok(Checkpoint {
            config,
            iteration,
            state,
            statistics: bytemuck::cast_slice(&statistics).to_vec(),
            colors,
            fingerprint: number("fingerprint")?,
            controller,
            exposure,
            poses,
            transients,
        })
    }

    /// Refuses a data set with other views than the run's.
    pub fn check_dataset(&self, path: &Path, dataset: &Dataset) -> Result<()> {
        let views = dataset.split(Split::Train).len();
        let fits = self.exposure.as_ref().is_none_or(|gains| gains.log_gain.len() == views);
        if fits && self.fingerprint == fingerprint(dataset) {
            return Ok(());
        }
        let what = "the data set's training views are not those that this run was begun with";
        Err(Error::file(path, what))
    }
}

/// Exposures in a header, of a run with this model.
fn exposure(
    meta: &serde_json::Value,
    model: ExposureModel,
) -> std::result::Result<Option<ExposureGains>, &'static str> {
    let gains = meta.get("exposure").map(ExposureGains::deserialize).transpose();
    let gains = gains.map_err(|_| "its exposures cannot be read")?;
    let is_whole = |gains: &ExposureGains| {
        let numbers = gains.log_gain.iter().flatten();
        let mut numbers = numbers.chain(gains.sums.iter().flatten().flatten());
        let count = gains.log_gain.len();
        count == gains.sums.len() && count == gains.tracked.len() && numbers.all(|number| number.is_finite())
    };
    if (model == ExposureModel::Off) != gains.is_none() || !gains.iter().all(is_whole) {
        return Err("its exposures do not fit its configuration");
    }
    Ok(gains)
}

/// Poses in a header, of a run that refines them or not.
fn poses(meta: &serde_json::Value, refines: bool) -> std::result::Result<Option<PoseState>, &'static str> {
    let poses = meta.get("poses").map(PoseState::deserialize).transpose();
    let poses = poses.map_err(|_| "its poses cannot be read")?;
    if refines != poses.is_some() || !poses.iter().all(PoseState::is_whole) {
        return Err("its poses do not fit its configuration");
    }
    Ok(poses)
}

/// Gradients of colours of so many steps.
fn colors(file: &checkpoint::Checkpoint<'_>, steps: u32, splats: usize) -> std::result::Result<PendingColors, String> {
    if steps == 0 {
        return Ok(PendingColors::default());
    }
    let numbers = |name: &str| file.read::<f32>(name).map_err(|e| e.to_string());
    let threes = |name: &str| Ok::<_, String>(numbers(name)?.as_chunks().0.to_vec());
    let (positions, gradients) = (threes("color positions")?, threes("color gradients")?);
    let fits = steps <= COLOR_STEPS && positions.len() == steps as usize;
    if !fits || gradients.len() != positions.len() * splats {
        return Err(format!(
            "the gradients of its colours are not {steps} steps of {splats} splats"
        ));
    }
    Ok(PendingColors { positions, gradients })
}

/// Patches of a run that ignores transients.
fn transients(file: &checkpoint::Checkpoint<'_>) -> Result<TransientState> {
    Ok(TransientState {
        scores: file.read("patch scores")?,
        ignored: file.read("patches ignored")?,
        visits: file.read("patch visits")?,
    })
}

/// Controller state in a header, of this version or an earlier one.
fn controller(
    meta: &serde_json::Value,
    kept: Option<HostState>,
) -> std::result::Result<Option<ControllerState>, String> {
    let present = |name: &str| meta.get(name).filter(|value| !value.is_null());
    let saved = match (present("controller"), present("steering")) {
        // An array of the right values would be taken for the fields in order.
        (Some(saved), _) => match ControllerState::deserialize(saved) {
            Ok(state) if saved.is_object() => state,
            _ => return Err("its controller has no name or no version".into()),
        },
        (None, Some(state)) => ControllerState {
            name: UNNAMED.0.into(),
            version: UNNAMED.1,
            state: state.clone(),
            kept: None,
        },
        (None, None) => return Ok(None),
    };
    Ok(Some(ControllerState { kept, ..saved }))
}

/// A state's parameters and moments, flattened.
fn numbers(state: &HostState) -> [Vec<f32>; 3] {
    let flat = |planes: &Planes| planes.iter().flat_map(|plane| plane.as_flattened()).copied().collect();
    [&state.params, &state.m, &state.v].map(flat)
}

/// `None` if the numbers are not exactly `plane_count * count * 4`.
fn unflat(numbers: &[f32], plane_count: usize, count: usize) -> Option<Planes> {
    if numbers.len() != plane_count.checked_mul(count)?.checked_mul(4)? {
        return None;
    }
    let rows: &[[f32; 4]] = bytemuck::cast_slice(numbers);
    let planes = (0..plane_count).map(|plane| rows[plane * count..][..count].to_vec());
    Some(planes.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{PhotoSource, View};
    use crate::train::test_camera;

    fn checkpoint(count: usize, sh_degree: u32) -> Checkpoint {
        let mut config = TrainConfig::for_iterations(100);
        config.sh_degree = sh_degree;
        let mut state = HostState::zeros(count, sh_degree);
        let degrees = (0..=sh_degree as u8).cycle();
        state.degrees = degrees.take(count).collect();
        let planes = state.params.iter_mut().chain(&mut state.m).chain(&mut state.v);
        for (i, number) in planes.flatten().flatten().enumerate() {
            *number = (i as f32).sin();
        }
        Checkpoint {
            config,
            iteration: 37,
            state,
            statistics: (0..count).map(|i| [i as f32, 1.0, 2.0, 0.0]).collect(),
            colors: PendingColors::default(),
            fingerprint: 5,
            controller: None,
            exposure: None,
            poses: None,
            transients: None,
        }
    }

    #[test]
    fn a_run_comes_back_to_the_bit() -> Result<()> {
        let dir = tempfile::tempdir().map_err(Error::io("."))?;
        let path = dir.path().join("checkpoint");
        for (count, degree) in [(0, 0), (1, 1), (9, 3)] {
            let mut saved = checkpoint(count, degree);
            if degree == 3 {
                saved.config.exposure = ExposureModel::Gain;
                let mut gains = ExposureGains::of(vec![Some([0.1, -0.2, 1.0 / 3.0]), None]);
                gains.sums[1][0][2] = 2.0_f64.sqrt();
                saved.exposure = Some(gains);
                saved.config.ignore_transients = true;
                saved.transients = Some(TransientState {
                    scores: vec![0.1, -1.0],
                    ignored: vec![2],
                    visits: vec![3],
                });
                saved.colors = PendingColors {
                    positions: vec![[1.0, 2.0, 3.0], [0.5, 0.0, -1.0]],
                    gradients: (0..18).map(|i| [i as f32, 0.25, -1.0]).collect(),
                };
            }
            saved.write(&path)?;
            assert_eq!(Checkpoint::read(&path)?, saved);
        }
        Ok(())
    }

    #[test]
    fn a_file_cut_anywhere_is_an_error() -> Result<()> {
        let dir = tempfile::tempdir().map_err(Error::io("."))?;
        let path = dir.path().join("checkpoint");
        let mut lacking = checkpoint(3, 0);
        lacking.config.ignore_transients = true;
        lacking.write(&path)?;
        let message = Checkpoint::read(&path).err().map(|e| e.to_string());
        assert!(message.is_some_and(|m| m.contains("patch scores")));
        let mut lacking = checkpoint(3, 0);
        lacking.colors.positions = vec![[0.0; 3]];
        lacking.write(&path)?;
        let message = Checkpoint::read(&path).err().map(|e| e.to_string());
        assert!(message.is_some_and(|m| m.ends_with("colours are not 1 steps of 3 splats")));
        checkpoint(3, 0).write(&path)?;
        let bytes = std::fs::read(&path).map_err(Error::io(&path))?;
        for length in (0..bytes.len()).step_by(17) {
            std::fs::write(&path, &bytes[..length]).map_err(Error::io(&path))?;
            assert!(Checkpoint::read(&path).is_err(), "{length}");
        }
        let mut longer = checkpoint(3, 0);
        longer.config.sh_degree = 2;
        longer.write(&path)?;
        let message = Checkpoint::read(&path).err().map(|e| e.to_string());
        assert!(message.is_some_and(|m| m.ends_with("params has not 3 splats")));
        Ok(())
    }

    #[test]
    fn a_controller_has_a_name_and_a_version() {
        let read = |saved| controller(&json!({ "controller": saved }), None);
        let saved = read(json!({ "name": "count", "version": 2, "state": 7 }))
            .ok()
            .flatten();
        assert!(saved.is_some_and(|saved| saved.name == "count" && saved.version == 2 && saved.state == 7));
        assert_eq!(read(json!(null)), Ok(None));
        for damaged in [
            json!(["count", 2, 7]),
            json!({ "name": "count" }),
            json!({ "version": 2 }),
            json!(1),
        ] {
            assert!(read(damaged).is_err());
        }
    }

    #[test]
    fn another_camera_is_another_run() {
        let view = |name: &str| View {
            name: name.into(),
            camera: test_camera(8, 6, 7.0),
            photo: PhotoSource::Absent,
        };
        let mut dataset = Dataset {
            views: vec![view("a"), view("b")],
            ..Dataset::default()
        };
        let mut saved = checkpoint(1, 0);
        saved.fingerprint = fingerprint(&dataset);
        let path = Path::new("checkpoint");
        assert!(saved.check_dataset(path, &dataset).is_ok());
        dataset.views[1].camera.position.x = 1e-9;
        assert!(saved.check_dataset(path, &dataset).is_err());
    }
}
