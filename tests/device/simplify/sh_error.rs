//! Reduction of SH degrees under an error bound.

use crate::common::device;
use crate::common::scenes::{self, Random};
use crate::simplify::{pass_options, weigher};
use ashfall::reference::Splat;
use ashfall::reference::sh::basis;
use ashfall::render::Compatibility;
use ashfall::simplify::{Promise, measure, reduce_harmonics};

/// Colours by the oracle from all directions, before and after the reduction; and whole pictures.
#[test]
fn fewer_harmonics_keep_to_their_bound_in_every_direction() {
    let gpu = device::gpu();
    let mut scene = scenes::gentle(8, 60, 25, 18, 3);
    let random = &mut Random::new(8);
    for row in scene.splats.sh.chunks_exact_mut(48) {
        let size = random.log_between(0.01, 10.0) as f32;
        row[3..].iter_mut().for_each(|c| *c *= size);
    }
    for error in [0.02, 0.1, 0.4] {
        let reduced = reduce_harmonics(&scene.splats, error);
        let counts = reduced.count_from_degree;
        assert_eq!(counts.iter().sum::<usize>(), 60);
        assert!(counts.iter().filter(|&&count| count > 0).count() > 1, "{counts:?}");
        let mut most = 0.0_f64;
        let pairs = Splat::<f64>::all(&scene.splats).into_iter();
        for (whole, less) in pairs.zip(Splat::<f64>::all(&reduced.splats)) {
            for _ in 0..200 {
                let direction = [0; 3].map(|_| random.normal());
                let [a, b] = [&whole, &less].map(|splat| color(&splat.sh, direction));
                for (a, b) in a.iter().zip(b) {
                    most = most.max((a - b).abs());
                }
            }
        }
        assert!(most <= error, "{most} of {error}");
        assert!(most > 0.2 * error, "{most} of {error}: the bound says little");
        let pass_options = pass_options(&scene.options, Compatibility::Engine);
        let [mut before, mut after] =
            [&scene.splats, &reduced.splats].map(|splats| weigher(&gpu, splats, pass_options));
        let promise = Promise {
            weight: 0.0,
            color: error,
        };
        let change = measure(&mut before, &mut after, &[scene.camera], promise, &mut || true);
        let change = change.unwrap().unwrap();
        assert_eq!(change.broken, 0, "{change:?}");
        assert!(change.most > 0.0, "{change:?}");
    }
}

/// SH colour in a direction, clamped at 0.
fn color(sh: &[[f64; 3]], direction: [f64; 3]) -> [f64; 3] {
    let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
    let degree = sh.len().isqrt() as u32 - 1;
    let basis = basis(degree, direction.map(|x| x / length));
    [0, 1, 2].map(|channel| {
        let terms = basis.iter().zip(sh).map(|(y, c)| y * c[channel]);
        (0.5 + terms.sum::<f64>()).max(0.0)
    })
}
