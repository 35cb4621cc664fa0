//! Cameras between key cameras: a smooth path through all of them.
//!
//! Positions lie on a centripetal Catmull–Rom curve (Yuksel, Schaefer and Keyser 2011), which has neither cusps nor
//! loops between keys; its knots are apart by the square roots of the distances. Rotations are the same of quaternions,
//! as cumulative Bézier curves (Kim, Kim and Shin 1995), with knots by angles. Logarithms of focal lengths, and
//! principal points as shares of the size, are cubic.

use super::Camera;
use glam::{DMat3, DQuat, DVec2, DVec3};

/// The key cameras with `between` cameras after each of them but the last, or after every one if the path is closed.
/// Key cameras are kept to the bit; all of them must have one size.
///
/// Between two keys, frames are even in the curve's parameter: the directions of travel and turn are continuous at
/// keys, their speeds follow the distances and angles of the keys.
///
/// # Panics
/// If sizes differ.
pub fn cameras_between(keys: &[Camera], between: u32, is_closed: bool) -> Vec<Camera> {
    let Some(first) = keys.first() else {
        return Vec::new();
    };
    let size = (first.width, first.height);
    assert!(
        keys.iter().all(|k| (k.width, k.height) == size),
        "key cameras of one size"
    );
    if keys.len() == 1 {
        return keys.to_vec();
    }
    let segments = if is_closed { keys.len() } else { keys.len() - 1 };
    let mut path = Vec::with_capacity(segments * (between as usize + 1) + 1);
    for segment in 0..segments {
        path.push(keys[segment]);
        let curve = KeySegment::of(keys, segment, is_closed);
        path.extend((1..=between).map(|i| curve.at(f64::from(i) / f64::from(between + 1))));
    }
    if !is_closed {
        path.push(keys[segments]);
    }
    path
}

/// Ends and tangents of a cubic, over a parameter from 0 to 1.
struct Cubic<V> {
    ends: [V; 2],
    tangents: [V; 2],
}

impl<V: Copy + std::ops::Add<Output = V> + std::ops::Mul<f64, Output = V>> Cubic<V> {
    /// Hermite's form.
    fn at(&self, t: f64) -> V {
        let rest = 1.0 - t;
        let ([a, b], [leaving, arriving]) = (self.ends, self.tangents);
        a * (rest * rest * (1.0 + 2.0 * t))
            + b * (t * t * (3.0 - 2.0 * t))
            + leaving * (rest * rest * t)
            + arriving * (-t * t * rest)
    }
}

/// Curve between two key cameras.
struct KeySegment {
    from: Camera,
    position: Cubic<DVec3>,
    /// Logarithm.
    focal: Cubic<DVec2>,
    /// Share of the size.
    center: Cubic<DVec2>,
    rotation: DQuat,
    /// Turns from `rotation` on.
    turns: [DVec3; 3],
}

impl KeySegment {
    fn of(keys: &[Camera], segment: usize, is_closed: bool) -> KeySegment {
        let count = keys.len();
        let [from, to] = [segment, segment + 1].map(|i| keys[i % count]);
        let before = match segment {
            0 if !is_closed => None,
            _ => Some(keys[(segment + count - 1) % count]),
        };
        let after = match segment + 2 < count || is_closed {
            true => Some(keys[(segment + 2) % count]),
            false => None,
        };
        let step = to.position - from.position;
        let into = before.map_or(step, |before| from.position - before.position);
        let out = after.map_or(step, |after| after.position - to.position);
        let length = knots(step);
        let size = DVec2::new(from.width.into(), from.height.into());
        let logarithm = |camera: &Camera| DVec2::new(camera.focal.x.ln(), camera.focal.y.ln());
        let share = |camera: &Camera| camera.center / size;
        let even = |of: &dyn Fn(&Camera) -> DVec2| {
            let (a, b) = (of(&from), of(&to));
            let a_before = before.map_or(2.0 * a - b, |camera| of(&camera));
            let b_after = after.map_or(2.0 * b - a, |camera| of(&camera));
            Cubic {
                ends: [a, b],
                tangents: [0.5 * (b - a_before), 0.5 * (b_after - a)],
            }
        };
        let turn = |camera: &Camera| DQuat::from_mat3(&camera.rotation);
        let rotation = [&from, &to].map(turn);
        KeySegment {
            from,
            position: Cubic {
                ends: [from.position, to.position],
                tangents: [velocity(into, step) * length, velocity(step, out) * length],
            },
            focal: even(&logarithm),
            center: even(&share),
            rotation: rotation[0],
            turns: turns(before.as_ref().map(turn), rotation, after.as_ref().map(turn)),
        }
    }

