//! Contribution of every splat of a scene to its views.

mod record;

use crate::gpu::{Buffer, Frames, Gpu};
use crate::kernels::{contribution, prune_limit, removal_error, sum_by_splat};
use crate::layout::*;
use crate::render::{
    Blocks, ByDegree, Capacity, Compatibility, DepthBands, Forward, Model, Need, Outputs, RenderOptions, Scratch,
    ViewOptions, buffers, isects_expected, list_limit, view_of,
};
use crate::scene::{Camera, Primitive, Splats};
use crate::{Error, Result};
use std::sync::Arc;

/// Options of a contribution pass.
#[derive(Clone, Copy, Debug)]
pub struct PassOptions {
    /// Near plane along z, world units; nearer splats are not drawn.
    pub near: f32,
    /// Background colour.
    pub background: [f32; 3],
    /// Rasterisation rules: the engine's or those of the 3DGS code.
    pub compatibility: Compatibility,
}

/// Contribution of a splat over all pixels of some views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplatContribution {
    /// Maximum over pixels of (weight + budget already spent); 0 if the splat has no weight anywhere.
    pub most: f32,
    /// Sum of the weights.
    pub sum: f32,
    /// Minimum over its pixels of the highest rank up to which all splats can go; huge if the splat has no weight
    /// anywhere.
    pub limit: f32,
}

/// Effect of a splat on one picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RemovalError {
    /// Sum of the splat's weights over the pixels.
    pub weight: f32,
    /// Sum over pixels and channels of the squared change by removal of the splat.
    pub change: f32,
}

/// Rendered picture with the statistics of its tiles.
#[derive(Clone, Debug)]
pub struct RenderedTiles {
    /// Planes of red, green, blue and transmittance.
    pub planes: Vec<f32>,
    /// By tile: minimum and maximum of each channel over its splats and the background.
    pub range_from_tile: Vec<[[f32; 2]; 3]>,
    /// By tile: number of splats.
    pub count_from_tile: Vec<u32>,
}

/// Number of ranks: 1 to this. Rank 0 marks removed splats.
pub(super) const RANKS: usize = 255;

/// Rank of splats that stay.
pub(super) const STAYS: f32 = 1e9;

/// Step sizes of the search for the highest rank, up to [`RANKS`].
const STEPS: [f32; 4] = [64.0, 16.0, 4.0, 1.0];

/// Largest element, in bytes, of the arrays with one element per (splat, tile) pair.
const ISECT_BYTES: u64 = 12;

/// Pass over the views of a scene.
pub struct ContributionPass {
    gpu: Gpu,
    pass_options: PassOptions,
    frames: Frames,
    resources: Resources,
}

/// Kernels after the drawing, compiled once for several passes with the same rules.
pub(super) struct Kernels {
    prune_limit: prune_limit::PruneLimit,
    contribution: contribution::Contribution,
    removal_error: removal_error::RemovalError,
    sum_by_splat: sum_by_splat::SumBySplat,
    /// Sums only, without maxima and minima.
    total: sum_by_splat::SumBySplat,
}

impl Kernels {
    pub(super) fn new(gpu: &Gpu, compatibility: Compatibility, primitive: Primitive) -> Result<Arc<Kernels>> {
        let (caps, outputs) = (gpu.caps(), outputs(primitive));
        let inria = u32::from(compatibility == Compatibility::Inria);
        let mut prune_limit = prune_limit::Choice::prefer(caps, outputs);
        let mut contribution = contribution::Choice::prefer(caps, outputs);
        let mut removal_error = removal_error::Choice::prefer(caps, outputs);
        (prune_limit.spec.inria, contribution.spec.inria) = (inria, inria);
        removal_error.spec.inria = inria;
        let sum_by_splat = sum_by_splat::Choice::default();
        let mut total = sum_by_splat;
        total.spec.sums = 1;
        Ok(Arc::new(Kernels {
            prune_limit: prune_limit::PruneLimit::new(gpu, prune_limit)?,
            contribution: contribution::Contribution::new(gpu, contribution)?,
            removal_error: removal_error::RemovalError::new(gpu, removal_error)?,
            sum_by_splat: sum_by_splat::SumBySplat::new(gpu, sum_by_splat)?,
            total: sum_by_splat::SumBySplat::new(gpu, total)?,
        }))
    }
}

/// Kernels, scene and buffers.
struct Resources {
    model: Model,
    forward: Forward,
    kernels: Arc<Kernels>,
    buffers: ViewBuffers,
    sums: ContributionSums,
}

/// Buffers of one view.
struct ViewBuffers {
    scratch: Scratch,
    own: PixelSums,
}

buffers! {
    /// Buffers of a view beyond those of rendering.
    struct PixelSums(capacity: Capacity) {
        spent_from_pixel: Buffer<f32>, Pixels, capacity.pixels;
        limit_from_pixel: Buffer<f32>, Pixels, capacity.pixels;
        record_from_emitted: Buffer<[f32; 3]>, Intersections, capacity.isects;
    }
}

