//! Contributions of splats to the pixels of their tiles.

use crate::common::check::*;
use crate::common::{device, scenes};
use crate::kernels::LANES;
use crate::kernels::rasterize::{composites_of_kinds, longest};
use ashfall::kernels::Kernel;
use ashfall::kernels::contribution::Contribution;
use ashfall::lab::bench::kernels::Composite;
use ashfall::lab::bench::kernels::contribution::{contribution, contribution_into};

#[test]
fn every_pair_is_weighed() {
    let gpu = device::gpu();
    let mut check = Check::new("contribution");
    let composites = composites_of_kinds();
    let case = |(name, of)| (name, contribution(&gpu, of).unwrap());
    let cases: Vec<_> = composites.iter().map(|(name, of)| case((*name, of))).collect();
    check.cases(&gpu, LANES, &cases);
    check.finish();
}

#[test]
fn variants_agree_to_the_last_bit_of_maxima() {
    let gpu = device::gpu();
    let composite = Composite::of(scenes::hard(16, 90, 33, 47, 0));
    let records = unwritten(&gpu, composite.lists.isects.len());
    let case = contribution_into(&gpu, &composite, &records).unwrap();
    let mut runs = Vec::new();
    for (choice, _) in LANES.choices::<Contribution>(gpu.caps()) {
        let kernel = Contribution::compile(&gpu, choice).unwrap();
        case.run(&gpu, &kernel, &choice).unwrap();
        let bits = |r: &[f32; 3]| [r[0].to_bits(), r[2].to_bits()];
        runs.push(read(&gpu, &records).iter().map(bits).collect::<Vec<_>>());
    }
    assert!(runs.windows(2).all(|two| two[0] == two[1]));
}

#[test]
fn a_list_as_long_as_allowed_is_weighed_to_its_end() {
    let gpu = device::gpu();
    let composite = Composite::of(longest());
    let sources = &composite.lists.emitted_from_isect;
    let records = unwritten(&gpu, sources.len());
    let case = contribution_into(&gpu, &composite, &records).unwrap();
    for (choice, _) in LANES.choices::<Contribution>(gpu.caps()) {
        let kernel = Contribution::compile(&gpu, choice).unwrap();
        case.run(&gpu, &kernel, &choice).unwrap();
        let found = read(&gpu, &records);
        // One in this scene is drawn at a pixel or two; it counts there and has a limit of theirs.
        let is_weighed = |&&source: &&u32| {
            let [most, sum, limit] = found[source as usize];
            sum > 0.0 && most >= 0.5 * sum && limit < 256.0
        };
        let last = &sources[sources.len() - 100..];
        assert_eq!(last.iter().filter(is_weighed).count(), 100, "{choice:?}");
    }
}
