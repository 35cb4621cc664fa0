//! Pictures with closed forms.

use crate::reference::assert_close;
use ashfall::reference::linear::{product, rotation, transpose};
use ashfall::reference::loss::{self, Target};
use ashfall::reference::project::determinant;
use ashfall::reference::rasterize::{Layer, composite};
use ashfall::reference::ssim::{C1, C2, ssim};
use ashfall::reference::{Options, Splat, Viewpoint, project, render, sh};
use ashfall::scene::{Camera, SH_C0, ScreenFilter, Splats};
use glam::{DMat3, DVec2, DVec3};

/// A camera at the origin along z with the principal point at the centre.
fn upright(width: u32, height: u32, focal: f64) -> Camera {
    Camera {
        width,
        height,
        focal: DVec2::splat(focal),
        center: DVec2::new(f64::from(width), f64::from(height)) / 2.0,
        rotation: DMat3::IDENTITY,
        position: DVec3::ZERO,
    }
}

/// One round splat of standard deviation 0.25 at depth 4, with logit 0 and a plain colour.
fn single(mean: [f32; 3]) -> Splats {
    Splats {
        mean: vec![mean],
        quaternion: vec![[1.0, 0.0, 0.0, 0.0]],
        log_scale: vec![[0.25f32.ln(); 3]],
        opacity_logit: vec![0.0],
        sh: [1.0, 0.5, 0.25].map(|c| (c - 0.5) / SH_C0).to_vec(),
        sh_degree: 0,
        ..Splats::default()
    }
}

#[test]
fn a_round_splat_on_the_axis_is_the_textbook_gaussian() {
    let camera = upright(33, 33, 40.0);
    let frame = render(&single([0.0, 0.0, 4.0]), &camera, &Options::default());
    let variance = (0.25f32.ln() as f64).exp().powi(2) * (40.0f64 / 4.0).powi(2) + 0.3;
    for (index, pixel) in frame.pixels.iter().enumerate() {
        let (dx, dy) = ((index % 33) as f64 - 16.0, (index / 33) as f64 - 16.0);
        let alpha = 0.5 * (-(dx * dx + dy * dy) / (2.0 * variance)).exp();
        let alpha = if alpha < 1.0 / 255.0 { 0.0 } else { alpha };
        assert_close(pixel.transmittance, 1.0 - alpha, 1e-14, 1.0);
        assert_close(pixel.color[1], alpha * 0.5, 1e-6, 1.0);
        assert_close(pixel.depth, alpha * 4.0, 1e-14, 1.0);
    }
}

#[test]
fn a_splat_at_the_centre_of_a_pixel_has_four_fold_symmetry() {
    // The principal point is the centre of pixel (10, 12).
    let camera = Camera {
        center: DVec2::new(10.5, 12.5),
        ..upright(21, 25, 30.0)
    };
    let frame = render(&single([0.0, 0.0, 4.0]), &camera, &Options::default());
    let at = |x: i64, y: i64| frame.pixels[((12 + y) * 21 + 10 + x) as usize].color;
    for y in 0..=10 {
        for x in 0..=10 {
            for turned in [at(-x, y), at(x, -y), at(-x, -y), at(y, x)] {
                assert_eq!(at(x, y), turned, "at ({x}, {y})");
            }
        }
    }
    assert!(at(0, 0)[0] > at(1, 0)[0], "the peak is not at the centre");
}

#[test]
fn two_layers_blend_by_the_over_operator() {
    let layer = |alpha: f64, color: [f64; 3], depth: f64| Layer { alpha, color, depth };
    let layers = [layer(0.25, [1.0, 0.0, 0.5], 2.0), layer(0.5, [0.0, 1.0, 0.5], 3.0)];
    let (pixel, count) = composite(layers, [0.2, 0.4, 0.8], 1e-4);
    assert_eq!(count, 2);
    // Front: 1/4. Back: 3/4 · 1/2 = 3/8. Background: 3/8.
    assert_eq!(pixel.transmittance, 0.375);
    assert_eq!(pixel.depth, 0.25 * 2.0 + 0.375 * 3.0);
    for (channel, expected) in [0.25 + 0.375 * 0.2, 0.375 + 0.375 * 0.4, 0.3125 + 0.375 * 0.8]
        .into_iter()
        .enumerate()
    {
        assert_close(pixel.color[channel], expected, 1e-15, 1.0);
    }
}

