//! Splats in a volume before a camera, of any number, with the coverage of a trained scene.
//!
//! Law: scenes are surfaces, so splats shrink with their number N, σ ∝ 1/√N, and the coverage of a pixel is independent
//! of N: [`OVERLAP`] bounding squares of three standard deviations. Sizes and places belong to the scene, so that a
//! larger image is the same one in more pixels. Depths are log-uniform from 2 to 20, sizes vary by a factor of e^±0.5,
//! axes of a splat by another, opacities are logistic-normal, directions, colours and harmonics random.

use super::random::Random;
use crate::scene::{Camera, ScreenFilter, Splats, sh_coefficient_count};
use glam::{DMat3, DVec2, DVec3};

/// Bounding squares over a pixel; measured on the trained scenes behind [`crate::render::isects_expected`].
pub const OVERLAP: f64 = 40.0;
/// Side of a bounding square in standard deviations.
const SIDE: f64 = 6.0;
/// Margin of the volume on every side, in widths of the image: scenes do not end where images do.
const MARGIN: f64 = 0.1;
/// Depths, world units.
const DEPTHS: [f64; 2] = [2.0, 20.0];

/// Camera at the origin, looking along z, with its width as focal length.
pub fn camera([width, height]: [u32; 2]) -> Camera {
    let size = DVec2::new(width.into(), height.into());
    Camera {
        width,
        height,
        focal: DVec2::splat(size.x),
        center: 0.5 * size,
        rotation: DMat3::IDENTITY,
        position: DVec3::ZERO,
    }
}

/// `count` splats of a degree for images with `aspect` = height / width.
pub fn splats(count: usize, sh_degree: u32, aspect: f64, seed: u64) -> Splats {
    let random = &mut Random::new(seed);
    let mut splats = Splats {
        sh_degree,
        filter: ScreenFilter::Classic,
        ..Splats::default()
    };
    // In widths of the image: count · side² = overlap · area.
    let area = (1.0 + 2.0 * MARGIN) * (aspect + 2.0 * MARGIN);
    let sigma = (OVERLAP * area / count.max(1) as f64).sqrt() / SIDE;
    for _ in 0..count {
        let depth = random.log_between(DEPTHS[0], DEPTHS[1]);
        let half = [0.5 + MARGIN, 0.5 * aspect + MARGIN];
        let [x, y] = half.map(|half| random.between(-half, half));
        let size = sigma * (0.5 * random.normal()).exp() * depth;
        let log_scale = [0; 3].map(|_| (size.ln() + 0.5 * random.normal()) as f32);
        let opacity_logit = (1.5 * random.normal()) as f32;
        push(
            &mut splats,
            [x * depth, y * depth, depth],
            log_scale,
            opacity_logit,
            random,
        );
    }
    splats
}

/// The same splats and one more in the middle of all depths that covers the whole image.
pub fn with_giant(splats: &Splats) -> Splats {
    let mut splats = splats.clone();
    let random = &mut Random::new(1);
    let depth = (DEPTHS[0] * DEPTHS[1]).sqrt();
    let log_scale = [depth.ln() as f32; 3];
    push(&mut splats, [0.0, 0.0, depth], log_scale, 0.0, random);
    splats
}

fn push(splats: &mut Splats, mean: [f64; 3], log_scale: [f32; 3], opacity_logit: f32, random: &mut Random) {
    splats.mean.push(mean.map(|x| x as f32));
    splats.quaternion.push([0; 4].map(|_| random.normal() as f32));
    splats.log_scale.push(log_scale);
    splats.opacity_logit.push(opacity_logit);
    let coefficients = sh_coefficient_count(splats.sh_degree);
    for coefficient in 0..coefficients {
        let amplitude = if coefficient == 0 { 1.0 } else { 0.1 };
        let rgb = [0; 3].map(|_| (amplitude * random.normal()) as f32);
        splats.sh.extend(rgb);
    }
}

/// Exactly `count` splats with the look of a scene: a sample of them, or all and further ones drawn from them; their
/// sizes follow the law above.
pub fn exactly(splats: &Splats, count: usize, seed: u64) -> Splats {
    let (random, have) = (&mut Random::new(seed), splats.len());
    if have == 0 {
        return splats.clone();
    }
    let order = random.permutation(have);
    let from: Vec<usize> = (0..count).map(|i| order[i % have]).collect();
    let mut result = splats.picked(&from);
    for i in have..count {
        // Offset from the splat it is drawn from, by that splat's smallest standard deviation.
        let [x, y, z] = result.log_scale[i];
        let reach = x.min(y).min(z).exp();
        result.mean[i] = result.mean[i].map(|m| m + reach * random.normal() as f32);
    }
    let grow = (0.5 * (have as f64 / count.max(1) as f64).ln()) as f32;
    for log_scale in result.log_scale.iter_mut().flatten() {
        *log_scale += grow;
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bounding squares of the splats before the image, in areas of the image.
    fn overlap(splats: &Splats, aspect: f64) -> f64 {
        let squares = splats.mean.iter().zip(&splats.log_scale).map(|(mean, scale)| {
            let sigma = scale.iter().map(|s| f64::from(s.exp())).sum::<f64>() / 3.0;
            (SIDE * sigma / f64::from(mean[2])).powi(2)
        });
        squares.sum::<f64>() / ((1.0 + 2.0 * MARGIN) * (aspect + 2.0 * MARGIN))
    }

    #[test]
    fn pictures_are_covered_alike_by_any_number() {
        let few = overlap(&splats(2_000, 0, 0.5625, 1), 0.5625);
        let many = overlap(&splats(200_000, 0, 0.5625, 2), 0.5625);
        assert!((few / many - 1.0).abs() < 0.15, "{few} {many}");
        // Varied sizes cover more than equal ones would: e^(2 · 0.25) for the size alone.
        assert!((OVERLAP..3.0 * OVERLAP).contains(&many), "{many}");
    }

    #[test]
    fn a_scene_of_another_number_covers_as_much() {
        let scene = splats(10_000, 1, 0.75, 3);
        for count in [1, 2_500, 10_000, 37_001] {
            let other = exactly(&scene, count, 4);
            assert_eq!((other.len(), other.sh.len()), (count, 12 * count));
            if count > 1 {
                let ratio = overlap(&other, 0.75) / overlap(&scene, 0.75);
                assert!((0.8..1.4).contains(&ratio), "{count}: {ratio}");
            }
        }
        let giant = with_giant(&scene);
        assert_eq!(giant.len(), 10_001);
        assert!(exactly(&Splats::default(), 5, 0).is_empty());
    }
}
