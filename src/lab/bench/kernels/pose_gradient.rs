//! Case of `pose_gradient`: from the gradients of splats to force and torque about the camera.

use super::project_backward::SplatSums;
use super::{KernelCase, counts};
use crate::Result;
use crate::gpu::{Buffer, Gpu, Groups};
use crate::kernels::pose_gradient::{Bindings, Choice, Params, PoseGradient};
use crate::lab::bench::Work;
use crate::lab::bench::check::{Output, floats};
use crate::lab::bench::input::lists::{view, viewpoint};
use crate::lab::bench::input::pack;
use crate::lab::bench::input::scene::Scene;
use crate::layout::{D_COLOR_PLANE, DIRECTION_PLANE, GRADIENT_PLANES, POSE_SPLATS};
use crate::reference::Splat;
use crate::reference::linear::{dot, normalize, sub, vector};
use crate::reference::pose_gradient::pose_gradient as gradient_by_pose;
use crate::render::planes_from_splats;
use crate::scene::SH_C0;
use rayon::prelude::*;

/// Gradients of a scene's splats, as `project_backward` writes them.
pub struct SplatForces {
    sums: SplatSums,
    /// Gradients in planes.
    pub planes: Vec<[f32; 4]>,
    /// Largest force and torque that each splat's terms can have.
    sizes: Vec<[f64; 2]>,
}

impl SplatForces {
    /// Gradients from random sums.
    pub fn new(scene: &Scene, filters: &[f32]) -> SplatForces {
        let sums = SplatSums::new(scene, filters);
        let count = scene.splats.len();
        let rows: Vec<Vec<f64>> = (0..count).into_par_iter().map(|i| sums.expected(i).0).collect();
        let mut planes = vec![[0.0; 4]; GRADIENT_PLANES as usize * count];
        let mut sizes = Vec::new();
        for (i, row) in rows.iter().enumerate() {
            let splat = Splat::<f64>::of(&scene.splats, i);
            let away = sub(splat.mean, vector(scene.camera.position));
            let mut set = |plane: usize, values: &[f64]| {
                let lanes = planes[plane * count + i].iter_mut().zip(values);
                lanes.for_each(|(lane, &value)| *lane = value as f32);
            };
            let d_color: Vec<f64> = row[11..14].iter().map(|d| d / f64::from(SH_C0)).collect();
            set(0, &row[..3]);
            set(1, &row[3..7]);
            set(D_COLOR_PLANE as usize, &d_color);
            set(DIRECTION_PLANE as usize, &normalize(away));
            let length = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
            let force = length(&row[..3]);
            // Slopes of the basis functions are below 4.
            let harmonics: f64 = splat.sh.iter().skip(1).flatten().map(|c| 4.0 * c.abs()).sum();
            let torque = dot(away, away).sqrt() * force
                + 0.5 * length(&splat.quaternion) * length(&row[3..7])
                + harmonics * length(&d_color);
            sizes.push([force, torque]);
        }
        SplatForces { sums, planes, sizes }
    }

    /// Force, torque, and the sums of their terms' sizes, of the splats of one workgroup.
    fn expected(&self, splats: std::ops::Range<usize>) -> ([[f64; 3]; 2], [f64; 2]) {
        let scene = &self.sums.scene;
        let part: Vec<Splat<f64>> = splats.clone().map(|i| Splat::of(&scene.splats, i)).collect();
        let by_screen = self.sums.by_screen();
        let filters = &self.sums.filters[splats.clone()];
        let [position, turn] = gradient_by_pose(&part, filters, &viewpoint(scene), &by_screen[splats.clone()]);
        let sum = |k: usize| self.sizes[splats.clone()].iter().map(|size| size[k]).sum::<f64>();
        ([position.map(|d| -d), turn], [sum(0), sum(1)])
    }
}

/// Scattered splats without filters.
pub fn scattered<'a>(gpu: &Gpu, scene: &Scene) -> Result<KernelCase<'a, PoseGradient>> {
    pose_gradient(gpu, SplatForces::new(scene, &[]))
}

/// Sums of these gradients.
pub fn pose_gradient<'a>(gpu: &Gpu, forces: SplatForces) -> Result<KernelCase<'a, PoseGradient>> {
    let (count, size) = (forces.planes.len() / GRADIENT_PLANES as usize, POSE_SPLATS as usize);
    let partials = gpu.buffer::<[f32; 4]>("sums_from_group", 2 * count.div_ceil(size))?;
    let case = commands(gpu, &forces, &[], &partials)?;
    Ok(case.compare(&partials, move |all| {
        let (mut found, mut wanted) = (Vec::new(), Vec::new());
        for (group, first) in (0..count).step_by(size).enumerate() {
            let (expected, sizes) = forces.expected(first..(first + size).min(count));
            for (k, (expected, size)) in expected.iter().zip(sizes).enumerate() {
                // Units in which the largest number is 1, for sums that cancel are judged by their terms.
                let unit = expected.iter().fold(1e-30, |most: f64, d| most.max(d.abs()));
                let slack = (size / unit).max(1.0);
                let row = floats(&all[2 * group + k..=2 * group + k]);
                found.extend(
                    row[..3]
                        .iter()
                        .zip(expected)
                        .map(|(f, e)| e / unit + (f - e) / unit / slack),
                );
                wanted.extend(expected.iter().map(|e| e / unit));
            }
        }
        // A lane adds up 128 terms at 8 lanes, and then the lanes' sums: 136u = 8e-6 of the terms' sizes, beside ten
        // roundings of each.
        vec![Output::relative("sums", found, wanted, 1e-5, 1.0)]
    }))
}

/// Commands with some `counts` set; sums into `partials`.
pub fn commands<'a>(
    gpu: &Gpu,
    forces: &SplatForces,
    slots: &[(u32, u32)],
    partials: &Buffer<[f32; 4]>,
) -> Result<KernelCase<'a, PoseGradient>> {
    let scene = &forces.sums.scene;
    let (count, degree) = (scene.splats.len(), scene.splats.sh_degree);
    let mut planes = planes_from_splats(&scene.splats);
    pack::set_filters(&mut planes, &forces.sums.filters);
    let view = gpu.buffer_from("view", &[view(scene)])?;
    let counts = counts(gpu, slots)?;
    let params = gpu.buffer_from("params", &planes)?;
    let d_params = gpu.buffer_from("d_params", &forces.planes)?;
    let partials = partials.clone();
    let bytes = 16 * (planes.len() / count.max(1) + 3);
    let case = KernelCase::new(Work::of(count, "splats").moving(bytes * count));
    let case = case.tune(move |choice: &mut Choice| choice.spec.sh_degree = degree);
    Ok(case.commands(move |rec, kernel: &PoseGradient, _| {
        let io = Bindings {
            view: &view,
            counts: &counts,
            params: &params,
            d_params: &d_params,
            sums_from_group: &partials,
        };
        let params = Params {
            splat_count: count as u32,
            stride: count as u32,
            first_group: 0,
        };
        kernel.record(rec, io, params, Groups::Count((count as u32).div_ceil(POSE_SPLATS)));
    }))
}