    fn at(&self, t: f64) -> Camera {
        let focal = self.focal.at(t);
        let size = DVec2::new(self.from.width.into(), self.from.height.into());
        Camera {
            position: self.position.at(t),
            focal: DVec2::new(focal.x.exp(), focal.y.exp()),
            center: self.center.at(t) * size,
            rotation: DMat3::from_quat(self.turn(t)),
            ..self.from
        }
    }

    /// Cubic Bézier curve of rotations in cumulative form.
    fn turn(&self, t: f64) -> DQuat {
        let rest = 1.0 - t;
        let shares = [1.0 - rest * rest * rest, t * t * (3.0 - 2.0 * t), t * t * t];
        let steps = self.turns.iter().zip(shares);
        let turned = steps.fold(self.rotation, |q, (turn, share)| {
            q * DQuat::from_scaled_axis(share * *turn)
        });
        turned.normalize()
    }
}

/// Distance of the knots of two positions.
fn knots(step: DVec3) -> f64 {
    step.length().sqrt()
}

/// Derivative of the curve by its knots, at the position between two steps.
fn velocity(into: DVec3, out: DVec3) -> DVec3 {
    let (before, after) = (knots(into), knots(out));
    match (before > 0.0, after > 0.0) {
        (true, true) => into / before - (into + out) / (before + after) + out / after,
        // A camera that stands still: it starts, or comes to rest, along the other step.
        (false, true) => out / after,
        (true, false) => into / before,
        (false, false) => DVec3::ZERO,
    }
}

/// Turns between the control points of two rotations' Bézier curve, by the rotations before and after them: as of
/// positions, with knots apart by the square roots of the angles, so that a small turn between two large ones does not
/// swing to and fro.
fn turns(before: Option<DQuat>, [from, to]: [DQuat; 2], after: Option<DQuat>) -> [DVec3; 3] {
    let turn = shorter(from, to);
    let into = before.map_or(turn, |before| shorter(before, from));
    let out = after.map_or(turn, |after| shorter(to, after));
    let length = knots(turn);
    // The curve leaves with three times the first turn, and arrives with three times the last one.
    let [first, last] = [velocity(into, turn), velocity(turn, out)].map(|velocity| velocity * length / 3.0);
    let [left, right] = [first, last].map(DQuat::from_scaled_axis);
    [first, shorter(from * left, to * right.conjugate()), last]
}

