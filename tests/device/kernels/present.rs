//! Presentation to an owned storage image; `tests/device/embed` has hosts' images.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::Random;
use crate::kernels::supported;
use ashfall::kernels::present::{Bindings, Choice, Present, groups};
use ashfall::layout::View;

/// Sizes at which blocks of 8x8 invocations begin and end.
const SIZES: [(&str, [u32; 2]); 6] = [
    ("one", [1, 1]),
    ("less than a block", [7, 5]),
    ("a block", [8, 8]),
    ("a pixel more than a block", [9, 9]),
    ("wide", [131, 3]),
    ("tall", [2, 97]),
];

#[test]
fn every_pixel_gets_its_colour_and_its_opacity() {
    let gpu = device::gpu();
    let mut check = Check::new("present");
    for variant in supported!(present, gpu) {
        let choice = Choice {
            variant,
            ..Choice::default()
        };
        let kernel = Present::new(&gpu, choice).unwrap();
        for (name, size) in SIZES {
            let [width, height] = size.map(|side| side as usize);
            let random = &mut Random::new(width as u64);
            let planes: Vec<f32> = (0..4 * width * height)
                .map(|_| random.between(-0.5, 1.5) as f32)
                .collect();
            // A column and a row more than are asked for: they must not be touched.
            let target = gpu.image("target", size.map(|side| side + 1)).unwrap();
            let view = View {
                size,
                ..View::default()
            };
            let io = Bindings {
                view: &buffer(&gpu, &[view]),
                image: &buffer(&gpu, &planes),
                target: &target,
            };
            gpu.run(|rec| kernel.record(rec, io, groups(size))).unwrap();
            let mut expected = Vec::new();
            for (y, x) in (0..=height).flat_map(|y| (0..=width).map(move |x| (y, x))) {
                let is_in = x < width && y < height;
                let plane = |plane: usize| planes[(plane * height + y) * width + x];
                expected.extend(match is_in {
                    true => [plane(0), plane(1), plane(2), 1.0 - plane(3)].map(f64::from),
                    false => [f64::NAN; 4],
                });
            }
            let found = floats(&gpu.download_image(&target).unwrap());
            check.outputs(name, vec![Output::exact("pixels", found, expected)]);
        }
    }
    check.finish();
}
