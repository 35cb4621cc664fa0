//! Images as OpenEXR files: 32-bit floats, with depth and normals.

use super::atomic::write_atomically;
use crate::error::Result;
use exr::prelude::*;
use std::path::Path as FilePath;

/// Writes the channels R, G, B, A and Z as 32-bit floats, compressed without loss, and with normals N.X, N.Y and N.Z.
///
/// `rgba`, `depth` and `normal` are `[row][column]`; depth is along the view's z axis in world units, normals are in
/// the world. Values are stored as given, NaN and infinity included.
pub fn write(
    path: &FilePath,
    width: u32,
    height: u32,
    rgba: &[[f32; 4]],
    depth: &[f32],
    normal: Option<&[[f32; 3]]>,
) -> Result<()> {
    let pixels = width as usize * height as usize;
    assert_eq!(rgba.len(), pixels, "as many colours as the image has pixels");
    assert_eq!(depth.len(), pixels, "as many depths as the image has pixels");
    let plane = |channel: usize| FlatSamples::F32(rgba.iter().map(|pixel| pixel[channel]).collect());
    let mut channels = vec![
        AnyChannel::new("R", plane(0)),
        AnyChannel::new("G", plane(1)),
        AnyChannel::new("B", plane(2)),
        AnyChannel::new("A", plane(3)),
        AnyChannel::new("Z", FlatSamples::F32(depth.to_vec())),
    ];
    if let Some(normal) = normal {
        assert_eq!(normal.len(), pixels, "as many normals as the image has pixels");
        let axis = |axis: usize| FlatSamples::F32(normal.iter().map(|pixel| pixel[axis]).collect());
        channels.extend(
            ["N.X", "N.Y", "N.Z"]
                .into_iter()
                .zip(0..)
                .map(|(name, i)| AnyChannel::new(name, axis(i))),
        );
    }
    let image = Image::from_encoded_channels(
        (width as usize, height as usize),
        Encoding::FAST_LOSSLESS,
        AnyChannels::sort(channels.into_iter().collect()),
    );
    write_atomically(path, |file| {
        image.write().to_buffered(file).map_err(std::io::Error::other)
    })
}
