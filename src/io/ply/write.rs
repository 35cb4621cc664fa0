//! Writing splats in the common 3DGS layout.

use super::super::atomic::write_atomically;
use super::comments::comments;
use crate::error::Result;
use crate::scene::{Primitive, Splats, sh_coefficient_count};
use glam::{Quat, Vec3};
use std::io::Write;
use std::path::Path;

/// Writes `splats` as binary little-endian floats `x y z nx ny nz f_dc f_rest opacity scale rot`, the layout of the
/// 3DGS reference code, with the render mode in a comment, the origin in another if it is not zero, and the upward
/// direction in a third if it is known. Surfels have two scales, as in the 2DGS reference code, and their normals; 3D
/// Gaussians have zeros there. Reading the file with [`super::read`] returns equal splats, bit for bit (of surfels, but
/// for the third scale). The write is atomic.
pub fn write(path: &Path, splats: &Splats) -> Result<()> {
    let count = splats.len();
    assert_eq!(splats.quaternion.len(), count, "quaternions of all splats");
    assert_eq!(splats.log_scale.len(), count, "scales of all splats");
    assert_eq!(splats.opacity_logit.len(), count, "opacities of all splats");
    assert_eq!(splats.sh.len(), count * splats.sh_stride(), "harmonics");
    write_atomically(path, |file| {
        file.write_all(header(splats).as_bytes())?;
        let rest = sh_coefficient_count(splats.sh_degree) - 1;
        let mut row: Vec<f32> = Vec::with_capacity(17 + 3 * rest);
        for i in 0..count {
            let sh = &splats.sh[i * splats.sh_stride()..][..splats.sh_stride()];
            row.clear();
            row.extend(splats.mean[i]);
            row.extend(normal(splats, i));
            row.extend(&sh[..3]);
            for channel in 0..3 {
                row.extend(sh[3..].iter().skip(channel).step_by(3));
            }
            row.push(splats.opacity_logit[i]);
            row.extend(&splats.log_scale[i][..splats.primitive.scale_count()]);
            row.extend(splats.quaternion[i]);
            for value in &row {
                file.write_all(&value.to_le_bytes())?;
            }
        }
        Ok(())
    })
}

/// Bytes of the file that [`write()`] writes.
pub fn byte_count(splats: &Splats) -> u64 {
    let floats = 3 + 3 + splats.sh_stride() + 1 + splats.primitive.scale_count() + 4;
    (header(splats).len() + size_of::<f32>() * floats * splats.len()) as u64
}

/// Unit normal of a surfel, its third axis, in the axes of the file; zero for a 3D Gaussian.
fn normal(splats: &Splats, index: usize) -> [f32; 3] {
    match splats.primitive {
        Primitive::Gaussian3d => [0.0; 3],
        Primitive::Surfel => {
            let [w, x, y, z] = splats.quaternion[index];
            (Quat::from_xyzw(x, y, z, w).normalize() * Vec3::Z).to_array()
        }
    }
}

fn header(splats: &Splats) -> String {
    let rest = (sh_coefficient_count(splats.sh_degree) - 1) * 3;
    let mut names: Vec<String> = ["x", "y", "z", "nx", "ny", "nz"].map(String::from).into();
    names.extend((0..3).map(|i| format!("f_dc_{i}")));
    names.extend((0..rest).map(|i| format!("f_rest_{i}")));
    names.push("opacity".into());
    names.extend((0..splats.primitive.scale_count()).map(|i| format!("scale_{i}")));
    names.extend((0..4).map(|i| format!("rot_{i}")));
    let properties: String = names.iter().map(|name| format!("property float {name}\n")).collect();
    format!(
        "ply\nformat binary_little_endian 1.0\n{}element vertex {}\n{properties}end_header\n",
        comments(splats),
        splats.len()
    )
}
