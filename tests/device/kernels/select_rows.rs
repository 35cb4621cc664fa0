//! Planes in a new order.

use crate::common::check::*;
use crate::common::device;
use crate::kernels::{ELEMENTWISE, by_length};
use ashfall::lab::bench::kernels::select_rows::select_rows;

#[test]
fn every_slot_gets_the_numbers_of_its_origin() {
    let gpu = device::gpu();
    let mut check = Check::new("select_rows");
    for moments in [true, false] {
        check.cases(&gpu, ELEMENTWISE, &by_length(|len| select_rows(&gpu, len, moments)));
    }
    check.finish();
}
