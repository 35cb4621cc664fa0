//! First splats of a run: one per point, with the distance of its neighbours as size.

mod cull;
mod frusta;
mod sweep;
mod tangent;

use super::config::TrainConfig;
use super::knn::mean_neighbor_distance;
use super::rng::{self, Stream};
use super::sky::{SkyShell, add_sky};
use crate::scene::{Dataset, PhotoSource, Point, SH_C0, Splats, Split, logit, sh_coefficient_count};
use crate::{Error, Result};

pub use frusta::points_in_frusta;
use sweep::points_by_sweep;
use tangent::{LocalPlane, local_planes};

/// First splats of a data set: from its points or, if none is finite and not culled, from random ones inside its
/// cameras' frusta; and those of the sky, if it is asked for. `extent` is the scene extent in world units.
///
/// Error if the data set has neither points nor training views.
pub fn initial_splats(dataset: &Dataset, extent: f64, config: &TrainConfig) -> Result<Splats> {
    let training = dataset.split(Split::Train);
    let mut splats = scene_splats(dataset, &training, extent, config)?;
    if config.sky {
        let shell = SkyShell::around(dataset, extent, &config.shell);
        add_sky(dataset, shell, &config.shell, &mut splats)?;
        keep_within(&mut splats, config.splat_limit());
    }
    Ok(splats)
}

/// Leaves splats out, evenly among all, beyond the limit.
fn keep_within(splats: &mut Splats, limit: usize) {
    let count = splats.len();
    if count > limit {
        let kept: Vec<usize> = (0..limit).map(|i| i * count / limit).collect();
        *splats = splats.picked(&kept);
    }
}

fn scene_splats(dataset: &Dataset, training: &[usize], extent: f64, config: &TrainConfig) -> Result<Splats> {
    let finite = |p: &&Point| p.is_finite();
    let cameras: Vec<_> = training.iter().map(|&i| dataset.views[i].camera).collect();
    let points: Vec<Point> = dataset.points.iter().filter(finite).copied().collect();
    let points = cull::culled(&points, &cameras, &config.init);
    if !points.is_empty() {
        return Ok(splats_from_points(&points, extent, config));
    }
    if training.is_empty() {
        let what = "the data set has neither points nor training views to start from";
        return Err(Error::Config(what.into()));
    }
    let count = config.init.random_count as usize;
    let has_photos = training
        .iter()
        .all(|&i| !matches!(dataset.views[i].photo, PhotoSource::Absent));
    let points = match config.init.random_sweep > 0 && has_photos {
        true => points_by_sweep(dataset, training, count, extent, config.seed, &config.init)?,
        false => points_in_frusta(&cameras, count, extent, config.seed, &config.init),
    };
    Ok(splats_from_points(&points, extent, config))
}

/// One splat per point, as flat as the point's neighbours, or per point of a random subset if there are more than the
/// splat limit. All points must be finite.
pub fn splats_from_points(points: &[Point], extent: f64, config: &TrainConfig) -> Splats {
    let points = subsample(points, config.splat_limit(), config.seed);
    let positions: Vec<[f32; 3]> = points.iter().map(|p| p.position.map(|x| x as f32)).collect();
    let factor = f64::from(config.init.scale_factor);
    let planes = local_planes(&positions);
    let log_scale = |(distance, plane): (&f64, &LocalPlane)| {
        let spacing = if *distance > 0.0 {
            *distance
        } else {
            config.init.lone_scale * extent
        };
        let [least, most] = config.init.scale_range.map(|share| share * extent);
        let along = (spacing * factor).clamp(least, most);
        let across = along * plane.thickness.max(f64::from(config.init.thickness));
        [along, along, across.max(least)].map(|scale| scale.ln() as f32)
    };
    let stride = sh_coefficient_count(config.sh_degree) * 3;
    let mut sh = vec![0.0; points.len() * stride];
    for (coefficients, point) in sh.chunks_exact_mut(stride).zip(&points) {
        for (constant, color) in coefficients.iter_mut().zip(point.color) {
            *constant = (color - 0.5) / SH_C0;
        }
    }
    let distances = mean_neighbor_distance(&positions);
    let mut splats = Splats {
        log_scale: distances.iter().zip(&planes).map(log_scale).collect(),
        quaternion: planes.iter().map(|plane| plane.rotation).collect(),
        opacity_logit: vec![logit(f64::from(config.init.opacity)) as f32; points.len()],
        mean: positions,
        sh,
        sh_degree: config.sh_degree,
        primitive: config.kind,
        ..Splats::default()
    };
    splats.set_thickness();
    splats
}