buffers! {
    /// Buffers of all views.
    struct ContributionSums(splats: usize) {
        sum_from_splat: Buffer<[f32; 3]>, Splats, splats;
        rank_from_splat: Buffer<f32>, Splats, splats;
    }
}

/// Outputs of the drawn views: those of splats of a kind.
fn outputs(primitive: Primitive) -> Outputs {
    let options = RenderOptions {
        primitive,
        ..RenderOptions::default()
    };
    options.outputs()
}

impl ViewBuffers {
    fn new(gpu: &Gpu, capacity: Capacity, outputs: Outputs) -> Result<ViewBuffers> {
        let capacity = capacity.within(gpu.caps(), ISECT_BYTES);
        Ok(ViewBuffers {
            scratch: Scratch::new(gpu, capacity, outputs)?,
            own: PixelSums::new(gpu, capacity)?,
        })
    }
}

impl ContributionPass {
    /// Uploads a scene to the device.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for surfels by the rules of the 3DGS code, which have none.
    pub fn new(gpu: &Gpu, splats: &Splats, pass_options: PassOptions) -> Result<ContributionPass> {
        let kernels = Kernels::new(gpu, pass_options.compatibility, splats.primitive)?;
        ContributionPass::with(kernels, gpu, splats, pass_options)
    }

    /// The same with kernels for these options.
    pub(super) fn with(
        kernels: Arc<Kernels>,
        gpu: &Gpu,
        splats: &Splats,
        pass_options: PassOptions,
    ) -> Result<ContributionPass> {
        let count = splats.len().max(1);
        let options = RenderOptions {
            sh_degree: splats.sh_degree,
            primitive: splats.primitive,
            compatibility: pass_options.compatibility,
            ..RenderOptions::default()
        };
        options.check_rules()?;
        let resources = Resources {
            model: Model::upload(gpu, splats)?,
            forward: Forward::for_rendering(gpu, &options)?,
            kernels,
            buffers: ViewBuffers::new(gpu, Capacity::LEAST, options.outputs())?,
            sums: ContributionSums::new(gpu, count)?,
        };
        Ok(ContributionPass {
            gpu: gpu.clone(),
            pass_options,
            frames: Frames::new(gpu, 1, false)?,
            resources,
        })
    }

    /// Buffers of a pass over a scene of so many splats of each degree.
    pub(super) fn needs(counts: ByDegree, capacity: Capacity, outputs: Outputs) -> Vec<Need> {
        let mut needs = Model::needs(Blocks::anywhere(counts));
        needs.extend(Scratch::needs(capacity, outputs));
        needs.extend(PixelSums::needs(capacity));
        needs.extend(ContributionSums::needs(counts.iter().sum()));
        needs
    }

    /// Options of the pass.
    pub fn pass_options(&self) -> &PassOptions {
        &self.pass_options
    }

    /// Splats of the scene.
    pub fn splat_count(&self) -> usize {
        self.resources.model.splat_count
    }

    /// Contribution of each splat over all views. `ranks` by splat: 0 removed, 1 to 255 candidate, more stays.
    /// `budget`: the summed weight that a pixel can lose. `None` if `go_on`, called before every view, returns false.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if a view has more (splat, tile) pairs than a binding of the device can address.
    pub fn losses(
        &mut self,
        cameras: &[Camera],
        ranks: &[f32],
        budget: f32,
        go_on: &mut dyn FnMut() -> bool,
    ) -> Result<Option<Vec<SplatContribution>>> {
        let count = self.splat_count();
        assert_eq!(ranks.len(), count, "a rank for every splat");
        self.gpu.upload(&self.resources.sums.rank_from_splat, 0, ranks)?;
        let nothing = [0.0, 0.0, f32::MAX];
        self.gpu
            .upload(&self.resources.sums.sum_from_splat, 0, &vec![nothing; count])?;
        for camera in cameras {
            if !go_on() {
                return Ok(None);
            }
            self.draw(camera, Some(budget))?;
        }
        let loss = |[most, sum, limit]: [f32; 3]| SplatContribution { most, sum, limit };
        let totals = self.gpu.download(&self.resources.sums.sum_from_splat, 0..count)?;
        Ok(Some(totals.into_iter().map(loss).collect()))
    }

    /// Effect of each splat on a view.
    ///
    /// # Errors
    /// As [`ContributionPass::losses`].
    pub fn removal_errors(&mut self, camera: &Camera) -> Result<Vec<RemovalError>> {
        self.draw(camera, None)?;
        let count = self.splat_count();
        self.gpu
            .upload(&self.resources.sums.sum_from_splat, 0, &vec![[0.0; 3]; count])?;
        let resources = &self.resources;
        let view = self.view(camera);
        let (ticket, ()) = self.frames.submit(|rec| {
            resources.record_removal_errors(rec, &view);
            Ok(())
        })?;
        self.frames.wait(ticket)?;
        let removal_error = |[weight, change, _]: [f32; 3]| RemovalError { weight, change };
        let totals = self.gpu.download(&self.resources.sums.sum_from_splat, 0..count)?;
        Ok(totals.into_iter().map(removal_error).collect())
    }

