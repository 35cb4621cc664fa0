//! Optimiser state on the CPU: parameters and both Adam moments, in the planes of the device.
//!
//! A row is one splat: its parameters, first and second moments, always moved together ([`HostState::select`]), so that
//! moments stay with their splat through every refinement.

use super::filter::{baked, opacity_factor};
use crate::layout::GEOMETRY_PLANES;
use crate::render::plane_count;
use crate::scene::{Primitive, ScreenFilter, Splats, sh_coefficient_count, sigmoid};

/// `[plane][splat]`: plane 0 is mean x, y, z and opacity logit; 1 the quaternion w, x, y, z; 2 log-scale x, y, z and
/// the standard deviation of the [smoothing filter](super::smoothing) in world units (0: none), which is no parameter
/// and has no gradient; from 3 on the SH coefficients, `[coefficient][rgb]` flattened, four a plane, zero padded.
pub type Planes = Vec<Vec<[f32; 4]>>;

/// First plane of the SH coefficients.
pub const SH_PLANE: usize = GEOMETRY_PLANES as usize;

/// Parameters and Adam moments of all splats.
#[derive(Clone, Debug, PartialEq)]
pub struct HostState {
    /// Kind of the splats.
    pub primitive: Primitive,
    /// Highest SH degree with planes, 0 to 3.
    pub sh_degree: u32,
    /// SH degree of every splat, at most `sh_degree`; coefficients above it are zero and stay zero.
    pub degrees: Vec<u8>,
    /// Parameters.
    pub params: Planes,
    /// First moments, in the parameters' layout; none, as harmonics, in a state of geometry alone.
    pub m: Planes,
    /// Second moments, in the parameters' layout.
    pub v: Planes,
}

impl HostState {
    /// `count` rows of zeros.
    pub fn zeros(count: usize, sh_degree: u32) -> HostState {
        let planes = || vec![vec![[0.0; 4]; count]; plane_count(sh_degree)];
        HostState {
            primitive: Primitive::default(),
            sh_degree,
            degrees: vec![sh_degree as u8; count],
            params: planes(),
            m: planes(),
            v: planes(),
        }
    }

    /// A state with zero moments, its SH degree raised with zeros or cut to `sh_degree`.
    pub fn from_splats(splats: &Splats, sh_degree: u32) -> HostState {
        let mut state = HostState::zeros(splats.len(), sh_degree);
        state.primitive = splats.primitive;
        let stride = splats.sh_stride();
        let kept = stride.min(sh_coefficient_count(sh_degree) * 3);
        for i in 0..splats.len() {
            let [x, y, z] = splats.mean[i];
            let [sx, sy, sz] = splats.log_scale[i];
            state.params[0][i] = [x, y, z, splats.opacity_logit[i]];
            state.params[1][i] = splats.quaternion[i];
            state.params[2][i] = [sx, sy, sz, 0.0];
            let coefficients = &splats.sh[i * stride..][..kept];
            for (plane, four) in coefficients.chunks(4).enumerate() {
                state.params[SH_PLANE + plane][i][..four.len()].copy_from_slice(four);
            }
        }
        state
    }

    /// The parameters as splats of the highest degree in use, the smoothing filter baked into their scales and
    /// opacities.
    pub fn to_splats(&self, filter: ScreenFilter) -> Splats {
        let highest = self.degrees.iter().max();
        let sh_degree = highest.map_or(self.sh_degree, |&degree| u32::from(degree));
        let stride = sh_coefficient_count(sh_degree) * 3;
        let mut sh = Vec::with_capacity(self.len() * stride);
        for i in 0..self.len() {
            let fours = self.params[SH_PLANE..].iter().flat_map(|plane| plane[i]);
            sh.extend(fours.take(stride));
        }
        let xyz = |four: &[f32; 4]| [four[0], four[1], four[2]];
        let shapes = self.params[2].iter().zip(&self.params[0]);
        let (log_scale, opacity_logit) = shapes
            .map(|(shape, place)| baked(xyz(shape), place[3], shape[3], self.primitive))
            .unzip();
        let mut splats = Splats {
            mean: self.params[0].iter().map(xyz).collect(),
            quaternion: self.params[1].clone(),
            log_scale,
            opacity_logit,
            sh,
            sh_degree,
            primitive: self.primitive,
            filter,
            ..Splats::default()
        };
        splats.set_thickness();
        splats
    }

