//! One execution of a target under a memory limit; panics are caught by the caller.

use super::targets::{SLACK, Target};
use peak_alloc::PeakAlloc;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Runs a target; panics if the target does, or if its peak memory exceeds the limit for the length of the input.
/// Returns the reader's message.
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
