//! Device memory of a training run by buffer: a closed formula, printed before a run and tested against its
//! allocations.

use super::config::{StrategyKind, TrainConfig};
use super::device::DeviceState;
use super::gradients::{Gradients, pixel_bytes};
use super::photos::Residency;
use super::transients::PatchGrid;
use super::{poses, schedule};
use crate::gpu::{Gpu, STAGING_BYTES, TRANSFER_BYTES};
use crate::kernels::rasterize::Outputs;
use crate::layout::SURFACE_PLANES;
use crate::render::{ByDegree, Capacity, Need, Purpose, RowBands, Scratch, binding_limit, of_degree, total};
use crate::scene::{Dataset, Split};

/// Bytes of a step's sums that are read back beside residuals, about.
const SUM_BYTES: usize = 1 << 10;

/// Steps in flight.
pub(crate) const IN_FLIGHT: usize = 2;

/// Capacity for `isects` (splat, tile) pairs and an eighth more: the next view may need more, and growing costs the
/// steps in flight.
pub(crate) fn with_margin(isects: usize) -> usize {
    isects + isects / 8
}

/// Limits of a device that a run's buffers depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BufferLimits {
    /// Bytes for all buffers.
    pub memory: u64,
    /// Largest range of a binding, bytes: larger photographs are drawn in bands of rows.
    pub binding: u64,
}

impl BufferLimits {
    /// Limits of a device.
    pub fn of(gpu: &Gpu) -> BufferLimits {
        BufferLimits {
            memory: gpu.memory_limit(),
            binding: binding_limit(gpu.caps()),
        }
    }

    /// Largest range of a binding that a run's steps use, bytes.
    pub fn step_binding(&self, config: &TrainConfig) -> u64 {
        match u64::from(config.band_pixels) {
            0 => self.binding,
            pixels => self.binding.min(pixels * pixel_bytes(config.outputs())),
        }
    }
}

/// Bands of rows that a step draws a photograph in.
pub(crate) fn row_bands(size: [u32; 2], outputs: Outputs, binding: u64) -> RowBands {
    RowBands::for_training(size, pixel_bytes(outputs), binding)
}

/// Input of the memory formula.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrainSize {
    /// Outputs of a step's frame, with the kind of the splats.
    pub outputs: Outputs,
    /// Maximum number of splats at one time.
    pub splats: usize,
    /// Highest SH degree.
    pub sh_degree: u32,
    /// Number of splats of degrees 0, 1 and 2, as far as below `sh_degree`.
    pub lower: [usize; 3],
    /// Maximum number of (splat, tile) pairs of a frame, of a photograph in bands those of a band.
    pub isects: usize,
    /// Width and height of the photograph with the largest drawn part, pixels.
    pub image: [u32; 2],
    /// Largest range of a binding, bytes.
    pub binding: u64,
    /// Placement of the photographs.
    pub photos: Residency,
    /// Whether photographs are replaced by larger ones during the run.
    pub reloads: bool,
    /// Most patches of a photograph; 0 unless the run ignores transients.
    pub patches: usize,
    /// Width and height of the largest view drawn to refine poses, pixels, if the run does.
    pub pose_view: Option<[u32; 2]>,
}

impl TrainSize {
    /// Training with so many splats on a data set, on a device with these limits; pairs are estimated.
    pub fn of(dataset: &Dataset, config: &TrainConfig, limits: BufferLimits, splats: usize) -> TrainSize {
        let views = dataset.split(Split::Train);
        let sizes = views.iter().map(|&view| {
            let camera = &dataset.views[view].camera;
            [camera.width, camera.height]
        });
        let (outputs, binding) = (config.outputs(), limits.step_binding(config));
        let area = |size: [u32; 2]| u64::from(size[0]) * u64::from(size[1]);
        let drawn = |&size: &[u32; 2]| (area(row_bands(size, outputs, binding).drawn()), area(size));
        let image = sizes.clone().max_by_key(drawn).unwrap_or([1, 1]);
        TrainSize {
            outputs,
            splats,
            sh_degree: config.sh_degree,
            lower: [0; 3],
            isects: row_bands(image, outputs, binding).pairs_expected(splats),
            image,
            binding,
            patches: match config.ignore_transients {
                true => sizes
                    .clone()
                    .map(|[w, h]| PatchGrid::of(w, h).count())
                    .max()
                    .unwrap_or(0),
                false => 0,
            },
            pose_view: config.refine_poses.then(|| pose_view(sizes.clone())).flatten(),
            photos: Residency::of(sizes, config.photo_share, limits.memory),
            reloads: config.reloads(),
        }
    }

