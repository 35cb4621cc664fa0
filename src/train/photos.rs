//! Photographs on the device: all of them while they fit, else one at a time.

use crate::Result;
use crate::gpu::{Buffer, Gpu, Recorder};
use crate::io::photo::PhotoCache;
use crate::scene::{AlphaMode, Dataset, Photo, PhotoSource};

/// Bytes of decoded photographs kept on the host; beyond that they are decoded when they are needed.
const HOST_BUDGET: u64 = 4 << 30;

/// One training photograph.
struct Entry {
    /// Its view in the data set.
    view: usize,
    /// 8-bit RGBA; `None`: streamed.
    resident: Option<Buffer<u32>>,
    /// Whether alpha weighs the loss rather than being composited.
    masks: bool,
    /// Sum of the pixels' weights, where known.
    weight: Option<f64>,
}

/// The training photographs.
pub(crate) struct Photos {
    entries: Vec<Entry>,
    cache: PhotoCache,
    /// One buffer per frame in flight, for photographs that are not resident.
    ring: Vec<Buffer<u32>>,
    next: usize,
}

/// What the loss needs to know of a step's photograph.
pub(crate) struct Bound {
    pub(crate) pixels: Buffer<u32>,
    pub(crate) masks: bool,
    /// Sum of the pixels' weights.
    pub(crate) weight: f64,
}

impl Photos {
    /// Decodes the views' photographs in parallel and uploads what fits into `share` of the device's memory.
    pub(crate) fn new(
        gpu: &Gpu,
        dataset: &Dataset,
        views: &[usize],
        in_flight: usize,
        share: f32,
    ) -> Result<Photos> {
        let cache = PhotoCache::new(dataset, HOST_BUDGET);
        cache.load_all(dataset, views)?;
        let mut left = (gpu.memory_limit() as f64 * f64::from(share)) as u64;
        let mut photos = Photos {
            entries: Vec::new(),
            cache,
            ring: Vec::new(),
            next: 0,
        };
        let mut largest = 0;
        for &view in views {
            let camera = &dataset.views[view].camera;
            let pixels = camera.width as usize * camera.height as usize;
            let undistorted = matches!(
                dataset.views[view].photo,
                PhotoSource::File {
                    distortion: Some(_),
                    ..
                }
            );
            // Undistortion leaves pixels that the photograph does not reach; only a weight can leave them out.
            let masks = undistorted || dataset.alpha == AlphaMode::Mask;
            let mut entry = Entry {
                view,
                resident: None,
                masks,
                weight: None,
            };
            if let Some(rest) = left.checked_sub(4 * pixels as u64) {
                left = rest;
                let photo = photos.cache.get(dataset, view)?;
                entry.resident = Some(gpu.buffer_from("photo", &words(&photo))?);
                entry.weight = Some(weight(&photo, masks));
            } else {
                largest = largest.max(pixels);
            }
            photos.entries.push(entry);
        }
        if largest > 0 {
            photos.ring = (0..in_flight)
                .map(|_| gpu.buffer("photo ring", largest))
                .collect::<Result<_>>()?;
        }
        Ok(photos)
    }

    /// The photograph of the `index`-th training view, on the device when the frame runs.
    pub(crate) fn bind(
        &mut self,
        rec: &mut Recorder<'_>,
        dataset: &Dataset,
        index: usize,
    ) -> Result<Bound> {
        let entry = &self.entries[index];
        if let (Some(pixels), Some(weight)) = (&entry.resident, entry.weight) {
            return Ok(Bound {
                pixels: pixels.clone(),
                masks: entry.masks,
                weight,
            });
        }
        let photo = self.cache.get(dataset, entry.view)?;
        let pixels = self.ring[self.next % self.ring.len()].clone();
        self.next += 1;
        rec.update(&pixels, 0, &words(&photo));
        Ok(Bound {
            pixels,
            masks: entry.masks,
            weight: weight(&photo, entry.masks),
        })
    }
}

/// Red in the lowest byte, as the shaders read it.
fn words(photo: &Photo) -> Vec<u32> {
    photo
        .rgba
        .iter()
        .map(|&rgba| u32::from_le_bytes(rgba))
        .collect()
}

fn weight(photo: &Photo, masks: bool) -> f64 {
    if !masks {
        return photo.rgba.len() as f64;
    }
    photo
        .rgba
        .iter()
        .map(|rgba| f64::from(rgba[3]) / 255.0)
        .sum()
}
