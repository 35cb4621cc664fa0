//! A host's images of a picture, and the blending of splats with their pixels.

use super::occlusion::HostDepth;
use super::scratch::Scratch;
use crate::gpu::{HostImage, Recorder};
use crate::kernels::overlay::{self, Overlay};
use crate::kernels::present::{self, Present};
use crate::{Error, Result};

/// Images of a picture in a host's frame.
#[derive(Clone, Copy, Debug)]
pub struct HostTarget<'a> {
    /// Image to write.
    pub color: &'a HostImage,
    /// Blending with the image's pixels.
    pub blend: Blend,
    /// Depths of the host's surfaces, which hide the splats behind them; for renderers with
    /// [`RenderOptions::with_host_depth`](super::RenderOptions::with_host_depth).
    pub depth: Option<HostDepth<'a>>,
    /// Image of the format R32_UINT for the splat of each pixel, as in
    /// [`RenderedImage::ids`](super::RenderedImage::ids), with the usage as destination of transfers; for renderers
    /// with [`RenderOptions::with_ids`](super::RenderOptions::with_ids), as the next.
    pub ids: Option<&'a HostImage>,
    /// Image of the format D32 or R32F, with the usage as destination of transfers, for the depth of that splat's mean
    /// in a code, or of the host's surface before it. Copies to D32 take a queue with graphics.
    pub depth_out: Option<HostDepth<'a>>,
    /// Depth of the splats in `depth_out`.
    pub depth_kind: DepthKind,
    /// Pixels to report when the frame's statistics are: [`Renderer::picks`](super::Renderer::picks).
    pub pick: Option<PickArea>,
    /// Column and row, in all images, of the picture's first pixel: the picture takes a rectangle of the camera's size,
    /// and other pixels are kept unless the state `before` discards them. `None`: the picture is as large as the
    /// images.
    pub origin: Option<[u32; 2]>,
}

/// Depth of the splats of a pixel, where they cover at least half of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DepthKind {
    /// That of the splat at which the coverage reaches 1/2: on a surface, in steps from splat to splat.
    #[default]
    Median,
    /// Mean of the splats' depths by their weights: smooth, between surfaces at borders. For renderers with
    /// [`RenderOptions::with_depth`](super::RenderOptions::with_depth), too.
    Expected,
}

/// Pixels of a picture to report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PickArea {
    /// First column.
    pub x: u32,
    /// First row, from the top.
    pub y: u32,
    /// Columns, from 1 on.
    pub width: u32,
    /// Rows, from 1 on.
    pub height: u32,
}

/// Most pixels of a [`PickArea`].
pub const PICK_PIXELS_MAX: u32 = 1 << 16;

impl<'a> From<&'a HostImage> for HostTarget<'a> {
    fn from(color: &'a HostImage) -> HostTarget<'a> {
        HostTarget {
            color,
            blend: Blend::Replace,
            depth: None,
            ids: None,
            depth_out: None,
            depth_kind: DepthKind::Median,
            pick: None,
            origin: None,
        }
    }
}

