//! Conversions from the oracle's numbers to the kernels' layouts, and their guarantees.

use crate::common::pack;
use crate::common::scenes::{self, Random};
use crate::reference::assert_close;
use ashfall::reference::rasterize_backward::{PixelGradient, ScreenGradient, pixel_backward};
use ashfall::reference::{Splat, Thresholds, Viewpoint, frame};

#[test]
fn packing_keeps_the_meaning() {
    let scene = scenes::gentle(30, 3, 20, 20, 0);
    let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    let random = &mut Random::new(30);
    for splat in frame::project_all(&Splat::<f64>::all(&scene.splats), &view)
        .iter()
        .flatten()
    {
        let back = pack::screen_splat(&pack::splat2d(splat));
        for (a, b) in splat.row().iter().zip(back.row()) {
            assert_close(*a, b, 1e-6, 1.0);
        }
        // Sums over five positions, by their definition.
        let mut gradient = ScreenGradient::default();
        let mut sums = [0.0; 6];
        for _ in 0..5 {
            let at = [0, 1].map(|axis| splat.mean[axis] + 3.0 * random.normal());
            let upstream = PixelGradient {
                color: [1.0, -2.0, 0.5],
                ..PixelGradient::default()
            };
            let said = pixel_backward(
                &[*splat],
                &[0],
                at,
                scene.options.background,
                &Thresholds::NONE,
                &upstream,
            );
            let d = &said[0].1;
            gradient.row = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9].map(|i| gradient.row[i] + d.row[i]);
            let [_, tone, _] = pack::splat2d_values(splat);
            let (dx, dy) = (at[0] - splat.mean[0], at[1] - splat.mean[1]);
            let slope = splat.covariance[1] / splat.covariance[0];
            let (fx, fy) = (dx * tone[0], (dy - slope * dx) * tone[1]);
            let s = d.row[5] * splat.opacity;
            let terms = [s, s * fx, s * fy, s * fx * fx, s * fx * fy, s * fy * fy];
            sums = [0, 1, 2, 3, 4, 5].map(|i| sums[i] + terms[i]);
        }
        let packed = pack::whitened_sums(splat, &gradient);
        for (found, expected) in packed.iter().zip(sums) {
            // WHITEN is an f32.
            assert_close(*found, expected, 1e-6, 1e-3);
        }
    }
}
