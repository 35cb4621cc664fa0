//! Writing a composited image into a storage image, as hosts hand one in; here it is one of our own.

use super::wanted;
use crate::Result;
use crate::kernels::present::{Bindings, Choice, Present, groups};
use crate::lab::bench::check::{Output, floats};
use crate::lab::bench::input::random::Random;
use crate::lab::bench::{Bench, Unit, Work};
use crate::layout::View;

/// Pixels of the images: in the caches and beyond them.
const SIZES: [[u32; 2]; 2] = [[480, 272], [1920, 1080]];

pub(super) fn run(bench: &mut Bench) -> Result<()> {
    SIZES.iter().try_for_each(|&size| present(bench, size))
}

/// Four channels of each pixel, from four planes to one image; the last, what passes, becomes its opposite.
fn present(bench: &mut Bench, size: [u32; 2]) -> Result<()> {
    let gpu = bench.gpu().clone();
    let name = format!("{}x{}", size[0], size[1]);
    let pixels = size[0] as usize * size[1] as usize;
    let work = Work::of(pixels, Unit::Pixels).moving(2 * 16 * pixels);
    let choices = wanted!(bench, present, name, [0], work);
    if choices.is_empty() {
        return Ok(());
    }
    let random = &mut Random::new(pixels as u64);
    let planes: Vec<f32> = (0..4 * pixels)
        .map(|_| random.between(0.0, 1.0) as f32)
        .collect();
    let channel = |pixel: usize, channel: usize| match (planes[channel * pixels + pixel], channel) {
        (through, 3) => f64::from(1.0 - through),
        (color, _) => f64::from(color),
    };
    let expected: Vec<f64> = (0..4 * pixels).map(|i| channel(i / 4, i % 4)).collect();
    let view = View {
        size,
        ..View::default()
    };
    let (view, image) = (
        gpu.buffer_from("view", &[view])?,
        gpu.buffer_from("image", &planes)?,
    );
    let target = gpu.image("target", size)?;
    for (variant, _, case) in choices {
        let choice = Choice {
            variant,
            ..Choice::default()
        };
        let kernel = Present::new(&gpu, choice)?;
        let io = Bindings {
            view: &view,
            image: &image,
            target: &target,
        };
        bench.trial(
            &case,
            |rec| rec.clear(&target, f32::NAN),
            |rec| kernel.record(rec, io, groups(size)),
            || {
                let found = floats(&gpu.download_image(&target)?);
                Ok(vec![Output::exact("pixels", found, expected.clone())])
            },
        )?;
    }
    Ok(())
}
