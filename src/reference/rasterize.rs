//! Rasterisation of one pixel: every splat of the scene, front to back, over the background.
//!
//! `C = Σ cᵢ αᵢ Tᵢ + T_end · background` with `Tᵢ = Π_{j<i} (1 − αⱼ)`. The splat that takes the transmittance below the
//! threshold is still blended ("include last"), so that the stop costs at most the threshold itself.

use super::linear::{Vec3, add, scale};
use super::primitive::{depth, power};
use super::{Real, ScreenSplat, Thresholds};

/// A splat at one pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer<R> {
    /// Alpha: covered share of the light from behind.
    pub alpha: R,
    /// Colour.
    pub color: Vec3<R>,
    /// Depth, world units.
    pub depth: R,
}

/// A rendered pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel<R> {
    /// Colour, background included.
    pub color: Vec3<R>,
    /// Transmittance, the background's share.
    pub transmittance: R,
    /// `Σ αᵢ Tᵢ zᵢ`, world units; not divided by the coverage.
    pub depth: R,
}

/// Distance of a pixel from each discontinuity, as the relative change of the quantity that would reach it; infinite if
/// there is none. A comparison may excuse pixels with margins of the size of its rounding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiscontinuityMargin {
    /// min |α / alpha_min − 1| over the splats that are reached.
    pub alpha_min: f64,
    /// min |α / alpha_max − 1|: only the gradient jumps there.
    pub alpha_max: f64,
    /// min |T / transmittance_min − 1| over the transmittances met.
    pub transmittance: f64,
    /// min (zᵢ₊₁ − zᵢ) / zᵢ over neighbours in the blending order.
    pub order: f64,
}

impl DiscontinuityMargin {
    /// Smallest relative distance to a jump of the colour.
    pub fn nearest(&self) -> f64 {
        self.alpha_min.min(self.transmittance).min(self.order)
    }
}

/// `opacity · exp(−power)`, before threshold and cap.
pub fn raw_alpha<R: Real>(splat: &ScreenSplat<R>, position: [f64; 2]) -> R {
    let power = power(splat, position);
    // e⁻⁵⁰ = 2e-22 is below the rounding of any sum here.
    if power.value() > 50.0 {
        return R::of(0.0);
    }
    splat.opacity * (-power).exp()
}

/// The splat at a pixel centre, or `None` if below the alpha threshold.
pub fn layer<R: Real>(splat: &ScreenSplat<R>, position: [f64; 2], thresholds: &Thresholds) -> Option<Layer<R>> {
    let alpha = raw_alpha(splat, position);
    (alpha.value() >= thresholds.alpha_min && alpha.value() > 0.0).then(|| Layer {
        alpha: alpha.at_most(thresholds.alpha_max),
        color: splat.color,
        depth: depth(splat),
    })
}

impl<R: Real> Pixel<R> {
    /// Pixel without layers: transmittance 1.
    pub fn clear() -> Pixel<R> {
        Pixel {
            color: [R::of(0.0); 3],
            transmittance: R::of(1.0),
            depth: R::of(0.0),
        }
    }

    /// Adds a layer behind the existing ones.
    pub fn over(&self, layer: &Layer<R>) -> Pixel<R> {
        let weight = self.transmittance * layer.alpha;
        Pixel {
            color: add(self.color, scale(weight, layer.color)),
            transmittance: self.transmittance * (R::of(1.0) - layer.alpha),
            depth: self.depth + weight * layer.depth,
        }
    }

    /// Adds the background behind everything.
    pub fn over_background(&self, background: [f64; 3]) -> Pixel<R> {
        let behind = scale(self.transmittance, background.map(R::of));
        Pixel {
            color: add(self.color, behind),
            ..*self
        }
    }
}

/// Blends layers, nearest first. Returns the pixel and the number of layers blended.
pub fn composite<R: Real>(
    layers: impl IntoIterator<Item = Layer<R>>,
    background: [f64; 3],
    transmittance_min: f64,
) -> (Pixel<R>, usize) {
    let mut pixel = Pixel::<R>::clear();
    let mut count = 0;
    for layer in layers {
        if pixel.transmittance.value() < transmittance_min {
            break;
        }
        pixel = pixel.over(&layer);
        count += 1;
    }
    (pixel.over_background(background), count)
}

