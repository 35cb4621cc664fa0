//! Variant and tuning of each kernel on a device, with the reason.
//!
//! A choice (`prefer`) is a pure function of the device's capabilities. Its reason names a record of measurements in
//! the repository, or says that there is none for this class of devices.

use super::*;
use crate::gpu::{Caps, DeviceKind};

/// The choice for one kernel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KernelChoice {
    /// The kernel.
    pub kernel: &'static str,
    /// The variant.
    pub variant: &'static str,
    /// Its tuning.
    pub spec: String,
    /// Reason, one sentence.
    pub why: &'static str,
    /// File of the measurements behind it.
    pub record: Option<&'static str>,
}

/// Measurements on software devices.
const ON_PROCESSORS: &str = "benches/record/llvmpipe-llvm-15-0-6-256-bits/2026-11-22.csv";

/// Measurements on discrete GPUs.
const ON_GPUS: &str = "benches/record/nvidia-h200/2026-11-26.csv";

/// Measurements of kernels in blocks there.
const OF_BLOCKS: &str = "benches/record/nvidia-h100/2026-11-26.csv";

/// Reason for kernels of one invocation per element.
const ELEMENTWISE: &str = "the only variant; 64 invocations as in all kernels of one per element, so that `plan` \
                           divides by one number";

/// Reason for kernels with one workgroup per stretch of pixels.
const STRETCHED: &str =
    "the only variant; a workgroup adds up a stretch of pixels, little beside the windows of the loss";

/// Reason for kernels with one workgroup per patch of a photograph.
const PATCHED: &str = "the only variant; a workgroup adds up a patch of pixels, little beside the windows of the loss";

/// Reason for kernels with one workgroup per tile of the terms of geometry.
const OF_SURFACES: &str = "the only variant; a workgroup keeps the depths and terms of a tile and of its border";

/// Reason for kernels with a single workgroup.
const ALONE: &str = "the only variant; a single workgroup does it all, and few elements are left to it";

/// Reason for kernels without tunables.
const FIXED: &str = "the only variant, with nothing to tune";

/// Reason for the kernel of the compatibility mode.
const INRIA: &str = "the only variant; it draws as the 3DGS code does where that is asked for, and is not tuned";

/// Choices for a device, in the order of the kernels' names; for SH degree 3, without depth.
pub fn chosen(caps: &Caps) -> Vec<KernelChoice> {
    let measured = match caps.kind {
        DeviceKind::Cpu => Some(ON_PROCESSORS),
        DeviceKind::Discrete => Some(ON_GPUS),
        _ => None,
    };
    let blocks = measured.map(|_| OF_BLOCKS);
    let colors = rasterize::Outputs::TRAINING;
    macro_rules! chosen {
        ($($kernel:ident: $choice:expr, $why:expr;)*) => {
            vec![$({
                let choice = $choice;
                KernelChoice {
                    kernel: stringify!($kernel),
                    variant: choice.variant.name(),
                    spec: words(&format!("{:?}", choice.spec)),
                    why: $why,
                    record: if choice.variant.name() == "blocks" { blocks } else { measured },
                }
            }),*]
        };
    }
    chosen! {
        adam: adam::Choice::default(), ELEMENTWISE;
        adam_color: adam_color::Choice::of_degree(3), ELEMENTWISE;
        compact: compact::Choice::default(), ELEMENTWISE;
        contribution: contribution::Choice::prefer(caps, colors), contribution::Choice::why(caps);
        delinearize: delinearize::Choice::default(), ELEMENTWISE;
        expand: expand::Choice::prefer(caps), expand::Choice::why(caps);
        gather: gather::Choice::default(), ELEMENTWISE;
        linearize: linearize::Choice::default(), ELEMENTWISE;
        loss: loss::Choice::prefer(caps), loss::why(caps);
        loss_backward: loss_backward::Choice::prefer(caps), loss::why(caps);
        loss_exposure: loss_exposure::Choice::default(), STRETCHED;
        loss_residual: loss_residual::Choice::default(), PATCHED;
        loss_sum: loss_sum::Choice::default(), ALONE;
        overlay: overlay::Choice::default(), FIXED;
        perturb: perturb::Choice::default(), ELEMENTWISE;
        plan: plan::Choice::default(), FIXED;
        present: present::Choice::default(), FIXED;
        project: project::Choice::of_degree(3), ELEMENTWISE;
        project_backward: project_backward::Choice::prefer(caps, 3), project_backward::Choice::why(caps);
        prune_limit: prune_limit::Choice::prefer(caps, colors), prune_limit::Choice::why(caps);
        ranges: ranges::Choice::default(), ELEMENTWISE;
        rasterize: rasterize::Choice::prefer(caps, colors), rasterize::Choice::why(caps);
        rasterize_backward: rasterize_backward::Choice::prefer(caps, colors),
            rasterize_backward::Choice::why(caps);
        rasterize_inria: rasterize_inria::Choice::default(), INRIA;
        removal_error: removal_error::Choice::prefer(caps, colors), removal_error::Choice::why(caps);
        scan_apply: scan_apply::Choice::prefer(caps), scan::why(caps);
        scan_chunks: scan_chunks::Choice::prefer(caps), scan::why(caps);
        scan_reduce: scan_reduce::Choice::prefer(caps), scan::why(caps);
        select_rows: select_rows::Choice::default(), ELEMENTWISE;
        sort_count: sort_count::Choice::prefer(caps), sort::why(caps);
        sort_scatter: sort_scatter::Choice::prefer(caps), sort::why(caps);
        sum_by_splat: sum_by_splat::Choice::default(), ELEMENTWISE;
        surface_loss: surface_loss::Choice::default(), OF_SURFACES;
    }
}