    /// Largest range of a binding, bytes, in whose bands of rows training with `expected` splats fits into a memory,
    /// else that with these splats; the present one if neither does.
    pub fn binding_within(&self, expected: usize, memory: u64) -> u64 {
        let fewer = self.row_bands().fewer_pixels();
        let smaller = fewer.map(|pixels| self.binding.min(pixels * pixel_bytes(self.outputs)));
        let all: Vec<u64> = std::iter::once(self.binding).chain(smaller).collect();
        let fits = |splats: usize, binding: u64| {
            let bands = row_bands(self.image, self.outputs, binding);
            let size = TrainSize {
                splats,
                binding,
                isects: bands.pairs_expected(splats),
                ..*self
            };
            size.bytes() <= memory
        };
        let first = |splats: usize| all.iter().copied().find(|&binding| fits(splats, binding));
        first(expected).or_else(|| first(self.splats)).unwrap_or(self.binding)
    }

    /// Number of splats of each degree.
    pub fn counts(&self) -> ByDegree {
        let mut counts = of_degree(self.splats, self.sh_degree);
        for (degree, lower) in self.lower.into_iter().enumerate() {
            counts[self.sh_degree as usize] -= lower;
            counts[degree] += lower;
        }
        counts
    }

    /// Buffers of such a run with their bytes, in the order of their use in a step.
    pub fn needs(&self) -> Vec<Need> {
        let needs = self.needs_with(with_margin(self.isects));
        needs.into_iter().filter(|need| need.bytes > 0).collect()
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        total(&self.needs())
    }

    /// Bytes per additional splat.
    pub fn bytes_per_splat(&self) -> f64 {
        let at = |splats: usize| TrainSize {
            splats,
            isects: self.row_bands().pairs_expected(splats),
            lower: self.lower.map(|of| of * splats / self.splats.max(1)),
            ..*self
        };
        let step = (self.splats / 10).max(1_000);
        let more = at(self.splats + step).bytes() - at(self.splats).bytes();
        more as f64 / step as f64
    }

    /// Bytes of parameters, moments, photographs and lists without their margin: the minimum of the run.
    pub fn essential_bytes(&self) -> u64 {
        let mut needs = self.needs_with(self.isects);
        needs.retain(|need| need.purpose.is_essential());
        total(&needs)
    }

    /// Bands of the largest photograph.
    pub fn row_bands(&self) -> RowBands {
        row_bands(self.image, self.outputs, self.binding)
    }

    /// Estimated (splat, tile) pairs of a frame.
    pub fn pairs_expected(&self) -> usize {
        self.row_bands().pairs_expected(self.splats)
    }

    fn needs_with(&self, isects: usize) -> Vec<Need> {
        let bands = self.row_bands();
        let [width, height] = bands.drawn();
        let capacity = Capacity::for_image(self.splats, isects, width, height);
        let state = DeviceState::needs(self.counts());
        // Allocated when photographs have been transferred: after a change, the staging of streamed ones.
        let later = match self.reloads {
            true => (IN_FLIGHT * self.photos.streamed_max_bytes) as u64,
            false => total(&state) + total(&Gradients::needs(capacity, self.outputs)),
        };
        let mut needs = photo_needs(self.photos, self.splats, self.patches * bands.count() as usize, later);
        needs.extend(state);
        if bands.count() > 1 {
            needs.push(DeviceState::further_gradients(self.counts()));
        }
        needs.extend(step_needs(capacity, self.outputs));
        needs.extend(self.pose_view.map(|view| self.pose_need(view)));
        needs
    }

    /// Buffers of a view that is drawn to refine poses, beside those of steps.
    fn pose_need(&self, view: [u32; 2]) -> Need {
        let outputs = Outputs {
            surface: true,
            surfels: self.outputs.surfels,
            ..Outputs::default()
        };
        let bands = RowBands::for_drawing(view, outputs, self.binding);
        let [width, height] = bands.drawn();
        let isects = with_margin(bands.pairs_expected(self.splats));
        let capacity = Capacity::for_image(self.splats, isects, width, height);
        let read = 4 * (4 + SURFACE_PLANES as usize) * capacity.pixels;
        let bytes = total(&Scratch::needs(capacity, outputs)) as usize + read + STAGING_BYTES;
        Need::new("view for poses", Purpose::Pixels, 1, bytes)
    }
}