/// Weight `αᵢ Tᵢ` of each splat that a pixel blends, nearest first, as the difference of transmittance before and
/// behind it: `(index into splats, weight)`.
pub fn weights<R: Real>(
    splats: &[ScreenSplat<R>],
    order: &[usize],
    position: [f64; 2],
    thresholds: &Thresholds,
) -> Vec<(usize, R)> {
    let mut passing = R::of(1.0);
    let mut weights = Vec::new();
    for &index in order {
        if passing.value() < thresholds.transmittance_min {
            break;
        }
        if let Some(layer) = layer(&splats[index], position, thresholds) {
            let behind = passing * (R::of(1.0) - layer.alpha);
            weights.push((index, passing - behind));
            passing = behind;
        }
    }
    weights
}

/// Index of the splat at which the coverage of a pixel reaches ½: the first one whose weight and those before it sum up
/// to that. `None` if all of them do not.
pub fn median(
    splats: &[ScreenSplat<f64>],
    order: &[usize],
    position: [f64; 2],
    thresholds: &Thresholds,
) -> Option<usize> {
    let mut coverage = 0.0;
    let weights = weights(splats, order, position, thresholds);
    let reaches = |(_, weight): &(usize, f64)| {
        coverage += weight;
        coverage >= 0.5
    };
    weights.into_iter().find(reaches).map(|(index, _)| index)
}

/// Indices of the splats that a pixel blends, visited in the given order.
pub fn blended(
    splats: &[ScreenSplat<f64>],
    order: &[usize],
    position: [f64; 2],
    thresholds: &Thresholds,
) -> Vec<usize> {
    let weights = weights(splats, order, position, thresholds);
    weights.into_iter().map(|(index, _)| index).collect()
}

/// Renders one pixel over splats in the given order, nearest first.
pub fn rasterize<R: Real>(
    splats: &[ScreenSplat<R>],
    order: &[usize],
    position: [f64; 2],
    background: [f64; 3],
    thresholds: &Thresholds,
) -> Pixel<R> {
    let layers = order.iter().filter_map(|&i| layer(&splats[i], position, thresholds));
    composite(layers, background, thresholds.transmittance_min).0
}

/// As [`rasterize`], over the splats before a limit of depth: those up to the first at the limit or beyond.
pub fn rasterize_before<R: Real>(
    splats: &[ScreenSplat<R>],
    order: &[usize],
    position: [f64; 2],
    background: [f64; 3],
    thresholds: &Thresholds,
    limit: f64,
) -> Pixel<R> {
    let hidden = order.iter().position(|&i| depth(&splats[i]).value() >= limit);
    let before = &order[..hidden.unwrap_or(order.len())];
    rasterize(splats, before, position, background, thresholds)
}

/// [`DiscontinuityMargin`] of a pixel.
pub fn discontinuity_margin(
    splats: &[ScreenSplat<f64>],
    order: &[usize],
    position: [f64; 2],
    thresholds: &Thresholds,
) -> DiscontinuityMargin {
    let distance = |value: f64, threshold: f64| {
        if threshold > 0.0 {
            (value / threshold - 1.0).abs()
        } else {
            f64::INFINITY
        }
    };
    let none = f64::INFINITY;
    let mut margin = DiscontinuityMargin {
        alpha_min: none,
        alpha_max: none,
        transmittance: none,
        order: none,
    };
    let mut transmittance = 1.0;
    let mut depth_before = None;
    for &index in order {
        margin.transmittance = margin
            .transmittance
            .min(distance(transmittance, thresholds.transmittance_min));
        if transmittance < thresholds.transmittance_min {
            break;
        }
        let raw = raw_alpha(&splats[index], position);
        margin.alpha_min = margin.alpha_min.min(distance(raw, thresholds.alpha_min));
        margin.alpha_max = margin.alpha_max.min(distance(raw, thresholds.alpha_max));
        if let Some(layer) = layer(&splats[index], position, thresholds) {
            transmittance *= 1.0 - layer.alpha;
            if let Some(before) = depth_before.replace(layer.depth) {
                margin.order = margin.order.min((layer.depth - before) / before);
            }
        }
    }
    margin
}
