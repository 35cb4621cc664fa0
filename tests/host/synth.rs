//! Synthetic data sets on disk, loaded by the readers of real ones.

use ashfall::io::{dataset, photo};
use ashfall::lab::synth::{Kind, SynthOptions, save, save_colmap, save_masks, scene};
use ashfall::scene::{Dataset, PhotoSource, Split};
use ashfall::train::exposure::{
    LensVignetting, TrackColors, TrackExposure, from_tracks, remove_vignetting, stops, vignetting,
};
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

/// Made photographs of which the training views have other exposures than the test views.
fn exposed(seed: Option<u64>) -> SynthOptions {
    SynthOptions {
        views: 24,
        width: 96,
        height: 72,
        samples: 2,
        points: 3_000,
        tracks: true,
        exposure_seed: seed,
        ..SynthOptions::default()
    }
}

fn exposures(dataset: &Dataset) -> Vec<TrackExposure> {
    from_tracks(&TrackColors::read(dataset).unwrap())
}

#[test]
fn exposures_come_back_from_the_tracks() {
    let dir = tempfile::tempdir().unwrap();
    let unperturbed = exposures(&scene(Kind::Demo).dataset(&exposed(None)));
    for seed in [Some(1), Some(2), None] {
        let options = exposed(seed);
        let made = scene(Kind::Demo).dataset(&options);
        save_colmap(&made, &options, dir.path()).unwrap();
        let read = dataset::open(dir.path(), &dataset::OpenOptions::default()).unwrap();
        assert_eq!(read.tracks, made.tracks);
        let found = exposures(&read);
        let truth = options.exposures();
        assert_eq!(found.len(), 21, "training views alone");
        let (mut squares, mut shifts) = (0.0, 0.0);
        for (of, plain) in found.iter().zip(&unperturbed) {
            assert!(!read.is_test(of.view));
            let channels = of.log_gain.iter().zip(plain.log_gain).zip(truth[of.view]);
            for ((found, plain), truth) in channels {
                let error = stops(*found) - truth;
                squares += error.powi(2);
                shifts += (error - stops(plain)).powi(2);
            }
        }
        let [rms, shift] = [squares, shifts].map(|sum| (sum / 63.0).sqrt());
        println!("seed {seed:?}: {rms:.4} stops rms, {shift:.4} without highlights and edges");
        // Most of it are highlights and edges, which are not of one colour: the same without any exposure.
        assert!(rms <= 0.03 && shift <= 0.015, "seed {seed:?}: {rms} stops rms, {shift}");
        let spread = truth.iter().flatten().map(|stop| stop.abs()).fold(0.0, f64::max);
        assert_eq!(spread > 0.5, seed.is_some(), "the test tells nothing");
        for channel in 0..3 {
            let mean = found.iter().map(|of| of.log_gain[channel]).sum::<f64>() / 21.0;
            assert!(mean.abs() < 1e-12, "{mean}");
        }
    }
}

#[test]
fn test_views_take_no_part_in_exposures() {
    let mut made = scene(Kind::Demo).dataset(&exposed(Some(1)));
    let before = exposures(&made);
    for view in made.split(Split::Test) {
        let PhotoSource::Memory(photo) = &mut made.views[view].photo else {
            unreachable!()
        };
        photo.rgba.iter_mut().for_each(|pixel| pixel[0] /= 2);
    }
    assert_eq!(exposures(&made), before);
    made.tracks.clear();
    assert!(exposures(&made).is_empty(), "without tracks nothing is known");
}

/// Vignetting of made photographs of the facade, which is matt, with exposures as well.
fn through_a_lens(vignetting: bool) -> SynthOptions {
    SynthOptions {
        vignetting,
        ..exposed(Some(2))
    }
}

#[test]
fn vignetting_comes_back_from_the_tracks() {
    let (scene, options) = (scene(Kind::Facade), through_a_lens(true));
    let dir = tempfile::tempdir().unwrap();
    save_colmap(&scene.dataset(&options), &options, dir.path()).unwrap();
    let mut read = dataset::open(dir.path(), &dataset::OpenOptions::default()).unwrap();
    let [found]: [LensVignetting; 1] = remove_vignetting(&mut read).unwrap().try_into().unwrap();
    assert_eq!((found.size, found.photos), ([96, 72], 21));
    assert!(
        found.is_clear() && (found.vignetting.corner_stops() + 0.7).abs() < 0.1,
        "{found:?}"
    );
    // Photographs of test views have the scene's own brightness again, those trained on their exposures.
    let plain = scene.dataset(&through_a_lens(false));
    for (view, plain) in read.views.iter().zip(&plain.views) {
        let (removed, exact) = (photo::load(view).unwrap(), photo::load(plain).unwrap());
        let corner = [0, 1, 96, 97].map(|pixel| removed.rgba[pixel][1].abs_diff(exact.rgba[pixel][1]));
        // A tenth of a stop is 3 % of a value.
        assert!(
            corner.iter().all(|&difference| difference <= 8),
            "{}: {corner:?}",
            view.name
        );
    }
    let [left]: [LensVignetting; 1] = vignetting(&TrackColors::read(&read).unwrap()).try_into().unwrap();
    assert!(left.vignetting.corner_stops().abs() < 0.05, "{left:?}");
}

