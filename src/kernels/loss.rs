//! Loss terms of a render and its photograph; choices of the kernels that slide SSIM's window.

pub use super::generated::loss::*;
use crate::gpu::{Caps, DeviceKind};

/// Windows that one of so many invocations slides over: short strips where lanes are many.
pub fn strip_of(workgroup: u32) -> u32 {
    match workgroup {
        0..64 => 8,
        64..128 => 4,
        _ => 2,
    }
}

macro_rules! choices {
    ($($kernel:ident)*) => {$(
        impl super::generated::$kernel::Choice {
            /// Choice for a device.
            pub fn prefer(caps: &Caps) -> Self {
                let mut choice = Self::default();
                if caps.kind != DeviceKind::Cpu {
                    choice.spec.workgroup = caps.max_workgroup.min(128);
                }
                choice.spec.strip = strip_of(choice.spec.workgroup);
                choice
            }
        }
    )*};
}

choices! { loss loss_backward }

/// Reason for that choice, one sentence.
pub(super) fn why(caps: &Caps) -> &'static str {
    match caps.kind {
        DeviceKind::Cpu => {
            "few invocations slide long strips each, which loads least, and loads are what a processor pays for"
        }
        _ => "many invocations slide short strips each, so that neighbouring lanes load neighbouring pixels",
    }
}
