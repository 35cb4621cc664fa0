//! `.splat` files of an independent writer.

use crate::io::fixtures::{Bounds, assert_close, fixture};
use ashfall::io::splat32;

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
