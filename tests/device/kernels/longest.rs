//! Longest lists of a tile on a software device, which ends loops silently after a number of iterations: kernels reach
//! the far end of the list. `rasterize` and `contribution` have such tests in their own files, with splats that all
//! count.

use crate::common::check::*;
use crate::common::lists::view;
use crate::common::{device, scenes};
use ashfall::gpu::{Buffer, DeviceKind, Gpu, Groups};
use ashfall::kernels::rasterize_backward::{self, RasterizeBackward};
use ashfall::kernels::rasterize_inria;
use ashfall::lab::bench::kernels::Workgroups;
use ashfall::layout::{TILE_PIXELS, View};
use ashfall::render::list_limit;

const PIXELS: usize = TILE_PIXELS as usize;

/// One tile whose list holds splat 0 once, which half covers every pixel, and splat 1 everywhere else, which is
/// nowhere.
struct Longest {
    len: usize,
    view: Buffer<View>,
    range: Buffer<[u32; 2]>,
    sources: Buffer<u32>,
    owners: Buffer<u32>,
    shapes: Buffer<[f32; 4]>,
    tones: Buffer<[f32; 4]>,
    rests: Buffer<[f32; 2]>,
}

impl Longest {
    /// With splat 0 at `place`.
    fn new(gpu: &Gpu, place: fn(usize) -> usize) -> Longest {
        let len = list_limit(DeviceKind::Cpu) as usize;
        let mut owners = vec![1; len];
        owners[place(len)] = 0;
        let sources: Vec<u32> = (0..len as u32).collect();
        let flat = [1e-3, 1e-3, 1.0, 1.0];
        Longest {
            len,
            view: buffer(gpu, &[view(&scenes::gentle(1, 0, 8, 16, 0))]),
            range: buffer(gpu, &[[0, len as u32]]),
            sources: buffer(gpu, &sources),
            owners: buffer(gpu, &owners),
            shapes: buffer(gpu, &[[4.0, 8.0, 0.0, -1.0], [4.0, 8.0, 0.0, -1e30]]),
            tones: buffer(gpu, &[flat, flat]),
            rests: buffer(gpu, &[[1.0, 1.0]; 2]),
        }
    }
}

/// From the back: the splat in front of all others gets its gradient, and the others theirs, which is nothing.
#[test]
fn gradients_reach_the_front() {
    let gpu = device::gpu();
    let list = Longest::new(&gpu, |_| 0);
    let (image, ends) = (vec![0.5; 4 * PIXELS], vec![list.len as u32; PIXELS]);
    for (choice, _) in Workgroups::lanes(&[8]).choices::<RasterizeBackward>(gpu.caps()) {
        let kernel = RasterizeBackward::new(&gpu, choice).unwrap();
        let shape = unwritten::<[f32; 4]>(&gpu, list.len);
        let tone = unwritten::<[f32; 4]>(&gpu, list.len);
        let rest = unwritten::<f32>(&gpu, list.len);
        let io = rasterize_backward::Bindings {
            view: &list.view,
            range_from_tile: &list.range,
            emitted_from_isect: &list.sources,
            splat_from_emitted: &list.owners,
            ellipse_from_splat: &list.shapes,
            whiten_rg_from_splat: &list.tones,
            blue_depth_from_splat: &list.rests,
            image: &buffer(&gpu, &image),
            d_image: &buffer(&gpu, &vec![1.0; 3 * PIXELS]),
            isect_end_from_pixel: &buffer(&gpu, &ends),
            d_shape_from_source: &shape,
            d_tone_from_source: &tone,
            d_rest_from_source: &rest,
            plane_from_splat: &gpu.buffer("planes", 1).unwrap(),
        };
        let params = rasterize_backward::Params {
            tile_stride: 1,
            band: 0,
        };
        gpu.run(|rec| kernel.record(rec, io, params, Groups::Count(1))).unwrap();
        let blue = read(&gpu, &rest);
        // Half of every pixel, less what a deviation of 1e-3 of a standard one takes: under 1e-4.
        assert!(
            (blue[0] / (0.5 * PIXELS as f32) - 1.0).abs() < 1e-3,
            "{choice:?}: {}",
            blue[0]
        );
        assert!(blue[1..].iter().all(|&d| d == 0.0), "{choice:?}");
    }
}

#[test]
fn the_inria_rules_reach_the_back() {
    let gpu = device::gpu();
    let list = Longest::new(&gpu, |len| len - 1);
    let kernel = rasterize_inria::RasterizeInria::new(&gpu, rasterize_inria::Choice::default()).unwrap();
    let end = unwritten::<u32>(&gpu, PIXELS);
    let io = rasterize_inria::Bindings {
        view: &list.view,
        range_from_tile: &list.range,
        emitted_from_isect: &list.sources,
        splat_from_emitted: &list.owners,
        ellipse_from_splat: &list.shapes,
        whiten_rg_from_splat: &list.tones,
        blue_depth_from_splat: &list.rests,
        image: &unwritten(&gpu, 4 * PIXELS),
        depth: &unwritten(&gpu, PIXELS),
        isect_end_from_pixel: &end,
    };
    gpu.run(|rec| kernel.record(rec, io, rasterize_inria::Params { tile_stride: 1 }, Groups::Count(1)))
        .unwrap();
    assert!(read(&gpu, &end).iter().all(|&end| end as usize == list.len));
}
