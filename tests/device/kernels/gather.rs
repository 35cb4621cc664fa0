//! Values read through an index.

use crate::common::check::*;
use crate::common::device;
use crate::kernels::{ELEMENTWISE, by_length};
use ashfall::lab::bench::kernels::gather::gather;

#[test]
fn every_rank_gets_its_splat() {
    let gpu = device::gpu();
    let mut check = Check::new("gather");
    check.cases(&gpu, ELEMENTWISE, &by_length(|len| gather(&gpu, len)));
    check.finish();
}
