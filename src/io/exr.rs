//! Images as OpenEXR files: 32-bit floats, with depth and normals.

use super::atomic::write_atomically;
use crate::error::{Error, Result};
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

/// Depths and normals of an OpenEXR file, `[row][column]` from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthImage {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Depth along the view's z axis, channel Z.
    pub depth: Vec<f32>,
    /// Normal in the world, channels N.X, N.Y and N.Z.
    pub normal: Vec<[f32; 3]>,
}

/// Reads the channels Z, N.X, N.Y and N.Z of the first layer that has them.
///
/// # Errors
/// Names the file: unreadable, or without these channels.
pub fn read_depth(path: &FilePath) -> Result<DepthImage> {
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .specific_channels()
        .required("Z")
        .required("N.X")
        .required("N.Y")
        .required("N.Z")
        .collect_pixels(
            |size, _| (size.width(), vec![(0.0, [0.0; 3]); size.area()]),
            |(width, pixels), at, (z, x, y, n): (f32, f32, f32, f32)| {
                pixels[at.y() * *width + at.x()] = (z, [x, y, n]);
            },
        )
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .map_err(|error| Error::file(path, format!("depths and normals: {error}")))?;
    let size = image.layer_data.size;
    let (_, pixels) = image.layer_data.channel_data.pixels;
    let (depth, normal) = pixels.into_iter().unzip();
    Ok(DepthImage {
        width: size.width() as u32,
        height: size.height() as u32,
        depth,
        normal,
    })
}
