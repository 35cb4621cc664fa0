//! The short training into which failures are injected.

use ashfall::Result;
use ashfall::gpu::Gpu;
use ashfall::io::ply;
use ashfall::lab::synth::{self, Kind, SynthOptions};
use ashfall::scene::{Dataset, ScreenFilter};
use ashfall::train::checkpoint::{Checkpoint, fingerprint};
use ashfall::train::{TrainConfig, Trainer};
use std::path::Path;
use std::sync::OnceLock;

/// Steps: enough for a refinement and steps after it.
pub(crate) const STEPS: u32 = 5;

/// Four small photographs with points.
pub(crate) fn dataset() -> &'static Dataset {
    static DATASET: OnceLock<Dataset> = OnceLock::new();
    DATASET.get_or_init(|| {
        synth::scene(Kind::Solids).dataset(&SynthOptions {
            views: 4,
            width: 20,
            height: 15,
            samples: 1,
            points: 40,
            test_every: 0,
            ..SynthOptions::default()
        })
    })
}

fn config() -> TrainConfig {
    let mut config = TrainConfig::for_iterations(STEPS);
    config.sh_degree = 0;
    config.refine.from = 1;
    config.refine.every = 3;
    config
}

/// Trains to the end, from the folder's checkpoint if there is one, with a checkpoint after every step and the scene at
/// the end.
pub(crate) fn train(gpu: &Gpu, folder: &Path) -> Result<()> {
    train_with(gpu, folder, &mut |_| {})
}

/// [`train`] with a callback before each step's checkpoint is written.
pub(crate) fn train_with(gpu: &Gpu, folder: &Path, before: &mut dyn FnMut(u32)) -> Result<()> {
    let dataset = dataset();
    let path = folder.join("checkpoint");
    let mut trainer = match path.exists() {
        true => {
            let saved = Checkpoint::read(&path)?;
            let mut trainer = Trainer::from_state(gpu, dataset, saved.config, &saved.state, saved.iteration)?;
            trainer.set_statistics(&saved.statistics)?;
            trainer.set_pending_colors(&saved.colors)?;
            trainer
        }
        false => Trainer::new(gpu, dataset, config())?,
    };
    while !trainer.is_done() {
        trainer.step()?;
        let state = trainer.download()?;
        let checkpoint = Checkpoint {
            config: trainer.config().clone(),
            iteration: trainer.iteration(),
            state,
            statistics: trainer.statistics()?,
            colors: trainer.pending_colors()?,
            fingerprint: fingerprint(dataset),
            controller: None,
            exposure: None,
            poses: None,
            transients: None,
        };
        before(trainer.iteration());
        checkpoint.write(&path)?;
    }
    let splats = trainer.download()?.to_splats(ScreenFilter::Classic);
    ply::write(&folder.join("scene.ply"), &splats)
}

/// The scene file of an undisturbed run.
pub(crate) fn undisturbed(gpu: &Gpu) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    train(gpu, folder.path()).unwrap();
    scene(folder.path())
}

pub(crate) fn scene(folder: &Path) -> Vec<u8> {
    std::fs::read(folder.join("scene.ply")).unwrap()
}

/// Asserts that a folder holds only complete files of these names.
#[track_caller]
pub(crate) fn holds_only(folder: &Path, names: &[&str]) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        assert!(names.contains(&name.as_str()), "{name} was left behind");
    }
}