/// `Spec { workgroup: 8, x: 1 }` as `workgroup 8, x 1`.
fn words(spec: &str) -> String {
    let inner = spec.trim_start_matches("Spec").trim_matches([' ', '{', '}']);
    inner.replace(": ", " ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shader::Requirement;
    use std::collections::BTreeSet;

    fn caps(kind: DeviceKind, subgroup_size: u32, offers: &[Requirement]) -> Caps {
        Caps {
            name: "a device".into(),
            driver: "a driver".into(),
            kind,
            api: (1, 3, 0),
            subgroup_size,
            subgroup_range: (subgroup_size, subgroup_size),
            max_storage_range: 1 << 27,
            max_allocation: 1 << 30,
            max_storage_buffers: 16,
            max_image_side: 16_384,
            max_groups: [65_535; 3],
            max_workgroup: 256,
            max_push_constants: 128,
            max_shared: 1 << 15,
            timestamp_period_ns: 1.0,
            heap: 1 << 30,
            offers: offers.iter().copied().collect(),
        }
    }

    #[test]
    fn every_kernel_that_is_run_has_a_reason_and_every_record_exists() {
        let kernels: BTreeSet<&str> = KERNELS.iter().map(|info| info.kernel).collect();
        for kind in [DeviceKind::Cpu, DeviceKind::Discrete, DeviceKind::Integrated] {
            let chosen = chosen(&caps(kind, 8, &[]));
            let named: BTreeSet<&str> = chosen.iter().map(|choice| choice.kernel).collect();
            let missing = kernels.difference(&named).copied();
            assert!(
                missing.eq(BASELINES.into_iter().chain(SELFTESTS)),
                "baselines and self-tests alone are never chosen"
            );
            for choice in chosen {
                assert!(!choice.why.contains('\n'), "{}", choice.why);
                assert_eq!(choice.record.is_some(), kind != DeviceKind::Integrated);
                let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
                assert!(choice.record.is_none_or(|file| root.join(file).is_file()));
            }
        }
    }

    #[test]
    fn reasons_go_with_choices() {
        let all = [
            Requirement::SubgroupBasic,
            Requirement::SubgroupVote,
            Requirement::SubgroupArithmetic,
            Requirement::SubgroupBallot,
            Requirement::SubgroupShuffle,
            Requirement::SubgroupShuffleRelative,
        ];
        let of = |kernel: &str, caps: &Caps| {
            let choice = chosen(caps).into_iter().find(|choice| choice.kernel == kernel);
            choice.map(|choice| (choice.variant, choice.spec, choice.why))
        };
        let wide = |kernel: &str, kind| {
            let (variant, spec, why) = of(kernel, &caps(kind, 32, &all))?;
            let none = of(kernel, &caps(kind, 32, &[]))?;
            assert_ne!((variant, why), (none.0, none.2));
            Some((variant, spec.split(',').next()?.to_owned()))
        };
        let (subgroup, blocks) = (("subgroup", "workgroup 32"), ("blocks", "workgroup 64"));
        for (kernel, kind, expected) in [
            ("contribution", DeviceKind::Discrete, subgroup),
            ("rasterize", DeviceKind::Cpu, subgroup),
            ("rasterize", DeviceKind::Discrete, blocks),
            ("rasterize_backward", DeviceKind::Discrete, blocks),
        ] {
            let (variant, lanes) = expected;
            assert_eq!(wide(kernel, kind), Some((variant, lanes.to_owned())), "{kernel}");
        }
        let processor = of("sort_scatter", &caps(DeviceKind::Cpu, 8, &all));
        let other = of("sort_scatter", &caps(DeviceKind::Discrete, 32, &all));
        assert_ne!(processor.map(|c| c.2), other.map(|c| c.2));
    }
}