/// `count` of the points in their order, each subset equally likely (up to equal hashes).
fn subsample(points: &[Point], count: usize, seed: u64) -> Vec<Point> {
    if points.len() <= count {
        return points.to_vec();
    }
    let key = |i: u32| (rng::bits(seed, 0, i, Stream::Subsample)[0], i);
    let mut keyed: Vec<(u32, u32)> = (0..points.len() as u32).map(key).collect();
    keyed.select_nth_unstable(count);
    let mut chosen: Vec<u32> = keyed[..count].iter().map(|&(_, i)| i).collect();
    chosen.sort_unstable();
    chosen.into_iter().map(|i| points[i as usize]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config() -> TrainConfig {
        TrainConfig::for_iterations(100)
    }

    fn points(positions: &[[f32; 3]]) -> Vec<Point> {
        let point = |&position: &[f32; 3]| Point {
            position: position.map(f64::from),
            color: [0.5, 1.0, 0.0],
        };
        positions.iter().map(point).collect()
    }

    #[test]
    fn splats_are_as_large_as_their_neighbours_are_far() {
        let square = points(&[[0.0; 3], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 3.0]]);
        let splats = splats_from_points(&square, 1e3, &config());
        assert!((splats.log_scale[0][1] - 3.0_f32.ln()).abs() < 1e-6);
        assert!((splats.opacity_logit[0] - logit(0.3) as f32).abs() < 1e-6);
        assert_eq!(splats.sh_degree, 3);
        assert_eq!(splats.sh.len(), 4 * 48);
        assert_eq!(splats.sh[48], 0.0);
        assert!((0.5 + SH_C0 * splats.sh[49] - 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_splat_is_as_thin_as_its_neighbourhood_and_no_thinner_than_set() {
        // Two layers of a lattice with a spacing of 1.
        let layers = |apart: f32| -> Vec<[f32; 3]> {
            let place = |i: u32| [(i % 5) as f32, (i / 5 % 5) as f32, apart * (i / 25) as f32];
            (0..50).map(place).collect()
        };
        let thickness = |apart: f32, least: f32| {
            let mut config = config();
            config.init.thickness = least;
            let splats = splats_from_points(&points(&layers(apart)), 1e3, &config);
            // The middle of the lower layer.
            let [along, other, across] = splats.log_scale[12];
            assert_eq!(along, other);
            (across - along).exp()
        };
        assert!((thickness(0.0, 0.25) - 0.25).abs() < 1e-6);
        // Of the twelve neighbours five lie in the other layer; the squares along either axis of the layer sum to 7.
        let own = (5.0 * 0.3_f32.powi(2) / 7.0).sqrt();
        assert!((thickness(0.3, 0.1) - own).abs() < 1e-4, "{}", thickness(0.3, 0.1));
        assert!((thickness(0.3, 0.5) - 0.5).abs() < 1e-6);
        assert!((thickness(0.3, 1.0) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn none_one_two_and_equal_points_give_finite_splats() {
        for set in [
            vec![],
            vec![[1.0; 3]],
            vec![[1.0; 3], [2.0; 3]],
            vec![[1.0; 3]; 50],
            vec![[0.0; 3], [1e-30, 0.0, 0.0], [1e30, 0.0, 0.0]],
        ] {
            let splats = splats_from_points(&points(&set), 2.0, &config());
            assert_eq!(splats.len(), set.len());
            let [least, most] = config().init.scale_range.map(|share| (share * 2.0).ln() as f32);
            for scale in splats.log_scale.iter().flatten() {
                assert!((least..=most).contains(scale), "{scale} of {set:?}");
            }
        }
    }

    #[test]
    fn broken_points_are_left_out_and_nothing_at_all_is_an_error() {
        let mut dataset = Dataset {
            points: points(&[[f32::NAN, 0.0, 0.0], [1.0; 3], [f32::INFINITY; 3]]),
            ..Dataset::default()
        };
        let splats = initial_splats(&dataset, 1.0, &config());
        assert_eq!(splats.map(|s| s.mean).ok(), Some(vec![[1.0; 3]]));
        dataset.points.clear();
        assert!(initial_splats(&dataset, 1.0, &config()).is_err());
    }

    #[test]
    fn a_cap_takes_a_repeatable_subset() {
        let many: Vec<[f32; 3]> = (0..1_000).map(|i| [i as f32, 0.0, 0.0]).collect();
        let mut config = config();
        config.max_splats = Some(100);
        let splats = splats_from_points(&points(&many), 1e4, &config);
        assert_eq!(splats.len(), 100);
        assert!(splats.mean.is_sorted());
        let mean = splats.mean.iter().map(|m| m[0]).sum::<f32>() / 100.0;
        assert!((mean - 500.0).abs() < 120.0, "{mean}");
        assert_eq!(splats, splats_from_points(&points(&many), 1e4, &config));
    }
}
