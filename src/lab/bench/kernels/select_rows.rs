//! Case of `select_rows`: planes in a new order.

use super::KernelCase;
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::select_rows::{Bindings, Params, SelectRows};
use crate::lab::bench::Work;
use crate::lab::bench::input::random::Random;
use crate::layout::ORIGIN_IS_NEW;

/// Planes of the case.
const PLANES: usize = 4;

/// Random numbers through random origins, of which some occur twice, some never, some lie in another block and some are
/// marked as new: moments with a reset of the opacity's, or parameters after the first plane.
pub fn select_rows<'a>(gpu: &Gpu, len: usize, moments: bool) -> Result<KernelCase<'a, SelectRows>> {
    let random = &mut Random::new(len as u64);
    let (first, source_count) = (5, len / 2 + 1);
    let (stride, source_stride) = (len + 1, source_count + 2);
    let before: Vec<[f32; 4]> = (0..PLANES * source_stride)
        .map(|_| [(); 4].map(|()| random.between(-1.0, 1.0) as f32))
        .collect();
    let origins: Vec<u32> = (0..len)
        .map(|_| {
            let slot = random.below(source_count + 2 * first) as u32;
            slot | if random.below(4) == 0 { ORIGIN_IS_NEW } else { 0 }
        })
        .collect();
    let plane_first = usize::from(!moments);
    let untouched = [9.0_f32; 4];
    let mut expected = vec![untouched; PLANES * stride];
    for (slot, origin) in origins.iter().enumerate() {
        let source = (origin & !ORIGIN_IS_NEW) as usize;
        if !(first..first + source_count).contains(&source) {
            continue;
        }
        for plane in plane_first..PLANES {
            let four = &mut expected[plane * stride + slot];
            *four = match moments && origin & ORIGIN_IS_NEW != 0 {
                true => [0.0; 4],
                false => before[plane * source_stride + source - first],
            };
            if plane == 0 {
                four[3] = 0.0;
            }
        }
    }
    let bits = |value: f32| f64::from(value.to_bits());
    let expected = expected.into_iter().flatten().map(bits).collect();
    let origins = gpu.buffer_from("origin_from_slot", &[&origins[..], &[0]].concat())?;
    let before = gpu.buffer_from("before", &before)?;
    let blank = gpu.buffer_from("blank", &vec![untouched; PLANES * stride])?;
    let after = gpu.buffer::<[f32; 4]>("after", PLANES * stride)?;
    let work = Work::of(len, "splats").moving((4 + 16 * 2 * (PLANES - plane_first)) * len);
    let case = KernelCase::new(work).exact("planes", &after, expected);
    Ok(case.copy(&blank, &after).commands(move |rec, kernel: &SelectRows, _| {
        let io = Bindings {
            origin_from_slot: &origins,
            before: &before,
            after: &after,
        };
        let params = Params {
            slot_count: len as u32,
            stride: stride as u32,
            source_first: first as u32,
            source_count: source_count as u32,
            source_stride: source_stride as u32,
            plane_first: plane_first as u32,
            plane_count: PLANES as u32,
            moments: moments.into(),
            fade: moments.into(),
        };
        kernel.record(rec, io, params, kernel.groups(len));
    }))
}
