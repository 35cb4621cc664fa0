//! Synthetic data sets on disk, loaded by the readers of real ones.

use ashfall::io::{dataset, photo};
use ashfall::lab::synth::{Kind, SynthOptions, save, scene};
use ashfall::scene::{PhotoSource, Split};
use glam::DVec2;

#[test]
fn a_saved_data_set_is_read_back_the_same() {
    let options = SynthOptions {
        views: 6,
        width: 40,
        height: 30,
        points: 50,
        center_offset: DVec2::new(1.5, -2.0),
        focal_ratio: 1.05,
        cutout: true,
        test_every: 3,
        ..SynthOptions::default()
    };
    let made = scene(Kind::Solids).dataset(&options);
    let dir = tempfile::tempdir().unwrap();
    save(&made, dir.path()).unwrap();
    let open = dataset::OpenOptions {
        test_every: 3,
        ..Default::default()
    };
    let read = dataset::open(dir.path(), &open).unwrap();
    assert!(read.warnings.is_empty(), "{:?}", read.warnings);
    assert_eq!(read.alpha, made.alpha);
    assert_eq!(read.split(Split::Test), [0, 3]);
    assert_eq!(read.views.len(), made.views.len());
    for (read, made) in read.views.iter().zip(&made.views) {
        assert_eq!(read.camera.focal, made.camera.focal);
        assert_eq!(read.camera.center, made.camera.center);
        assert!(read.camera.position.distance(made.camera.position) < 1e-12);
        let turned = read.camera.rotation - made.camera.rotation;
        assert!(turned.to_cols_array().iter().all(|value| value.abs() < 1e-9));
        let PhotoSource::Memory(photo) = &made.photo else {
            unreachable!()
        };
        assert_eq!(photo::load(read).unwrap(), *photo);
    }
    assert_eq!(read.points.len(), made.points.len());
    for (read, made) in read.points.iter().zip(&made.points) {
        assert_eq!(read.position, made.position);
        let near = |i: usize| (read.color[i] - made.color[i]).abs() <= 0.5 / 255.0 + 1e-6;
        assert!((0..3).all(near));
    }
}