    /// Renders a view at the scene's full SH degree.
    ///
    /// # Errors
    /// As [`ContributionPass::losses`].
    pub fn show(&mut self, camera: &Camera) -> Result<RenderedTiles> {
        let count = self.splat_count();
        let counts = self.draw(camera, None)?;
        let (gpu, s) = (&self.gpu, &self.resources.buffers.scratch);
        let capacity = Capacity::for_image(0, 0, camera.width, camera.height);
        let isects = counts[COUNT_ISECT as usize] as usize;
        let sorted = Forward::sorted_index(capacity.tiles);
        let ranges = gpu.download(&s.range_from_tile, 0..capacity.tiles)?;
        let sources = gpu.download(&s.emitted_from_isect[sorted], 0..isects)?;
        let owners = gpu.download(&s.splat_from_emitted, 0..isects)?;
        let tones = gpu.download(&s.whiten_rg_from_splat, 0..count)?;
        let rests = gpu.download(&s.blue_depth_from_splat, 0..count)?;
        let background = self.pass_options.background;
        let range = |&[begin, end]: &[u32; 2]| {
            let mut range = background.map(|c| [c, c]);
            for &source in &sources[begin as usize..end as usize] {
                let splat = owners[source as usize] as usize;
                let color = [tones[splat][2], tones[splat][3], rests[splat][0]];
                for (range, value) in range.iter_mut().zip(color) {
                    *range = [range[0].min(value), range[1].max(value)];
                }
            }
            range
        };
        Ok(RenderedTiles {
            planes: gpu.download(&s.image, 0..4 * capacity.pixels)?,
            range_from_tile: ranges.iter().map(range).collect(),
            count_from_tile: ranges.iter().map(|[begin, end]| end - begin).collect(),
        })
    }

    fn view(&self, camera: &Camera) -> View {
        let options = ViewOptions {
            background: self.pass_options.background,
            near: self.pass_options.near,
            filter: self.resources.model.filter,
        };
        view_of(camera, &options)
    }

    /// Draws a view, with a budget without SH and with the contribution of every splat at pixels with it; returns the
    /// kernels' counters.
    fn draw(&mut self, camera: &Camera, budget: Option<f32>) -> Result<Vec<u32>> {
        let sh_degree = budget.map_or(self.resources.model.sh_degree, |_| 0);
        let Resources { forward, model, .. } = &mut self.resources;
        forward.prepare(&self.gpu, model, sh_degree)?;
        let view = self.view(camera);
        self.reserve(camera, isects_expected(self.splat_count(), camera.width, camera.height))?;
        loop {
            let resources = &self.resources;
            let (ticket, counts) = self.frames.submit(|rec| {
                let s = &resources.buffers.scratch;
                rec.fill(&s.counts, 0);
                let bands = DepthBands::default();
                resources
                    .forward
                    .record(rec, &resources.model, s, &view, sh_degree, bands);
                if let Some(budget) = budget {
                    resources.record_losses(rec, &view, budget);
                }
                rec.read_back(&s.counts, 0..COUNT_SLOTS as usize)
            })?;
            self.frames.wait(ticket)?;
            let counts = counts.get();
            if counts[COUNT_FAILED as usize] == 0 {
                return Ok(counts);
            }
            self.enlarge(camera, &counts)?;
        }
    }

    /// Grows the buffers for a view that did not fit.
    fn enlarge(&mut self, camera: &Camera, counts: &[u32]) -> Result<()> {
        if counts[COUNT_LIST_TOO_LONG as usize] != 0 {
            let limit = list_limit(self.gpu.caps().kind);
            return Err(Error::Unsupported {
                what: format!(
                    "weighing more than {limit} splats over one tile of 8x16 pixels: this software device would leave \
                     its loops early"
                ),
            });
        }
        let wanted = counts[COUNT_ISECT_WANTED as usize] as usize;
        self.reserve(camera, wanted.saturating_add(wanted / 8))?;
        let buffers = self.resources.buffers.scratch.capacity.isects;
        if buffers < wanted {
            return Err(Error::Unsupported {
                what: format!(
                    "weighing {wanted} pairs of a splat and a tile in one view, where the device's bindings reach \
                     {buffers}: smaller pictures (--downscale) have fewer"
                ),
            });
        }
        Ok(())
    }

    fn reserve(&mut self, camera: &Camera, isects: usize) -> Result<()> {
        let had = self.resources.buffers.scratch.capacity;
        let count = self.splat_count().max(1);
        let wanted = Capacity::for_image(count, isects, camera.width, camera.height);
        let capacity = had.max(wanted).within(self.gpu.caps(), ISECT_BYTES);
        if capacity != had {
            // The old buffers are freed first: memory may not hold both.
            self.frames.release()?;
            let outputs = outputs(self.resources.model.primitive);
            self.resources.buffers = ViewBuffers::new(&self.gpu, Capacity::LEAST, outputs)?;
            self.resources.buffers = ViewBuffers::new(&self.gpu, capacity, outputs)?;
        }
        Ok(())
    }
}
