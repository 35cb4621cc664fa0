//! Materials: band-limited solid textures, a soft light, highlights.
//!
//! Colours are display-referred, as in photographs; light is not linear. Training only needs smooth shading and
//! view-dependent highlights.

use super::random::KeyedRandom;
use glam::DVec3;

/// A colour, 0 to 1, or light that may exceed 1.
pub(super) type Color = DVec3;

/// Solid texture: a colour for every point of space. The shortest wavelength is bounded, so that a few samples per
/// pixel show it without aliasing.
#[derive(Clone, Debug)]
pub struct Texture {
    base: Color,
    waves: Vec<Wave>,
}

/// One ripple: amplitude · sin(vector · p + phase), with crests flattened towards stripes.
#[derive(Clone, Copy, Debug)]
struct Wave {
    /// Radians per world unit.
    vector: DVec3,
    phase: f64,
    amplitude: Color,
    /// 0: a sine; 1: its steepest form, s / √(s² + 0.1), close to stripes.
    steepness: f64,
}

impl Texture {
    /// `base` with ripples in random directions and colours, with wavelengths from `finest` to eight times that.
    /// `contrast` is their largest total deviation in a channel.
    pub fn ripples(base: [f64; 3], contrast: f64, finest: f64, seed: u64) -> Texture {
        const COUNT: usize = 7;
        let mut random = KeyedRandom::new(seed, 0);
        let wave = |i: usize| {
            let wavelength = finest * 8.0_f64.powf(i as f64 / (COUNT - 1) as f64);
            let tint = 0.7 * DVec3::ONE + 0.6 * random.direction();
            Wave {
                vector: random.direction() * std::f64::consts::TAU / wavelength,
                phase: random.between(0.0, std::f64::consts::TAU),
                amplitude: contrast / COUNT as f64 * tint,
                steepness: 0.0,
            }
        };
        Texture {
            base: base.into(),
            waves: (0..COUNT).map(wave).collect(),
        }
    }

    /// Adds stripes of ± `amplitude` across `axis`, `distance` apart; their soft edges are about a sixth of the
    /// distance wide.
    pub fn striped(mut self, axis: [f64; 3], distance: f64, amplitude: [f64; 3]) -> Texture {
        self.waves.push(Wave {
            vector: DVec3::from(axis).normalize() * std::f64::consts::TAU / distance,
            phase: 0.0,
            amplitude: amplitude.into(),
            steepness: 1.0,
        });
        self
    }

    /// Colour at a point in object coordinates.
    pub(super) fn at(&self, point: DVec3) -> Color {
        let mut color = self.base;
        for wave in &self.waves {
            let sine = (wave.vector.dot(point) + wave.phase).sin();
            let steep = sine / (sine * sine + 0.1).sqrt();
            color += (sine + wave.steepness * (steep - sine)) * wave.amplitude;
        }
        color.clamp(DVec3::ZERO, DVec3::ONE)
    }
}

/// Share of ambient light; the lamp gives the rest.
const AMBIENT: f64 = 0.45;

/// Direction of the wide, distant lamp; not normalised.
const LAMP: DVec3 = DVec3::new(-0.5, -0.8, 1.2);

/// Reflectance of a surface.
#[derive(Clone, Debug)]
pub struct Material {
    /// Colour under full light.
    pub texture: Texture,
    /// Light added in the mirror direction of the lamp; 0: matt.
    pub gloss: f64,
    /// Phong's exponent: the highlight falls to half at about 67° / √shininess from its centre.
    pub shininess: f64,
}

impl Material {
    /// A surface without view dependence.
    pub fn matt(texture: Texture) -> Material {
        Material {
            texture,
            gloss: 0.0,
            shininess: 1.0,
        }
    }

    /// A surface with highlights.
    pub fn glossy(texture: Texture, gloss: f64, shininess: f64) -> Material {
        Material {
            texture,
            gloss,
            shininess,
        }
    }

    /// Colour under the lamp and a sky above (+z), of which the share `openness` arrives, at the point `local` of the
    /// object. The world's unit vectors `normal` and `incident` point towards the viewer and away from it.
    pub(super) fn shade(&self, local: DVec3, normal: DVec3, incident: DVec3, openness: f64) -> Color {
        let lamp = LAMP.normalize();
        // A wide lamp lights a little beyond the terminator, without the edge of a small one.
        let facing = (0.5 + 0.5 * normal.dot(lamp)).powi(2);
        let sky = 0.7 + 0.3 * normal.z;
        let light = openness * AMBIENT * sky + (0.5 + 0.5 * openness) * (1.0 - AMBIENT) * facing;
        let mut color = light * self.texture.at(local);
        if self.gloss > 0.0 {
            let mirrored = incident - 2.0 * incident.dot(normal) * normal;
            let highlight = mirrored.dot(lamp).max(0.0).powf(self.shininess);
            color += self.gloss * highlight * DVec3::new(1.0, 0.97, 0.9);
        }
        color.min(DVec3::ONE)
    }
}
