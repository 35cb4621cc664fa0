//! Gradient by the camera's pose, by duals through projection: the camera moves, the splats stay.

use super::linear::{Mat3, Vec3, add, matrix, product, vector};
use super::project::project_from;
use super::smoothing::smoothed;
use super::{Dual, Real, Splat, Viewpoint};

/// Derivatives of the objective by the camera's pose, given those by [`ScreenSplat::row`](super::ScreenSplat::row) of
/// each splat: by its position, world units, and by a turn about its centre, a vector of radians in world axes
/// (`rotation · (1 + turn ×)`). `filters` are the splats' 3D filters.
pub fn pose_gradient(
    splats: &[Splat<f64>],
    filters: &[f32],
    view: &Viewpoint,
    by_screen: &[[f64; 10]],
) -> [[f64; 3]; 2] {
    let mut sum = Dual::of(0.0);
    for ((splat, &filter), slopes) in splats.iter().zip(filters).zip(by_screen) {
        let lifted = Splat::from_parameters(&splat.parameters().into_iter().map(Dual::of).collect::<Vec<_>>());
        let screen = project_from(&smoothed(&lifted, filter.into()), view, moved(view));
        if let Some(screen) = screen {
            let terms = screen.row().into_iter().zip(slopes);
            sum = sum + terms.map(|(number, &slope)| number * Dual::of(slope)).sum();
        }
    }
    let [x, y, z, turn @ ..] = sum.d;
    [[x, y, z], turn]
}

/// Pose of a view with its position and its turn as variables.
fn moved(view: &Viewpoint) -> (Mat3<Dual<6>>, Vec3<Dual<6>>) {
    let [dx, dy, dz, x, y, z] = [0, 1, 2, 3, 4, 5].map(|index| Dual::variable(0.0, Some(index)));
    let one = Dual::of(1.0);
    let turn = [[one, -z, y], [z, one, -x], [-y, x, one]];
    (
        product(matrix(view.camera.rotation), turn),
        add(vector(view.camera.position), [dx, dy, dz]),
    )
}