    /// Number of splats.
    pub fn len(&self) -> usize {
        self.params[0].len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Row `i` of the result is row `sources[i]` of this state, parameters and moments alike.
    ///
    /// Panics if a source is not below [`HostState::len`].
    pub fn select(&self, sources: &[u32]) -> HostState {
        let gather = |planes: &Planes| -> Planes {
            let rows = |plane: &Vec<[f32; 4]>| sources.iter().map(|&s| plane[s as usize]).collect();
            planes.iter().map(rows).collect()
        };
        HostState {
            primitive: self.primitive,
            sh_degree: self.sh_degree,
            degrees: sources.iter().map(|&s| self.degrees[s as usize]).collect(),
            params: gather(&self.params),
            m: gather(&self.m),
            v: gather(&self.v),
        }
    }

    /// Appends another state's rows.
    ///
    /// Panics if the SH degrees differ.
    pub fn append(&mut self, other: &HostState) {
        assert_eq!(self.sh_degree, other.sh_degree, "colour degrees differ");
        self.degrees.extend_from_slice(&other.degrees);
        for (into, from) in [
            (&mut self.params, &other.params),
            (&mut self.m, &other.m),
            (&mut self.v, &other.v),
        ] {
            for (plane, rows) in into.iter_mut().zip(from) {
                plane.extend_from_slice(rows);
            }
        }
    }

    /// Removes each splat's SH coefficients and moments above a degree, permanently: they are neither stored on the
    /// device nor trained any more. A degree above a splat's own changes nothing.
    ///
    /// Panics unless there is a degree for every splat.
    pub fn lower_degrees(&mut self, degrees: &[u8]) {
        assert_eq!(self.len(), degrees.len(), "one degree per splat");
        for (row, &wanted) in degrees.iter().enumerate() {
            if wanted >= self.degrees[row] {
                continue;
            }
            self.degrees[row] = wanted;
            let kept = sh_coefficient_count(wanted.into()) * 3;
            for planes in [&mut self.params, &mut self.m, &mut self.v] {
                let fours = planes[SH_PLANE..].iter_mut().map(|plane| &mut plane[row]);
                let numbers = fours.flatten().skip(kept);
                numbers.for_each(|number| *number = 0.0);
            }
        }
    }

    /// Replaces the SH coefficients of all splats, in the order of `splats`, and keeps moments.
    ///
    /// Panics unless there is a colour for every splat.
    pub fn recolor(&mut self, splats: &Splats) {
        assert_eq!(self.len(), splats.len(), "one colour per splat");
        for (row, color) in splats.sh.chunks_exact(splats.sh_stride()).enumerate() {
            let planes = self.params[SH_PLANE..].iter_mut();
            let numbers = planes.flat_map(|plane| &mut plane[row]);
            numbers.zip(color).for_each(|(number, &value)| *number = value);
        }
    }

    /// Sets the moments of a row to zero, as for a new or moved splat.
    pub fn clear_moments(&mut self, row: usize) {
        for plane in self.m.iter_mut().chain(&mut self.v) {
            plane[row] = [0.0; 4];
        }
    }

    /// Centre of a row, world units.
    pub fn mean(&self, row: usize) -> [f32; 3] {
        let [x, y, z, _] = self.params[0][row];
        [x, y, z]
    }

    /// Factor of the smoothing filter on the opacity of a row, 0 to 1.
    pub fn smoothing_factor(&self, row: usize) -> f64 {
        let [x, y, z, sigma] = self.params[2][row];
        opacity_factor([x, y, z], sigma, self.primitive)
    }

    /// Opacity of a row before smoothing, 0 to 1 (NaN if the logit is).
    pub fn opacity(&self, row: usize) -> f64 {
        sigmoid(f64::from(self.params[0][row][3]))
    }

    /// Largest standard deviation of a row that is drawn, world units.
    pub fn max_scale(&self, row: usize) -> f64 {
        let scales = self.params[2][row].into_iter().take(self.primitive.scale_count());
        f64::from(scales.fold(f32::NAN, f32::max)).exp()
    }

    /// Whether a row's mean, opacity, quaternion and scales are finite; colours may be repaired, shapes may not.
    pub fn is_finite(&self, row: usize) -> bool {
        let mut shape = self.params[..SH_PLANE].iter().flat_map(|plane| plane[row]);
        shape.all(f32::is_finite)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn splats(count: usize, degree: u32) -> Splats {
        let number = |i: usize| i as f32 * 0.5 + 1.0;
        let stride = sh_coefficient_count(degree) * 3;
        Splats {
            mean: (0..count).map(|i| [number(i); 3]).collect(),
            quaternion: (0..count).map(|i| [number(i), 0.0, 1.0, 2.0]).collect(),
            log_scale: (0..count).map(|i| [-number(i), 0.0, 0.25]).collect(),
            opacity_logit: (0..count).map(number).collect(),
            sh: (0..count * stride).map(number).collect(),
            sh_degree: degree,
            ..Splats::default()
        }
    }

    #[test]
    fn planes_hold_splats_of_every_degree_exactly() {
        assert_eq!([0, 1, 2, 3].map(plane_count), [4, 6, 10, 15]);
        for degree in 0..4 {
            for count in [0, 1, 7] {
                let original = splats(count, degree);
                let state = HostState::from_splats(&original, degree);
                assert_eq!(state.len(), count);
                assert_eq!(state.params.len(), plane_count(degree));
                assert_eq!(state.to_splats(ScreenFilter::Classic), original);
            }
        }
    }

    #[test]
    fn a_degree_is_raised_with_zeros_and_cut_from_the_end() {
        let low = splats(3, 1);
        let raised = HostState::from_splats(&low, 3).to_splats(ScreenFilter::Classic);
        assert_eq!(raised.sh[48..60], low.sh[12..24]);
        assert!(raised.sh[60..96].iter().all(|&x| x == 0.0));
        let cut = HostState::from_splats(&low, 0).to_splats(ScreenFilter::Classic);
        assert_eq!(cut.sh[3..6], low.sh[12..15]);
    }

    #[test]
    fn lowered_degrees_leave_nothing_above_them() {
        let mut state = HostState::from_splats(&splats(5, 3), 3);
        for planes in [&mut state.m, &mut state.v] {
            planes.iter_mut().flatten().for_each(|four| *four = [7.0; 4]);
        }
        let before = state.clone();
        state.lower_degrees(&[3, 2, 1, 0, 3]);
        state.lower_degrees(&[3, 3, 3, 3, 2]);
        assert_eq!(state.degrees, [3, 2, 1, 0, 2]);
        for (row, &degree) in state.degrees.iter().enumerate() {
            let kept = 3 * sh_coefficient_count(degree.into());
            for (after, before) in [
                (&state.params, &before.params),
                (&state.m, &before.m),
                (&state.v, &before.v),
            ] {
                let numbers =
                    |planes: &Planes| -> Vec<f32> { planes[SH_PLANE..].iter().flat_map(|plane| plane[row]).collect() };
                let (after, before) = (numbers(after), numbers(before));
                assert_eq!(after[..kept], before[..kept]);
                assert!(after[kept..].iter().all(|&x| x == 0.0));
            }
        }
        assert_eq!(state.params[..SH_PLANE], before.params[..SH_PLANE]);
        assert_eq!(state.to_splats(ScreenFilter::Classic).sh_degree, 3);
        state.lower_degrees(&[1; 5]);
        let lowered = state.to_splats(ScreenFilter::Classic);
        assert_eq!((lowered.sh_degree, lowered.sh.len()), (1, 5 * 12));
        assert_eq!(state.select(&[3, 0, 3]).degrees, [0, 1, 0]);
    }

    #[test]
    fn rows_move_with_their_moments() {
        let mut state = HostState::from_splats(&splats(4, 1), 1);
        for (plane, rows) in state.m.iter_mut().enumerate() {
            for (i, row) in rows.iter_mut().enumerate() {
                *row = [(plane * 10 + i) as f32; 4];
            }
        }
        let mut picked = state.select(&[3, 1, 1]);
        assert_eq!(picked.m[5], vec![[53.0; 4], [51.0; 4], [51.0; 4]]);
        picked.clear_moments(1);
        assert_eq!(picked.m[5], vec![[53.0; 4], [0.0; 4], [51.0; 4]]);
        picked.append(&state);
        assert_eq!(picked.len(), 7);
        assert_eq!(picked.mean(3), state.mean(0));
    }
}
