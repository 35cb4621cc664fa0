//! Case of `present`: a composited image written into a storage image of our own.

use super::KernelCase;
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::present::{Bindings, Present, groups};
use crate::lab::bench::Work;
use crate::lab::bench::check::{Output, floats};
use crate::lab::bench::input::random::Random;
use crate::layout::View;

/// Four planes of random numbers to an image of `size` pixels. Transmittance becomes opacity.
pub fn present<'a>(gpu: &Gpu, size: [u32; 2]) -> Result<KernelCase<'a, Present>> {
    let [width, height] = size.map(|side| side as usize);
    let pixels = width * height;
    let random = &mut Random::new(width as u64);
    let mut value = || random.between(-0.5, 1.5) as f32;
    let planes: Vec<f32> = (0..4 * pixels).map(|_| value()).collect();
    let view = View {
        size,
        ..View::default()
    };
    let view = gpu.buffer_from("view", &[view])?;
    let image = gpu.buffer_from("image", &planes)?;
    // A column and a row more than are asked for: they must not be touched.
    let target = gpu.image("target", size.map(|side| side + 1))?;
    let mut expected = Vec::new();
    for (y, x) in (0..=height).flat_map(|y| (0..=width).map(move |x| (y, x))) {
        let plane = |plane: usize| planes[(plane * height + y) * width + x];
        expected.extend(match x < width && y < height {
            true => [plane(0), plane(1), plane(2), 1.0 - plane(3)].map(f64::from),
            false => [f64::NAN; 4],
        });
    }
    let (cleared, found) = (target.clone(), target.clone());
    let work = Work::of(pixels, "pixels").moving(2 * 16 * pixels);
    let case = KernelCase::new(work)
        .before(move |rec, _| rec.clear(&cleared, f32::NAN))
        .judge(move |gpu| {
            let found = floats(&gpu.download_image(&found)?);
            Ok(vec![Output::exact("pixels", found, expected.clone())])
        });
    Ok(case.commands(move |rec, kernel: &Present, _| {
        let io = Bindings {
            view: &view,
            image: &image,
            target: &target,
        };
        kernel.record(rec, io, groups(size));
    }))
}
