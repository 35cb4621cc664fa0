//! Pictures that a folder has already: a log of the frames that were written, and of all that decides their pixels.
//!
//! A line of `frames.log` is the name of a file and the digest of its picture: program version, device, scene, options,
//! camera. A picture is kept if its last line has the digest that drawing it would log, so that an interrupted sequence
//! goes on where it stopped, and another scene or option replaces every picture. Files are renamed into place whole.

use crate::scene::{Camera, Splats};
use crate::{Error, Result};
use std::collections::HashMap;
use std::fs::OpenOptions;
use std::hash::{DefaultHasher, Hasher};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Name of the log in the folder.
const LOG: &str = "frames.log";

/// Files that are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reuse {
    /// Those of the same picture.
    Equal,
    /// All that exist.
    Existing,
    Nothing,
}

/// Log of a folder.
pub(super) struct FrameLog<'a> {
    dir: &'a Path,
    reuse: Reuse,
    known: HashMap<String, u64>,
}

impl<'a> FrameLog<'a> {
    /// Reads the log, if there is one. Lines of another form are passed over.
    pub(super) fn open(dir: &'a Path, reuse: Reuse) -> FrameLog<'a> {
        let text = std::fs::read_to_string(dir.join(LOG)).unwrap_or_default();
        let entry = |line: &str| {
            let (digest, name) = line.split_once(' ')?;
            Some((name.to_owned(), u64::from_str_radix(digest, 16).ok()?))
        };
        FrameLog {
            dir,
            reuse,
            known: text.lines().filter_map(entry).collect(),
        }
    }

    /// Path of a picture.
    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.dir.join(name)
    }

    /// Whether a picture is there and kept.
    pub(super) fn keeps(&self, name: &str, digest: u64) -> bool {
        let is_wanted = match self.reuse {
            Reuse::Nothing => false,
            Reuse::Existing => true,
            Reuse::Equal => self.known.get(name) == Some(&digest),
        };
        is_wanted && self.path(name).is_file()
    }

    /// Adds a picture that was written.
    pub(super) fn add(&self, name: &str, digest: u64) -> Result<()> {
        let path = self.dir.join(LOG);
        let file = OpenOptions::new().create(true).append(true).open(&path);
        // One write a line: several programs may add to one log.
        file.and_then(|mut file| file.write_all(format!("{digest:016x} {name}\n").as_bytes()))
            .map_err(Error::io(&path))
    }
}

/// Digest of all that decides a sequence of pictures but their cameras: the scene, and options as text.
pub(super) struct JobDigest(DefaultHasher);

impl JobDigest {
    pub(super) fn new(splats: &Splats, options: &str) -> JobDigest {
        let mut hasher = DefaultHasher::new();
        hasher.write(env!("CARGO_PKG_VERSION").as_bytes());
        hasher.write(options.as_bytes());
        hasher.write(format!("{:?}{:?}{}", splats.primitive, splats.filter, splats.sh_degree).as_bytes());
        hasher.write(bytemuck::cast_slice(&splats.mean));
        hasher.write(bytemuck::cast_slice(&splats.quaternion));
        hasher.write(bytemuck::cast_slice(&splats.log_scale));
        hasher.write(bytemuck::cast_slice(&splats.opacity_logit));
        hasher.write(bytemuck::cast_slice(&splats.sh));
        JobDigest(hasher)
    }

    /// Digest of the picture of a camera.
    pub(super) fn of(&self, camera: &Camera) -> u64 {
        let mut hasher = self.0.clone();
        // Numbers as text are exact.
        hasher.write(format!("{camera:?}").as_bytes());
        hasher.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec2, DVec3};

    #[test]
    fn only_equal_pictures_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let dir = folder.path();
        std::fs::write(dir.join("a.png"), "").unwrap();
        std::fs::write(dir.join("b.png"), "").unwrap();
        let log = FrameLog::open(dir, Reuse::Equal);
        assert!(!log.keeps("a.png", 7), "no log");
        log.add("a.png", 5).unwrap();
        log.add("a.png", 7).unwrap();
        log.add("gone.png", 7).unwrap();
        std::fs::OpenOptions::new()
            .append(true)
            .open(dir.join(LOG))
            .and_then(|mut file| file.write_all(b"no line of this program\n0000"))
            .unwrap();
        let keeps = |reuse, name: &str, digest| FrameLog::open(dir, reuse).keeps(name, digest);
        assert!(keeps(Reuse::Equal, "a.png", 7));
        assert!(!keeps(Reuse::Equal, "a.png", 5), "the last line counts");
        assert!(!keeps(Reuse::Equal, "b.png", 7) && !keeps(Reuse::Equal, "gone.png", 7));
        assert!(keeps(Reuse::Existing, "b.png", 7) && !keeps(Reuse::Existing, "gone.png", 7));
        assert!(!keeps(Reuse::Nothing, "a.png", 7));
    }

    #[test]
    fn digests_depend_on_scene_options_and_camera() {
        let splats = Splats {
            mean: vec![[1.0; 3]],
            ..Splats::default()
        };
        let camera = Camera {
            width: 4,
            height: 3,
            focal: DVec2::ONE,
            center: DVec2::ONE,
            rotation: DMat3::IDENTITY,
            position: DVec3::ZERO,
        };
        let of = |splats: &Splats, options: &str, camera: &Camera| JobDigest::new(splats, options).of(camera);
        let first = of(&splats, "a", &camera);
        assert_eq!(first, of(&splats, "a", &camera));
        assert_ne!(first, of(&splats, "b", &camera));
        let mut other = splats.clone();
        other.mean[0][1] = 1.0 + f32::EPSILON;
        assert_ne!(first, of(&other, "a", &camera));
        let moved = Camera {
            position: DVec3::new(0.0, 0.0, 1e-300),
            ..camera
        };
        assert_ne!(first, of(&splats, "a", &moved));
    }
}
