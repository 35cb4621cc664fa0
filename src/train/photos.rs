//! Photographs on the device: all of them if they fit, the rest streamed.

use crate::Result;
use crate::gpu::{Buffer, Gpu, Recorder};
use crate::io::photo::PhotoCache;
use crate::scene::{AlphaMode, Dataset, Photo, PhotoSource, View};

/// Bytes of decoded photographs cached on the host; the rest are decoded on use.
const HOST_BUDGET: u64 = 4 << 30;

/// One training photograph.
struct PhotoEntry {
    /// Index of its view in the data set.
    view: usize,
    /// Whether alpha is a weight of the loss instead of being composited.
    masks: bool,
    /// `None`: streamed.
    resident: Option<Bound>,
}

/// Split of the photographs into resident and streamed ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Residency {
    /// Number of resident photographs.
    pub resident: usize,
    /// Bytes of the resident photographs.
    pub resident_bytes: usize,
    /// Number of streamed photographs, each uploaded for every step that uses it.
    pub streamed: usize,
    /// Bytes of the largest streamed photograph.
    pub streamed_max_bytes: usize,
    /// Bytes of the largest photograph.
    pub max_bytes: usize,
}

impl Residency {
    /// Residency of photographs of these sizes in pixels within `share` of the memory: in order, each that still fits
    /// is resident.
    pub fn of(sizes: impl Iterator<Item = [u32; 2]>, share: f32, memory_limit: u64) -> Residency {
        let mut residency = Residency::default();
        let budget = (memory_limit as f64 * f64::from(share)) as u64;
        sizes.for_each(|size| _ = residency.admit(size, budget));
        residency
    }

    /// Adds a photograph; returns whether it is resident.
    fn admit(&mut self, [width, height]: [u32; 2], budget: u64) -> bool {
        let bytes = 4 * width as usize * height as usize;
        let stays = (self.resident_bytes + bytes) as u64 <= budget;
        self.max_bytes = self.max_bytes.max(bytes);
        if stays {
            self.resident += 1;
            self.resident_bytes += bytes;
        } else {
            self.streamed += 1;
            self.streamed_max_bytes = self.streamed_max_bytes.max(bytes);
        }
        stays
    }
}

/// The training photographs.
pub(crate) struct Photos {
    entries: Vec<PhotoEntry>,
    cache: PhotoCache,
    /// One buffer per frame in flight, for photographs that are not resident.
    ring: Vec<Buffer<u32>>,
    next: usize,
}

/// A step's photograph as input of the loss.
#[derive(Clone)]
pub(crate) struct Bound {
    /// 8-bit RGBA.
    pub(crate) pixels: Buffer<u32>,
    pub(crate) masks: bool,
    /// Sum of the pixels' weights.
    pub(crate) weight: f64,
}

impl Photos {
    /// No photographs.
    pub(crate) fn none() -> Photos {
        Photos {
            entries: Vec::new(),
            cache: PhotoCache::new(&Dataset::default(), 0),
            ring: Vec::new(),
            next: 0,
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Decodes the views' photographs in parallel and uploads those that fit into `share` of the device's memory.
    pub(crate) fn new(gpu: &Gpu, dataset: &Dataset, views: &[usize], in_flight: usize, share: f32) -> Result<Photos> {
        let cache = PhotoCache::new(dataset, HOST_BUDGET);
        cache.load_all(dataset, views)?;
        let budget = (gpu.memory_limit() as f64 * f64::from(share)) as u64;
        let mut photos = Photos {
            cache,
            ..Photos::none()
        };
        let mut residency = Residency::default();
        for &view in views {
            let View { camera, photo, .. } = &dataset.views[view];
            let has_borders =
                matches!(photo, PhotoSource::File { optics, mask, .. } if optics.is_some() || mask.is_some());
            // Undistortion leaves pixels outside the photograph, which only a weight can exclude.
            let masks = has_borders || dataset.alpha == AlphaMode::Mask;
            let mut resident = None;
            if residency.admit([camera.width, camera.height], budget) {
                let photo = photos.cache.get(dataset, view)?;
                // A step binds the part that it draws.
                let pixels = gpu.room("photo", photo.rgba.len())?;
                gpu.upload(&pixels, 0, &words(&photo))?;
                resident = Some(bound(pixels, &photo, masks));
            }
            photos.entries.push(PhotoEntry { view, masks, resident });
        }
        if residency.streamed > 0 {
            let largest = residency.streamed_max_bytes / 4;
            photos.ring = (0..in_flight)
                .map(|_| gpu.room("photo ring", largest))
                .collect::<Result<_>>()?;
        }
        Ok(photos)
    }

    /// Photograph of the `index`-th training view, on the device when the frame runs.
    pub(crate) fn bind(&mut self, rec: &mut Recorder<'_>, dataset: &Dataset, index: usize) -> Result<Bound> {
        let entry = &self.entries[index];
        if let Some(resident) = &entry.resident {
            return Ok(resident.clone());
        }
        let photo = self.cache.get(dataset, entry.view)?;
        let pixels = self.ring[self.next % self.ring.len()].clone();
        self.next += 1;
        rec.update(&pixels, 0, &words(&photo));
        Ok(bound(pixels, &photo, entry.masks))
    }
}

/// 8-bit RGBA words, red in the lowest byte, as in the shaders.
fn words(photo: &Photo) -> Vec<u32> {
    photo.rgba.iter().map(|&rgba| u32::from_le_bytes(rgba)).collect()
}

fn bound(pixels: Buffer<u32>, photo: &Photo, masks: bool) -> Bound {
    let weight = match masks {
        true => photo.rgba.iter().map(|rgba| f64::from(rgba[3]) / 255.0).sum(),
        false => photo.rgba.len() as f64,
    };
    Bound { pixels, masks, weight }
}
