//! Baseline of the backward pass: the cases of `rasterize_backward`, summed by splat.

use crate::common::check::*;
use crate::common::lists::view;
use crate::common::{device, pack};
use crate::kernels::baseline_16x16::lists;
use crate::kernels::rasterize::cases;
use crate::kernels::rasterize_backward::{NAMES, prepare};
use crate::kernels::supported;
use ashfall::gpu::Groups;
use ashfall::kernels::baseline_16x16_backward::{Baseline16x16Backward, Bindings, Choice, Variant};

#[test]
fn every_splat_gets_its_gradient() {
    let gpu = device::gpu();
    if let Err(lack) = gpu.caps().supports(Variant::Base.info()) {
        // A baseline, which nothing else relies on: it is the baseline_16x16 kernel, with what that needs.
        println!("baseline_16x16_backward needs {lack}");
        return;
    }
    let mut check = Check::new("baseline_16x16_backward");
    for variant in supported!(baseline_16x16_backward, gpu) {
        let choice = Choice {
            variant,
            ..Choice::default()
        };
        let kernel = Baseline16x16Backward::new(&gpu, choice).unwrap();
        for (name, scene) in cases() {
            let (lists, splats) = (lists(&scene), scene.splats.len());
            let case = prepare(&scene, &lists);
            let sums = unwritten::<f32>(&gpu, 9 * splats);
            let (shapes, tones, rests) = pack::arrays(&lists.records);
            let io = Bindings {
                view: &buffer(&gpu, &[view(&scene)]),
                range_from_tile: &buffer(&gpu, &lists.range_from_tile),
                splat_from_isect: &buffer(&gpu, &lists.splat_from_isect()),
                ellipse_from_splat: &buffer(&gpu, &shapes),
                whiten_rg_from_splat: &buffer(&gpu, &tones),
                blue_depth_from_splat: &buffer(&gpu, &rests),
                image: &buffer(&gpu, &case.image),
                d_image: &buffer(&gpu, &case.d_image),
                isect_end_from_pixel: &buffer(&gpu, &case.ends),
                sum_from_splat: &sums,
            };
            gpu.run(|rec| kernel.record_cleared(rec, io, Groups::Count(lists.grid.len())))
                .unwrap();
            let found = floats(&read(&gpu, &sums));
            // Those of `rasterize_backward`, of which this adds up several; an order of atomic additions adds
            // nothing to speak of.
            let tolerance = if name == "capped" { 6e-3 } else { 2e-4 };
            let outputs = (0..9).map(|quantity| {
                let mut expected = vec![0.0; splats];
                for (isect, sum) in lists.isects.iter().zip(&case.sums[quantity]) {
                    expected[isect.splat as usize] += sum;
                }
                let found = found.iter().skip(quantity).step_by(9).copied().collect();
                let scale = rms(&expected).max(1e-6);
                Output::relative(NAMES[quantity], found, expected, tolerance, scale)
            });
            check.outputs(name, outputs.collect());
        }
    }
    check.finish();
}