#[test]
fn photographs_without_vignetting_stay_as_they_are() {
    let made = scene(Kind::Facade).dataset(&through_a_lens(false));
    let mut same = made.clone();
    let found = remove_vignetting(&mut same).unwrap();
    assert!(found.len() == 1 && !found[0].is_clear(), "{found:?}");
    assert_eq!(same.views, made.views);
    // Twenty training photographs are needed, and tracks.
    let mut few = made.clone();
    few.test_every = 2;
    let error = remove_vignetting(&mut few).unwrap_err().to_string();
    assert!(error.contains("20 training photographs"), "{error}");
    let mut untracked = made;
    untracked.tracks.clear();
    assert!(
        remove_vignetting(&mut untracked).is_err() && vignetting(&TrackColors::read(&untracked).unwrap()).is_empty()
    );
}

#[test]
fn fisheye_photographs_are_seen_as_the_pinhole_pictures_of_their_sides() {
    let options = SynthOptions {
        views: 5,
        width: 128,
        height: 96,
        samples: 3,
        points: 500,
        test_every: 4,
        tracks: true,
        fisheye: true,
        ..SynthOptions::default()
    };
    let made = scene(Kind::Demo);
    let dir = tempfile::tempdir().unwrap();
    save_colmap(&made.dataset(&options), &options, dir.path()).unwrap();
    let open = dataset::OpenOptions {
        test_every: 4,
        ..Default::default()
    };
    let read = dataset::open(dir.path(), &open).unwrap();
    let names: Vec<&str> = read.views.iter().map(|view| view.name.as_str()).collect();
    assert!(
        names.contains(&"0000.png") && names.contains(&"0001.png#front"),
        "{names:?}"
    );
    assert!(
        names.contains(&"0001.png#left") && !names.contains(&"0001.png#back"),
        "{names:?}"
    );
    assert_eq!(read.split(Split::Test).len(), 2);
    for view in read.views.iter().filter(|view| view.name.starts_with("0002")) {
        let (seen, exact) = (photo::load(view).unwrap(), made.photo(&view.camera, 3));
        let kept = seen.rgba.iter().zip(&exact.rgba).filter(|(seen, _)| seen[3] == 255);
        let (mut error, mut count) = (0.0, 0.0);
        for (seen, exact) in kept {
            error += (0..3).map(|c| f64::from(seen[c].abs_diff(exact[c]))).sum::<f64>();
            count += 3.0;
        }
        // Resampling blurs edges; another place of the picture is off by tens.
        let share = count / (3 * seen.rgba.len()) as f64;
        println!("{}: {:.2} levels over {share:.2}", view.name, error / count);
        assert!(
            error / count < 6.0 && share > 0.2,
            "{}: {} levels",
            view.name,
            error / count
        );
    }
}

#[test]
fn passers_by_hide_a_share_of_a_fifth_of_the_training_photographs() {
    let plain = SynthOptions {
        views: 17,
        width: 64,
        height: 48,
        samples: 1,
        points: 400,
        tracks: true,
        ..SynthOptions::default()
    };
    let options = SynthOptions {
        transient_seed: Some(5),
        ..plain.clone()
    };
    let made = scene(Kind::Demo);
    let (control, dataset) = (made.dataset(&plain), made.dataset(&options));
    let occluded = options.occluded();
    assert_eq!((occluded.len(), plain.occluded().len()), (3, 0));
    for view in 0..options.views {
        let photos = [&control, &dataset].map(|data| match &data.views[view].photo {
            PhotoSource::Memory(photo) => photo.rgba.clone(),
            _ => unreachable!(),
        });
        let covered = made.passerby_pixels(&options, view);
        if !occluded.contains(&view) {
            assert!(photos[0] == photos[1] && covered.is_empty(), "{view}");
            continue;
        }
        let count = covered.iter().filter(|&&is| is).count();
        // Rays through 64 × 48 places give the share to a hundredth of the picture.
        assert!((0.04..0.16).contains(&(count as f64 / covered.len() as f64)), "{count}");
        for (pixel, is_covered) in covered.into_iter().enumerate() {
            assert!(is_covered || photos[0][pixel] == photos[1][pixel], "{view}: {pixel}");
        }
        let hidden = |data: &ashfall::scene::Dataset| data.tracks[view].len();
        assert!(hidden(&dataset) < hidden(&control) && !options.is_test(view));
    }
    let dir = tempfile::tempdir().unwrap();
    save_masks(&made, &dataset, &options, dir.path()).unwrap();
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 3);
}