/// Turn from one rotation to another in the axes of the first, the shorter way: axis times angle.
fn shorter(from: DQuat, to: DQuat) -> DVec3 {
    let relative = from.conjugate() * to;
    let relative = if relative.w < 0.0 { -relative } else { relative };
    relative.to_scaled_axis()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn key(position: DVec3, rotation: DQuat, focal: f64) -> Camera {
        Camera {
            width: 80,
            height: 60,
            focal: DVec2::splat(focal),
            center: DVec2::new(40.0, 30.0),
            rotation: DMat3::from_quat(rotation),
            position,
        }
    }

    fn ring(count: u32) -> Vec<Camera> {
        let at = |i: u32| {
            let angle = TAU * f64::from(i) / f64::from(count);
            let place = 3.0 * DVec3::new(angle.cos(), 0.0, angle.sin());
            key(place, DQuat::IDENTITY, 50.0).look_at(place, DVec3::ZERO, DVec3::NEG_Y)
        };
        (0..count).map(at).collect()
    }

    /// Keys at uneven distances with turns about changing axes.
    fn uneven() -> Vec<Camera> {
        let keys = [(0.0, 0.2), (0.1, 0.9), (2.0, -0.5), (2.2, 1.5), (7.0, 0.3)];
        let place = |(i, (x, turn)): (usize, &(f64, f64))| {
            let axis = DVec3::new(1.0, i as f64, -0.5).normalize();
            let position = DVec3::new(*x, turn * 2.0, (3.0 * x).sin());
            key(position, DQuat::from_axis_angle(axis, *turn), 40.0 + 10.0 * x)
        };
        keys.iter().enumerate().map(place).collect()
    }

    fn turn_between(a: &Camera, b: &Camera) -> DVec3 {
        let relative = DQuat::from_mat3(&(b.rotation * a.rotation.transpose()));
        let relative = if relative.w < 0.0 { -relative } else { relative };
        relative.to_scaled_axis()
    }

    #[test]
    fn keys_are_kept_to_the_bit() {
        let keys = uneven();
        for (is_closed, count) in [(false, 4 * 4 + 1), (true, 5 * 4)] {
            let path = cameras_between(&keys, 3, is_closed);
            assert_eq!(path.len(), count);
            assert!(path.iter().step_by(4).eq(&keys), "closed: {is_closed}");
        }
        assert_eq!(cameras_between(&keys, 0, false), keys);
        assert_eq!(cameras_between(&keys[..1], 9, true), keys[..1]);
        assert_eq!(cameras_between(&[], 9, true), []);
    }

    #[test]
    fn even_keys_on_a_circle_are_turned_about_evenly() {
        let keys = ring(8);
        let path = cameras_between(&keys, 9, true);
        let step = TAU / 80.0;
        for (i, camera) in path.iter().enumerate() {
            let next = &path[(i + 1) % path.len()];
            assert!((turn_between(camera, next).length() - step).abs() < 1e-12, "{i}");
            // Half way the cubic is at 9/8 cos(π/8) − 1/8 cos(3π/8) = 0.9915 of the radius.
            let radius = camera.position.length() / 3.0;
            assert!((0.9915..1.0 + 1e-12).contains(&radius), "{i}: {radius}");
            let square = camera.rotation * camera.rotation.transpose();
            assert!(square.abs_diff_eq(DMat3::IDENTITY, 1e-12));
        }
    }

    /// Velocities by the knots agree before and behind a key, between which ways lie. One of `between` steps has a
    /// thousandth of the acceleration, about 6 ways for a segment.
    #[track_caller]
    fn assert_continuous(steps: [DVec3; 2], ways: [DVec3; 2], between: u32) {
        let knots = ways.map(knots);
        let [before, after] = [0, 1].map(|i| steps[i] * f64::from(between + 1) / knots[i]);
        assert!(
            before.distance(after) < 2e-2 * (knots[0] + knots[1]),
            "{before}, {after}"
        );
    }

    #[test]
    fn direction_and_turn_are_continuous_at_keys() {
        let keys = uneven();
        let between = 999;
        for is_closed in [false, true] {
            let path = cameras_between(&keys, between, is_closed);
            let stride = between as usize + 1;
            for at in (stride..path.len() - 1).step_by(stride) {
                let [a, b, c] = [at - 1, at, at + 1].map(|i| path[i]);
                let [before, after] = [at - stride, (at + stride) % path.len()].map(|i| path[i]);
                let steps = [b.position - a.position, c.position - b.position];
                let ways = [b.position - before.position, after.position - b.position];
                assert_continuous(steps, ways, between);
                let ways = [turn_between(&before, &b), turn_between(&b, &after)];
                assert_continuous([turn_between(&a, &b), turn_between(&b, &c)], ways, between);
                let zoom = [a, b, c].map(|camera| camera.focal.x.ln());
                assert!((zoom[2] - 2.0 * zoom[1] + zoom[0]).abs() < 1e-5, "{at}: {zoom:?}");
            }
        }
        // Straight lines between the same keys have corners.
        let ways = [keys[1].position - keys[0].position, keys[2].position - keys[1].position];
        let [before, after] = ways.map(|way| way / knots(way));
        assert!(before.distance(after) > 0.5);
    }

    #[test]
    fn two_keys_are_a_straight_way_with_even_zoom() {
        let turned = DQuat::from_rotation_y(1.0);
        let ends = [
            key(DVec3::ZERO, DQuat::IDENTITY, 100.0),
            key(DVec3::X * 4.0, turned, 400.0),
        ];
        let path = cameras_between(&ends, 1, false);
        assert!(path[1].position.distance(DVec3::X * 2.0) < 1e-12);
        assert!((path[1].focal - DVec2::splat(200.0)).length() < 1e-9);
        let half = DMat3::from_quat(DQuat::from_rotation_y(0.5));
        assert!(path[1].rotation.abs_diff_eq(half, 1e-12), "{}", path[1].rotation);
    }

    #[test]
    fn cameras_that_stand_still_turn_in_place_the_shorter_way() {
        let turn = |degrees: f64| key(DVec3::ONE, DQuat::from_rotation_x(degrees.to_radians()), 50.0);
        // Quaternions of successive keys lie in opposite half spaces.
        let keys = [turn(0.0), turn(170.0), turn(190.0), turn(350.0)];
        let path = cameras_between(&keys, 49, true);
        for pair in path.windows(2) {
            assert!(pair[0].position.distance(DVec3::ONE) < 1e-12);
            // Forward only, and at most at twice the mean speed of the largest turn.
            let turn = turn_between(&pair[0], &pair[1]).x;
            assert!((0.0..6.8_f64.to_radians()).contains(&turn), "{turn}");
        }
        let moved = [turn(0.0), turn(0.0), key(DVec3::ZERO, DQuat::IDENTITY, 50.0)];
        let path = cameras_between(&moved, 9, false);
        assert!(path.iter().all(|c| c.position.is_finite() && c.focal.is_finite()));
        assert!(path[..11].iter().all(|c| c.position.distance(DVec3::ONE) < 1e-12));
    }
}
