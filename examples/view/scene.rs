//! The scene, and the cameras and photographs to compare it with.

use ashfall::io::dataset::OpenOptions;
use ashfall::scene::{Photo, PhotoSource, focus};
use ashfall::{Camera, Dataset, Splats, io, open_dataset, read_splats};
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

pub(crate) struct Scene {
    pub(crate) path: PathBuf,
    changed: Option<SystemTime>,
    pub(crate) splats: Splats,
    /// Middle of the splats, and the distance that nine of ten keep from it.
    pub(crate) center: DVec3,
    pub(crate) radius: f64,
}

impl Scene {
    pub(crate) fn read(path: &Path) -> ashfall::Result<Scene> {
        let changed = changed(path);
        let loaded = read_splats(path)?;
        for warning in &loaded.warnings {
            eprintln!("warning: {warning}");
        }
        let splats = loaded.splats;
        let nine_tenths = |mut values: Vec<f64>, share: usize| {
            values.sort_by(f64::total_cmp);
            values.get(values.len() * share / 10).copied().unwrap_or(1.0)
        };
        let axis = |axis: usize| nine_tenths(splats.mean.iter().map(|mean| mean[axis].into()).collect(), 5);
        let center = DVec3::new(axis(0), axis(1), axis(2));
        let away = |mean: &[f32; 3]| DVec3::from(mean.map(f64::from)).distance(center);
        let radius = nine_tenths(splats.mean.iter().map(away).collect(), 9);
        Ok(Scene {
            path: path.to_owned(),
            changed,
            center,
            radius: radius.max(1e-6),
            splats,
        })
    }

    /// True if the file has been written or removed since this was last asked.
    pub(crate) fn is_old(&mut self) -> bool {
        let now = changed(&self.path);
        std::mem::replace(&mut self.changed, now) != now
    }

    /// Upward direction; most captures have y down.
    pub(crate) fn up(&self) -> DVec3 {
        self.splats.up.and_then(DVec3::try_normalize).unwrap_or(DVec3::NEG_Y)
    }
}

fn changed(path: &Path) -> Option<SystemTime> {
    std::fs::metadata(path).and_then(|meta| meta.modified()).ok()
}

/// Cameras of a data set.
pub(crate) struct Visits {
    dataset: Dataset,
    pub(crate) focus: Option<DVec3>,
}

impl Visits {
    pub(crate) fn open(path: &Path, origin: DVec3) -> ashfall::Result<Visits> {
        let options = OpenOptions {
            photos_required: false,
            ..OpenOptions::default()
        };
        let mut dataset = open_dataset(path, &options)?;
        dataset.set_origin(origin);
        let cameras: Vec<Camera> = dataset.views.iter().map(|view| view.camera).collect();
        Ok(Visits {
            focus: focus(&cameras),
            dataset,
        })
    }

    pub(crate) fn set_origin(&mut self, origin: DVec3) {
        let by = self.dataset.origin - origin;
        self.focus = self.focus.map(|focus| focus + by);
        self.dataset.set_origin(origin);
    }

    pub(crate) fn len(&self) -> usize {
        self.dataset.views.len()
    }

    pub(crate) fn extent(&self) -> f64 {
        self.dataset.extent()
    }

    pub(crate) fn camera(&self, index: usize) -> Camera {
        self.dataset.views[index].camera
    }

    pub(crate) fn name(&self, index: usize) -> &str {
        &self.dataset.views[index].name
    }

    /// The photograph at its camera's size; `None` for a camera without one.
    pub(crate) fn photo(&self, index: usize) -> ashfall::Result<Option<Photo>> {
        match &self.dataset.views[index] {
            view if view.photo == PhotoSource::Absent => Ok(None),
            view => io::photo::load(view).map(Some),
        }
    }
}
