//! Closed forms, a naive oracle, and the traps: borders, sizes below the window, masks, rounding.

use super::*;
use crate::scene::Photo;

fn noise(count: usize, seed: u32) -> Vec<[f32; 3]> {
    let mut state = seed;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    (0..count).map(|_| [next(), next(), next()]).collect()
}

/// The definition, one window at a time, in two dimensions.
fn naive_ssim(a: &[[f32; 3]], b: &[[f32; 3]], width: i64, height: i64) -> f64 {
    let gauss = |d: i64| (-((d * d) as f64) / (2.0 * 1.5 * 1.5)).exp();
    let norm: f64 = (-5..=5).map(gauss).sum();
    let mut sum = 0.0;
    for (y, x, c) in (0..height).flat_map(|y| (0..width).flat_map(move |x| (0..3).map(move |c| (y, x, c)))) {
        let mut m = [0.0; 5];
        for (dy, dx) in (-5..=5).flat_map(|dy| (-5..=5).map(move |dx| (dy, dx))) {
            let inside = (0..height).contains(&(y + dy)) && (0..width).contains(&(x + dx));
            let at = |image: &[[f32; 3]]| match inside {
                true => f64::from(image[((y + dy) * width + x + dx) as usize][c]),
                false => 0.0,
            };
            let (p, q, w) = (at(a), at(b), gauss(dx) * gauss(dy) / (norm * norm));
            for (m, v) in m.iter_mut().zip([p, q, p * p, q * q, p * q]) {
                *m += w * v;
            }
        }
        let (c1, c2) = (1e-4, 9e-4);
        let luminance = (2.0 * m[0] * m[1] + c1) / (m[0] * m[0] + m[1] * m[1] + c1);
        let spread = m[2] - m[0] * m[0] + m[3] - m[1] * m[1];
        sum += luminance * (2.0 * (m[4] - m[0] * m[1]) + c2) / (spread + c2);
    }
    sum / (width * height * 3) as f64
}

#[test]
fn psnr_of_a_constant_offset_is_closed() {
    let a = vec![[0.25; 3]; 12];
    let b = vec![[0.35; 3]; 12];
    let psnr = psnr_db(Image::new(4, 3, &a), Image::new(4, 3, &b), None);
    assert!((psnr - 20.0).abs() < 1e-5, "{psnr}");
    let image = Image::new(4, 3, &a);
    assert_eq!(psnr_db(image, image, None), f64::INFINITY);
    // One channel of one pixel off by 0.5: mean squared error 0.25 / 36.
    let mut c = a.clone();
    c[7][1] += 0.5;
    let error = mean_squared_error(image, Image::new(4, 3, &c), None);
    assert!((error - 0.25 / 36.0).abs() < 1e-12, "{error}");
}

#[test]
fn ssim_follows_the_definition_at_every_size() {
    for (width, height) in [(1, 1), (5, 5), (11, 11), (17, 13), (3, 40)] {
        let a = noise((width * height) as usize, 1);
        let b: Vec<_> = noise((width * height) as usize, 2)
            .iter()
            .zip(&a)
            .map(|(n, a)| [0, 1, 2].map(|c| 0.8 * a[c] + 0.2 * n[c]))
            .collect();
        let image = |rgb| Image::new(width, height, rgb);
        let fast = ssim(image(&a), image(&b), None);
        let naive = naive_ssim(&a, &b, i64::from(width), i64::from(height));
        assert!((fast - naive).abs() < 1e-12, "{width} × {height}: {fast} {naive}");
        assert!((ssim(image(&a), image(&a), None) - 1.0).abs() < 1e-12);
    }
}

#[test]
fn ssim_of_flat_images_is_the_luminance_term_inside() {
    // Far from the border the variances vanish: (2 a b + C1) / (a² + b² + C1).
    let (a, b) = (vec![[0.9; 3]; 41 * 41], vec![[0.3; 3]; 41 * 41]);
    let inside: Vec<f32> = (0..41 * 41)
        .map(|i| f32::from((5..36).contains(&(i % 41)) && (5..36).contains(&(i / 41))))
        .collect();
    let image = |rgb| Image::new(41, 41, rgb);
    let value = ssim(image(&a), image(&b), Some(&inside));
    let (a, b) = (f64::from(0.9_f32), f64::from(0.3_f32));
    let closed = (2.0 * a * b + 1e-4) / (a * a + b * b + 1e-4);
    assert!((value - closed).abs() < 1e-9, "{value} {closed}");
}

#[test]
fn weights_leave_masked_pixels_out() {
    let a = noise(64, 3);
    let mut b = a.clone();
    let mut weights = vec![1.0; 64];
    b[10] = [f32::NAN; 3];
    weights[10] = 0.0;
    b[20][0] += 0.5;
    weights[20] = 0.5;
    let image = |rgb| Image::new(8, 8, rgb);
    let error = mean_squared_error(image(&a), image(&b), Some(&weights));
    assert!((error - 0.5 * (0.25 / 3.0) / 62.5).abs() < 1e-8, "{error}");
    assert!(
        psnr_db(image(&a), image(&b), None).is_nan(),
        "a broken pixel must not pass for a good one"
    );
    assert!(compare(image(&a), image(&b), None).rounded.psnr_db.is_nan());
}

#[test]
fn rounding_is_half_up_and_never_truncates() {
    assert_eq!(Photo::level(0.5 / 255.0), 1);
    assert_eq!(Photo::level(0.499 / 255.0), 0);
    assert_eq!(Photo::level(254.5 / 255.0), 255);
    assert_eq!([-1.0, 2.0, f32::NAN, f32::INFINITY].map(Photo::level), [0, 255, 0, 255]);
    assert!((0..=255_u8).all(|level| Photo::level(f32::from(level) / 255.0) == level));
    // Within half a level of a level the rounded images agree and the float images do not.
    let (a, b) = (vec![[100.0 / 255.0; 3]; 9], vec![[100.4 / 255.0; 3]; 9]);
    let scores = compare(Image::new(3, 3, &a), Image::new(3, 3, &b), None);
    assert_eq!(scores.rounded.psnr_db, f64::INFINITY);
    assert!((scores.float.psnr_db - 20.0 * (255.0_f64 / 0.4).log10()).abs() < 1e-3);
    // Values out of range count in full as rendered, and clamped in 8 bits.
    let (a, b) = (vec![[1.0; 3]; 9], vec![[1.5; 3]; 9]);
    let scores = compare(Image::new(3, 3, &a), Image::new(3, 3, &b), None);
    assert!(scores.float.psnr_db < 6.1 && scores.rounded.psnr_db == f64::INFINITY);
}
