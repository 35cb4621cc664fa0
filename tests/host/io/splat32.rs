//! `.splat` files of an independent writer.

use crate::io::fixtures::{Bounds, assert_close, edges, fixture};
use ashfall::io::splat32;
use ashfall::scene::SH_C0;

/// The expected values decode quaternions as b / 127.5 − 1, this reader as (b − 128) / 128, as the format's own viewer
/// does.
#[test]
fn files_of_ply2splat_decode() {
    for file in ["playbot600_sh0.splat", "playbot600_sh2.sorted.splat"] {
        let Some((path, wanted)) = fixture("ply2splat-0.6.0", file) else {
            return;
        };
        let bounds = Bounds {
            rotation_degrees: 0.9,
            ..Bounds::EXACT
        };
        assert_close(&splat32::read(&path).unwrap().splats, &wanted, bounds, file);
    }
}

#[test]
fn bytes_written_are_the_nearest() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.splat");
    let splats = edges(1);
    splat32::write(&path, &splats).unwrap();
    let loaded = splat32::read(&path).unwrap();
    assert_eq!(loaded.warnings, Vec::<String>::new());
    let mut wanted = splats.clone();
    wanted.sh_degree = 0;
    // Colours from 0 to 1.
    let limit = 0.5 / SH_C0;
    let constant = splats.sh.chunks_exact(12).flat_map(|sh| [sh[0], sh[1], sh[2]]);
    wanted.sh = constant.map(|v| v.clamp(-limit, limit)).collect();
    let bounds = Bounds {
        // Half a step of a quaternion's components; one of 1 has the code of 127/128.
        rotation_degrees: 0.9,
        opacity: 0.5 / 255.0 + 1e-6,
        color: 0.5 / 255.0 / SH_C0 + 1e-5,
        ..Bounds::EXACT
    };
    assert_close(&loaded.splats, &wanted, bounds, "edges");
}