impl TrainConfig {
    /// Whether photographs are replaced by larger ones during the run.
    pub fn reloads(&self) -> bool {
        schedule::halvings(self, 0) > 0
    }

    /// The same run with [`TrainConfig::band_pixels`] such that it fits into a device's memory: as it is if it fits in
    /// whole photographs, if no bands fit, or if that is set already.
    pub fn within(self, dataset: &Dataset, limits: BufferLimits) -> TrainConfig {
        if self.band_pixels != 0 {
            return self;
        }
        let first = first_splats(dataset, &self);
        let expected = splats_expected(&self, first).unwrap_or(first);
        let size = TrainSize::of(dataset, &self, limits, first);
        let binding = size.binding_within(expected, limits.memory);
        let pixels = match binding < size.binding {
            true => binding / pixel_bytes(size.outputs),
            false => 0,
        };
        TrainConfig {
            band_pixels: u32::try_from(pixels).unwrap_or(0),
            ..self
        }
    }
}

/// Width and height of the largest of views of these sizes that are drawn to refine poses.
fn pose_view(sizes: impl Iterator<Item = [u32; 2]>) -> Option<[u32; 2]> {
    sizes
        .map(poses::drawn_size)
        .max_by_key(|[width, height]| u64::from(*width) * u64::from(*height))
}

/// Number of splats that a run begins with, about.
pub fn first_splats(dataset: &Dataset, config: &TrainConfig) -> usize {
    let points = match dataset.points.len() {
        0 => config.init.random_count as usize,
        points => points.min(config.splat_limit()),
    };
    let sky = if config.sky { config.shell.count as usize } else { 0 };
    (points + sky).min(config.splat_limit())
}

/// Buffers of a step.
pub(crate) fn step_needs(capacity: Capacity, outputs: Outputs) -> Vec<Need> {
    let frame = Scratch::needs(capacity, outputs);
    [frame, Gradients::needs(capacity, outputs)].concat()
}

/// Buffers of the photographs, and for transfers to the device and back.
fn photo_needs(photos: Residency, splats: usize, patches: usize, later: u64) -> Vec<Need> {
    let ring = IN_FLIGHT * photos.streamed_max_bytes;
    // Each frame in flight has a chunk for writing, one for reading back, and a streamed photograph.
    let frames = IN_FLIGHT * (STAGING_BYTES + photos.streamed_max_bytes);
    // A refinement transfers one plane of splats at a time; the start, a photograph, before there are other buffers.
    let first = photos.max_bytes.min(TRANSFER_BYTES).saturating_sub(later as usize);
    let piece = (16 * splats).clamp(STAGING_BYTES, TRANSFER_BYTES).max(first);
    // Residuals of patches share a chunk with the other sums if they leave room for them.
    let residuals = size_of::<[f32; 4]>() * patches;
    let reading = match residuals + SUM_BYTES > STAGING_BYTES {
        true => STAGING_BYTES + residuals.max(STAGING_BYTES),
        false => STAGING_BYTES,
    };
    use Purpose::*;
    vec![
        Need::new("photo", Photos, 1, photos.resident_bytes),
        Need::new("photo ring", Photos, 1, ring),
        Need::new("staging", Transfer, 1, frames),
        Need::new("readback", Transfer, 1, IN_FLIGHT * reading + piece),
    ]
}

/// Maximum number of splats of a run that starts with `first`, as far as its strategy determines it: the cap, or for
/// MCMC its known growth at known iterations. `None`: ADC without a cap.
pub fn splats_expected(config: &TrainConfig, first: usize) -> Option<usize> {
    if config.strategy == StrategyKind::Adc {
        return config.max_splats.map(|limit| first.max(limit as usize));
    }
    let limit = config.splat_limit();
    let refinements = (1..=config.iterations).filter(|&i| schedule::is_refine(config, i));
    let factor = f64::from(config.mcmc.growth);
    Some(refinements.fold(first, |count, _| {
        let grown = (count as f64 * factor).round() as usize;
        count.max(grown.min(limit))
    }))
}
