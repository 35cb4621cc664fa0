//! A host's image as a kernel's target.

use ash::vk;

/// A storage image that belongs to the host; made by `HostImage::wrap`.
#[derive(Clone, Copy, Debug)]
pub struct Image {
    pub(super) image: vk::Image,
    pub(super) view: vk::ImageView,
    pub(super) extent: [u32; 2],
}

impl Image {
    /// Width and height in pixels.
    pub fn extent(&self) -> [u32; 2] {
        self.extent
    }
}
