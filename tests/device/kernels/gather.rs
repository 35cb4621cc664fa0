//! Indexed reads.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::Random;
use crate::kernels::fitting;
use crate::kernels::{LENGTHS, supported};
use ashfall::gpu::Groups;
use ashfall::kernels::gather::{Bindings, Choice, Gather, Spec};
use ashfall::layout::COUNT_VISIBLE;

#[test]
fn every_rank_gets_its_splat() {
    let gpu = device::gpu();
    let mut check = Check::new("gather");
    for variant in supported!(gather, gpu) {
        for workgroup in fitting(&gpu, [1, 8, 64, 256]) {
            let spec = Spec { workgroup };
            let kernel = Gather::new(&gpu, Choice { variant, spec }).unwrap();
            for (name, len) in LENGTHS {
                if workgroup == 1 && len > 300 {
                    continue;
                }
                let random = &mut Random::new(len as u64);
                let source: Vec<u32> = (0..len + 7).map(|_| random.bits() as u32).collect();
                let index: Vec<u32> = random
                    .permutation(len + 7)
                    .iter()
                    .take(len)
                    .map(|&i| i as u32)
                    .collect();
                // One more than asked for: it must not be touched.
                let target = unwritten::<u32>(&gpu, len + 1);
                let io = Bindings {
                    counts: &counts(&gpu, &[(COUNT_VISIBLE, len as u32)]),
                    splat_from_rank: &buffer(&gpu, &index),
                    tile_count_from_splat: &buffer(&gpu, &source),
                    tile_count_from_rank: &target,
                };
                let args = args(&gpu, len, workgroup);
                gpu.run(|rec| kernel.record(rec, io, Groups::indirect(&args, 0)))
                    .unwrap();
                let mut expected: Vec<f64> = index
                    .iter()
                    .map(|&i| f64::from(source[i as usize]))
                    .collect();
                expected.push(f64::NAN);
                let found = words(&read(&gpu, &target));
                check.outputs(name, vec![Output::exact("values", found, expected)]);
            }
        }
    }
    check.finish();
}
