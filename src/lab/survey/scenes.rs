//! Built-in scenes of a survey, and checksums of data sets.

use crate::lab::synth::{self, Kind, SynthOptions};
use crate::scene::Dataset;
use crate::train::checkpoint::fingerprint;

/// Photographs of a built-in scene.
const VIEWS: usize = 48;

/// A built-in scene in photographs of this width and three quarters of it in height; every eighth is held out.
pub fn built_in(kind: Kind, width: u32) -> Dataset {
    synth::scene(kind).dataset(&SynthOptions {
        views: VIEWS,
        width,
        height: (width * 3 / 4).max(1),
        ..SynthOptions::default()
    })
}

/// Checksum of a data set's training views and points, hexadecimal. The colours of points are included, photographs are
/// not.
pub fn checksum(dataset: &Dataset) -> String {
    let mut hash = crc32fast::Hasher::new();
    hash.update(&fingerprint(dataset).to_le_bytes());
    for point in &dataset.points {
        let position = point.position.iter().flat_map(|x| x.to_le_bytes());
        let color = point.color.iter().flat_map(|x| x.to_le_bytes());
        hash.update(&position.chain(color).collect::<Vec<u8>>());
    }
    format!("{:08x}", hash.finalize())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_sizes_and_scenes_have_other_checksums() {
        let found = [
            built_in(Kind::Plane, 16),
            built_in(Kind::Plane, 20),
            built_in(Kind::Sphere, 16),
        ];
        let [plane, larger, sphere] = found.each_ref().map(checksum);
        assert_eq!(plane, checksum(&built_in(Kind::Plane, 16)));
        assert!(plane != larger && plane != sphere && larger != sphere);
        assert_eq!(plane.len(), 8);
        assert_eq!(found[0].split(crate::scene::Split::Test).len(), VIEWS / 8);
    }
}