#[test]
fn the_splat_that_saturates_a_pixel_is_still_blended() {
    let wall = Layer {
        alpha: 0.99995,
        color: [1.0, 0.0, 0.0],
        depth: 1.0,
    };
    let behind = Layer {
        color: [0.0, 1.0, 0.0],
        ..wall
    };
    let (pixel, count) = composite([wall, behind], [0.0; 3], 1e-4);
    assert_eq!(count, 1);
    assert_eq!(pixel.color, [0.99995, 0.0, 0.0]);
}

#[test]
fn an_image_is_like_itself() {
    let image: Vec<[f64; 3]> = (0..13 * 17)
        .map(|i| [0.3, 0.8, 0.1].map(|c: f64| (c + f64::from(i * i % 23) / 23.0) / 2.0))
        .collect();
    let sums = loss::sums(&image, &Target::new(13, &image));
    assert_close(sums.dissimilarity, 0.0, 1e-12, 1.0);
    assert_eq!((sums.l1, sums.weight), (0.0, 663.0));
    for d in loss::gradient(&image, &Target::new(13, &image)).iter().flatten() {
        assert!(d.abs() < 1e-12, "gradient {d} at the minimum");
    }
}

#[test]
fn flat_images_have_the_luminance_term_only() {
    let (a, b) = (0.7, 0.4);
    // Only for a pixel with its window inside the image: the middle one of 11 × 11.
    let middle = ssim(11, &[a; 121], &[b; 121])[60];
    assert_close(middle, (2.0 * a * b + C1) / (a * a + b * b + C1), 1e-12, 1.0);
    // In the corner the window includes the zeros beyond the border: 1 − s of its weight, s = (Σ half)².
    let corner = ssim(11, &[a; 121], &[b; 121])[0];
    let half: f64 = (0..=5).map(|t| (-f64::from(t * t) / 4.5).exp()).sum();
    let whole: f64 = (-5..=5).map(|t: i32| (-f64::from(t * t) / 4.5).exp()).sum();
    let s = (half / whole).powi(2);
    let luminance = (2.0 * s * s * a * b + C1) / (s * s * (a * a + b * b) + C1);
    let spread = s - s * s;
    let structure = (2.0 * spread * a * b + C2) / (spread * (a * a + b * b) + C2);
    assert_close(corner, luminance * structure, 1e-12, 1.0);
}

#[test]
fn spherical_harmonics_are_orthonormal() {
    // Simpson over z, equidistant points around: exact around, 1e-9 along z.
    let (steps, turns) = (400, 16);
    let mut gram = vec![[0.0; 16]; 16];
    for i in 0..=steps {
        let z = -1.0 + 2.0 * f64::from(i) / f64::from(steps);
        let simpson = match i {
            0 => 1.0,
            i if i == steps => 1.0,
            i => 2.0 + 2.0 * f64::from(i % 2),
        };
        let area = simpson * 2.0 / f64::from(steps) / 3.0 * std::f64::consts::TAU / f64::from(turns);
        for turn in 0..turns {
            let angle = std::f64::consts::TAU * f64::from(turn) / f64::from(turns);
            let r = (1.0 - z * z).max(0.0).sqrt();
            let basis = sh::basis(3, [r * angle.cos(), r * angle.sin(), z]);
            for (row, a) in gram.iter_mut().zip(&basis) {
                for (sum, b) in row.iter_mut().zip(&basis) {
                    *sum += area * a * b;
                }
            }
        }
    }
    for (i, row) in gram.iter().enumerate() {
        for (j, value) in row.iter().enumerate() {
            assert_close(*value, if i == j { 1.0 } else { 0.0 }, 1e-7, 1.0);
        }
    }
}

