//! Colours fitted with fewer SH bands, against the reference.

use crate::common::scenes::{self, Random};
use ashfall::reference::sh::unclamped_color;
use ashfall::scene::{Camera, Splats};
use ashfall::simplify::{Fits, ViewWeights};
use glam::DVec3;

/// A splat's colour from a camera.
fn color(splats: &Splats, index: usize, camera: &Camera) -> [f64; 3] {
    let stride = splats.sh_stride();
    let row = splats.sh[index * stride..][..stride].chunks_exact(3);
    let row: Vec<[f64; 3]> = row.map(|c| [c[0], c[1], c[2]].map(f64::from)).collect();
    let mean = DVec3::from(splats.mean[index].map(f64::from));
    let direction = (mean - camera.position).normalize();
    unclamped_color(splats.sh_degree, &row, direction.to_array())
}

/// One view has one colour, which a constant keeps, except for the share that weighs all directions.
#[test]
fn what_one_view_sees_stays_whatever_goes() {
    let scene = scenes::gentle(41, 30, 40, 30, 3);
    let splats = &scene.splats;
    for seed in 0..4 {
        let camera = scenes::camera(&mut Random::new(seed), 40, 30);
        let seen = ViewWeights {
            camera,
            weights: vec![1.0; splats.len()],
        };
        let fits = Fits::new(splats, &[seen]);
        for degree in 0..3 {
            let fitted = fits.applied(splats, &vec![degree; splats.len()]);
            let mut cut = splats.clone();
            let kept = 3 * (usize::from(degree) + 1).pow(2);
            cut.sh.chunks_exact_mut(48).for_each(|row| row[kept..].fill(0.0));
            let off = |of: &Splats| -> f64 {
                let apart = |i: usize| {
                    let pairs = color(of, i, &camera).into_iter().zip(color(splats, i, &camera));
                    pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>()
                };
                (0..splats.len()).map(apart).sum()
            };
            // Over degrees up to d, the squares of the (d + 1)^2 functions sum to (d + 1)^2 / 4 pi, against a tenth of
            // 1 / 4 pi.
            assert!(off(&fitted) < 0.02 * off(&cut), "{} of {}", off(&fitted), off(&cut));
        }
    }
}
