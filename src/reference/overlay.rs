//! A pixel of splats over a host's pixel.

/// Display value of linear light (IEC 61966-2-1).
pub fn encoded(light: f64) -> f64 {
    match light <= 0.003_130_8 {
        true => 12.92 * light,
        false => 1.055 * light.powf(1.0 / 2.4) - 0.055,
    }
}

/// Linear light of a display value from 0 to 8: the inverse of [`encoded`], by bisection.
pub fn decoded(value: f64) -> f64 {
    let (mut low, mut high) = (0.0, 256.0);
    for _ in 0..100 {
        let middle = (low + high) / 2.0;
        match encoded(middle) < value {
            true => low = middle,
            false => high = middle,
        }
    }
    low
}

/// Premultiplied colour of the splats and their transmittance over a host's pixel of display values: the equation of
/// compositing, with the host's pixel as the last layer.
pub fn over_display(color: [f64; 3], transmittance: f64, below: [f64; 4]) -> [f64; 4] {
    let [red, green, blue] = color;
    let above = [red, green, blue, 1.0 - transmittance];
    std::array::from_fn(|i| above[i] + transmittance * below[i])
}

/// The same over a host's pixel of linear light, in which a display value of 1 has the light `gain`. The mean colour of
/// the splats is decoded, since they are blended as display values.
pub fn over_linear(color: [f64; 3], transmittance: f64, below: [f64; 4], gain: f64) -> [f64; 4] {
    let alpha = 1.0 - transmittance;
    let light = color.map(|color| match alpha > 0.0 {
        true => alpha * gain * decoded(color / alpha),
        false => 0.0,
    });
    over_display(light, transmittance, below)
}