#[test]
fn spherical_harmonics_have_the_signs_of_the_files() {
    let [x, y, z] = [2.0 / 7.0, 3.0 / 7.0, 6.0 / 7.0];
    let basis = sh::basis(3, [x, y, z]);
    // Polynomials with the signs of the file format.
    let expected = [
        0.28209479177387814,
        -0.4886025119029199 * y,
        0.4886025119029199 * z,
        -0.4886025119029199 * x,
        1.0925484305920792 * x * y,
        -1.0925484305920792 * y * z,
        0.31539156525252005 * (3.0 * z * z - 1.0),
        -1.0925484305920792 * x * z,
        0.5462742152960396 * (x * x - y * y),
        -0.5900435899266435 * y * (3.0 * x * x - y * y),
        2.890611442640554 * x * y * z,
        -0.4570457994644658 * y * (5.0 * z * z - 1.0),
        0.3731763325901154 * z * (5.0 * z * z - 3.0),
        -0.4570457994644658 * x * (5.0 * z * z - 1.0),
        1.445305721320277 * z * (x * x - y * y),
        -0.5900435899266435 * x * (x * x - 3.0 * y * y),
    ];
    for (value, expected) in basis.iter().zip(expected) {
        assert_close(*value, expected, 1e-14, 1.0);
    }
}

#[test]
fn a_quarter_turn_is_a_quarter_turn() {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let turn = rotation([half, 0.0, 0.0, half]);
    for (row, expected) in turn.iter().zip([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) {
        for (value, expected) in row.iter().zip(expected) {
            assert_close(*value, expected, 1e-15, 1.0);
        }
    }
    // The squares overflow in single precision.
    let long = rotation([0.0f32, 0.0, 1e30, 0.0]);
    assert_eq!(long, [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]);
    let any = rotation([0.3, -1.2, 0.7, 2.0]);
    let square = product(any, transpose(any));
    for (i, row) in square.iter().enumerate() {
        for (j, value) in row.iter().enumerate() {
            assert_close(*value, if i == j { 1.0 } else { 0.0 }, 1e-14, 1.0);
        }
    }
}

#[test]
fn a_needles_determinant_is_the_sum_of_squared_minors() {
    // Aspect up to 1000; Cauchy–Binet: det(V Vᵀ + d I) = Σ minors² + d tr(V Vᵀ) + d².
    for (aspect, quaternion) in [(100.0f32, [0.9, 0.2, 0.3, -0.1]), (1000.0, [0.2, 0.7, -0.4, 0.5])] {
        let mut splats = single([0.4, -0.3, 4.0]);
        splats.quaternion[0] = quaternion;
        splats.log_scale[0][1] += aspect.ln();
        let splat = Splat::<f64>::of(&splats, 0);
        let camera = upright(64, 48, 50.0);
        let view = Viewpoint::new(&camera, &Options::default(), ScreenFilter::Classic);
        let screen = project(&splat, &view).map(|s| s.covariance).unwrap_or_default();
        let turn = rotation(splat.quaternion);
        let [x, y, z] = splat.mean;
        // Rows of J R S for an upright camera.
        let rows = [[1.0, 0.0, -x / z], [0.0, 1.0, -y / z]].map(|row: [f64; 3]| {
            [0, 1, 2].map(|k| {
                let turned: f64 = (0..3).map(|i| row[i] * turn[i][k]).sum();
                50.0 / z * turned * splat.log_scale[k].exp()
            })
        });
        let minor = |i: usize, j: usize| rows[0][i] * rows[1][j] - rows[0][j] * rows[1][i];
        let minors = minor(0, 1).powi(2) + minor(1, 2).powi(2) + minor(0, 2).powi(2);
        let trace: f64 = rows.iter().flatten().map(|v| v * v).sum();
        let expected = minors + 0.3 * trace + 0.09;
        assert_close(determinant(screen), expected, 1e-9, 0.0);
    }
}

#[test]
fn mip_mode_keeps_the_light() {
    // opacity · √det is the total light of a splat: equal before and after the dilation.
    let mut splats = single([0.0, 0.0, 4.0]);
    splats.log_scale[0] = [0.02f32.ln(), 0.05f32.ln(), 0.02f32.ln()];
    splats.filter = ScreenFilter::Mip;
    let camera = upright(33, 33, 40.0);
    let view = Viewpoint::new(&camera, &Options::default(), splats.filter);
    let splat = Splat::<f64>::of(&splats, 0);
    let screen = project(&splat, &view);
    let light = screen.map_or(0.0, |s| s.opacity * determinant(s.covariance).sqrt());
    let sigma = splat.log_scale.map(|s| 10.0 * s.exp());
    assert_close(light, 0.5 * sigma[0] * sigma[1], 1e-12, 0.0);
}
