//! One execution of a target: what it may do is watched here, panics apart.

use super::targets::{SLACK, Target};
use peak_alloc::PeakAlloc;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Runs a target; panics where it does, and where it takes more memory at one time than such a file can justify.
/// Returns what the reader said.
pub(crate) fn execute(target: &Target, bytes: &[u8]) -> String {
    let allowed = SLACK + (target.memory)(bytes);
    let before = MEMORY.current_usage();
    MEMORY.reset_peak_usage();
    let said = (target.run)(bytes);
    let taken = MEMORY.peak_usage().saturating_sub(before);
    assert!(
        taken <= allowed,
        "{taken} bytes of memory for a file of {}, {allowed} allowed",
        bytes.len()
    );
    said
}
