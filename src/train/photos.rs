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

/// Which photographs are on the device throughout.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Residency {
    /// How many are.
    pub resident: usize,
    /// Their bytes.
    pub resident_bytes: usize,
    /// How many are uploaded for each step that takes one.
    pub streamed: usize,
    /// Bytes of the largest of those.
    pub streamed_max_bytes: usize,
    /// Bytes of the largest of all.
    pub max_bytes: usize,
}

impl Residency {
    /// Of photographs of these sizes in pixels, which may take `share` of the memory: in their order, each
    /// that still fits stays.
    pub fn of(sizes: impl Iterator<Item = [u32; 2]>, share: f32, memory_limit: u64) -> Residency {
        let mut residency = Residency::default();
        let budget = (memory_limit as f64 * f64::from(share)) as u64;
        sizes.for_each(|size| _ = residency.admit(size, budget));
        residency
    }

    /// Whether one more photograph stays.
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
        let budget = (gpu.memory_limit() as f64 * f64::from(share)) as u64;
        let mut photos = Photos {
            entries: Vec::new(),
            cache,
            ring: Vec::new(),
            next: 0,
        };
        let mut residency = Residency::default();
        for &view in views {
            let camera = &dataset.views[view].camera;
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
            if residency.admit([camera.width, camera.height], budget) {
                let photo = photos.cache.get(dataset, view)?;
                entry.resident = Some(gpu.buffer_from("photo", &words(&photo))?);
                entry.weight = Some(weight(&photo, masks));
            }
            photos.entries.push(entry);
        }
        if residency.streamed > 0 {
            let largest = residency.streamed_max_bytes / 4;
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