impl HostTarget<'_> {
    /// All images, in the order of their use: one may be read for its depth and then be written.
    pub(super) fn images(&self) -> impl Iterator<Item = &HostImage> {
        let [depth, depth_out] = [self.depth, self.depth_out].map(|depth| depth.map(|depth| depth.image));
        let all = [depth, Some(self.color), depth_out, self.ids];
        all.into_iter().flatten()
    }

    /// Column and row of the picture's first pixel.
    pub(super) fn corner(&self) -> [u32; 2] {
        self.origin.unwrap_or_default()
    }

    /// Checks that the images are of one size, which is that of a picture, or contains it from `origin` on.
    ///
    /// # Errors
    /// [`Error::Config`] with the sizes.
    pub(super) fn check_sizes(&self, picture: [u32; 2]) -> Result<()> {
        let refuse = |what| Err(Error::Config(what));
        let size @ [width, height] = self.color.image().extent();
        let others = [
            ("the host's depth", self.depth.map(|depth| depth.image)),
            ("the image for splats", self.ids),
            ("the image for depths", self.depth_out.map(|depth| depth.image)),
        ];
        for (name, image) in others.into_iter().filter_map(|(name, image)| Some((name, image?))) {
            let [w, h] = image.image().extent();
            if [w, h] != size {
                return refuse(format!(
                    "{name} has {w}x{h} pixels, the image to draw to {width}x{height}"
                ));
            }
        }
        let [w, h] = picture;
        let Some([x, y]) = self.origin else {
            return match picture == size {
                true => Ok(()),
                false => refuse(format!(
                    "the camera has {w}x{h} pixels, the image to draw to {width}x{height}"
                )),
            };
        };
        let ends = |from: u32, side: u32, all: u32| from.checked_add(side).is_some_and(|end| end <= all);
        match ends(x, w, width) && ends(y, h, height) {
            true => Ok(()),
            false => refuse(format!(
                "{w}x{h} pixels of the camera from ({x}, {y}) on exceed the {width}x{height} of the image to draw to"
            )),
        }
    }

    /// Records the writing of a composited picture of `size` pixels.
    pub(super) fn show(
        &self,
        rec: &mut Recorder<'_>,
        scratch: &Scratch,
        size: [u32; 2],
        (present, overlay): (&Present, Option<&Overlay>),
    ) {
        let (view, image, pixels) = (&scratch.view, &scratch.image, self.color.image());
        let (groups, origin) = (present::groups(size), self.corner());
        match overlay.filter(|_| self.blend.reads()) {
            Some(overlay) => {
                rec.acquire_to_blend(self.color);
                let io = overlay::Bindings {
                    view,
                    image,
                    below: pixels,
                    target: pixels,
                };
                let gain = self.blend.gain();
                let params = overlay::Params {
                    linear: gain.is_some().into(),
                    gain: gain.unwrap_or(1.0),
                    origin,
                };
                overlay.record(rec, io, params, groups);
            }
            None => {
                rec.acquire(self.color);
                let io = present::Bindings {
                    view,
                    image,
                    target: pixels,
                };
                present.record(rec, io, present::Params { origin }, groups);
            }
        }
        rec.release(self.color);
    }
}

/// Blending of splats with a host's pixels. `C` is the splats' colour, premultiplied and in display values, as scenes
/// are trained; `T` their transmittance, `H` the host's pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Blend {
    /// `C` over the background of [`ViewOptions`](super::ViewOptions), with alpha 1 − T: replaces the pixels.
    #[default]
    Replace,
    /// `C` with alpha 1 − T, for a blending of the host's: replaces the pixels; the background does not count.
    Premultiplied,
    /// C + T · H, of alphas too: over pixels of display values. Pixels without splats are not written. For renderers
    /// with [`RenderOptions::with_host_color`](super::RenderOptions::with_host_color), as the next.
    OverDisplay,
    /// (1 − T) · gain · decode(C / (1 − T)) + T · H: over pixels of linear light, by the sRGB curve. Exact where splats
    /// are opaque or absent; between, display values and light do not blend alike.
    OverLinear {
        /// Light of a display value of 1.
        gain: f32,
    },
}

impl Blend {
    /// True if the pixels are read.
    pub(super) fn reads(self) -> bool {
        matches!(self, Blend::OverDisplay | Blend::OverLinear { .. })
    }

    /// Background of the splats' picture.
    pub(super) fn background(self, wanted: [f32; 3]) -> [f32; 3] {
        match self {
            Blend::Replace => wanted,
            _ => [0.0; 3],
        }
    }

    /// Gain of linear light; `None` for display values.
    pub(super) fn gain(self) -> Option<f32> {
        match self {
            Blend::OverLinear { gain } => Some(gain),
            _ => None,
        }
    }

    /// Checks the gain.
    ///
    /// # Errors
    /// [`Error::Config`] for a gain that is negative or no number.
    pub(super) fn check(self) -> Result<()> {
        match self.gain() {
            Some(gain) if !gain.is_finite() || gain < 0.0 => {
                Err(Error::Config(format!("a gain of {gain}: it is a number from 0 on")))
            }
            _ => Ok(()),
        }
    }
}
