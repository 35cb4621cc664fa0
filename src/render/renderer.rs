//! Renderer: records into a host's commands, or renders and reads back.

use super::capacity::Capacity;
use super::compatibility::Compatibility;
use super::depth_bands::{DepthBands, list_limit};
use super::forward::Forward;
use super::memory::isects_expected;
use super::model::Model;
use super::occlusion::Occlusion;
use super::options::RenderOptions;
use super::scratch::Scratch;
use super::surface::Surface;
use super::target::HostTarget;
use super::view::{ViewOptions, view_of};
use crate::gpu::{Frames, Gpu, HostCommands, Readback, Ticket};
use crate::kernels::{overlay, present};
use crate::layout::{COUNT_FAILED, COUNT_ISECT_WANTED, COUNT_SLOTS, SURFACE_PLANES};
use crate::scene::{Camera, NotFinite, Primitive, Splats};
use crate::{Error, Result};
use std::collections::VecDeque;

/// Bytes of a (splat, tile) pair in any one array.
const ISECT_BYTES: u64 = 4;

/// An image read back from the device.
#[derive(Clone, Debug)]
pub struct RenderedImage {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// RGB of each pixel, row by row from the top; display-referred, background blended in, not clamped at 1.
    pub rgb: Vec<[f32; 3]>,
    /// Transmittance of all splats in each pixel, 0 to 1.
    pub transmittance: Vec<f32>,
    /// Σ weight · z of each pixel in world units, z of the splats' means; divide by 1 − transmittance for the mean.
    /// Empty unless requested ([`RenderOptions::with_depth`]).
    pub depth: Vec<f32>,
    /// Depths and normals, if requested ([`RenderOptions::with_surface`]).
    pub surface: Option<Surface>,
}

/// Coverage below which a pixel has no depth: one 8-bit level.
const COVERAGE_MIN: f32 = 1.0 / 255.0;

impl RenderedImage {
    /// Coverage of each pixel, 0 to 1.
    pub fn alpha(&self) -> Vec<f32> {
        self.transmittance.iter().map(|t| 1.0 - t).collect()
    }

    /// Mean depth of each pixel along the view's z axis in world units; infinite where coverage is below 1/255. Empty
    /// unless depth was requested.
    pub fn mean_depth(&self) -> Vec<f32> {
        let mean = |(sum, transmittance): (&f32, &f32)| match 1.0 - transmittance {
            alpha if alpha >= COVERAGE_MIN => sum / alpha,
            _ => f32::INFINITY,
        };
        self.depth.iter().zip(&self.transmittance).map(mean).collect()
    }
}

/// Renders scenes on one device.
pub struct Renderer {
    gpu: Gpu,
    forward: Forward,
    present: present::Present,
    /// Kernel of pictures over a host's pixels, where the options ask for it.
    overlay: Option<overlay::Overlay>,
    /// Kernels of pictures behind a host's surfaces, where the options ask for them.
    occlusion: Option<Occlusion>,
    scratch: Scratch,
    /// Frames of [`Renderer::render`], from the first on.
    frames: Option<Frames>,
    /// Last submission to `frames`.
    rendered: Option<Ticket>,
    /// Frames of [`Renderer::record`], paced by the host.
    host_frames: Frames,
    options: RenderOptions,
    /// Bands of the next pictures of a host, from the counts of finished ones.
    bands: DepthBands,
    /// Pictures in the host's frames in flight, oldest first.
    pending: VecDeque<PendingPicture>,
}

/// A recorded picture with unread counts.
struct PendingPicture {
    /// Number of the frame.
    frame: u64,
    /// Capacity of the buffers.
    capacity: Capacity,
    bands: DepthBands,
    /// Splats not drawn.
    not_finite: Option<NotFinite>,
    /// Readback of the frame's counts.
    counts: Readback<u32>,
}

/// Statistics of recorded pictures: pairs, bands, completeness.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stats {
    /// (Splat, tile) pairs of the complete frame.
    pub isects: usize,
    /// Capacity of the buffers in pairs. A frame with more is drawn in bands, one after the other, which takes longer:
    /// [`Renderer::reserve`] raises the capacity.
    pub isect_capacity: usize,
    /// Recorded bands. If they did not suffice, pictures recorded after this one is finished have more.
    pub bands: u32,
    /// True for a complete picture. Else the splats behind some depth are missing, or all.
    pub complete: bool,
    /// Splats not drawn because of a non-finite parameter.
    pub not_finite: Option<NotFinite>,
}

impl Stats {
    /// True if all pairs fitted the buffers at once.
    pub fn fits(&self) -> bool {
        self.isects <= self.isect_capacity
    }

    /// The worse of both in each field.
    fn worse(self, other: Stats) -> Stats {
        Stats {
            isects: self.isects.max(other.isects),
            isect_capacity: self.isect_capacity.min(other.isect_capacity),
            bands: self.bands.max(other.bands),
            complete: self.complete && other.complete,
            not_finite: self.not_finite.or(other.not_finite),
        }
    }
}

impl std::fmt::Debug for Renderer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Renderer({:?}, {:?})", self.gpu, self.scratch.capacity)
    }
}

impl Renderer {
    /// Compiles the kernels, except those already in use on this device, and allocates for `options.capacity`. All
    /// frames share the buffers, so that those of a host go to one queue; a second queue takes a second renderer.
    ///
    /// # Errors
    /// [`Error::Config`] for thresholds out of range, [`Error::Unsupported`] for surfaces and for surfels by the rules
    /// of the 3DGS code, [`Error::OutOfMemory`].
    pub fn new(gpu: &Gpu, options: RenderOptions) -> Result<Renderer> {
        if options.with_surface && options.compatibility == Compatibility::Inria {
            return Err(Error::Unsupported {
                what: "depths and normals of surfaces by the rules of the 3DGS code".into(),
            });
        }
        if options.primitive == Primitive::Surfel && options.compatibility == Compatibility::Inria {
            return Err(Error::Unsupported {
                what: "surfels by the rules of the 3DGS code".into(),
            });
        }
        if options.with_host_depth && options.compatibility == Compatibility::Inria {
            return Err(Error::Unsupported {
                what: "pictures behind a host's surfaces by the rules of the 3DGS code".into(),
            });
        }
        let occlusion = options.with_host_depth.then(|| Occlusion::new(gpu, &options));
        let overlay = || overlay::Overlay::new(gpu, overlay::Choice::default());
        let overlay = options.with_host_color.then(overlay);
        let capacity = options.capacity.within(gpu.caps(), ISECT_BYTES);
        Ok(Renderer {
            gpu: gpu.clone(),
            forward: Forward::for_rendering(gpu, &options)?,
            present: present::Present::new(gpu, present::Choice::default())?,
            overlay: overlay.transpose()?,
            occlusion: occlusion.transpose()?,
            scratch: Scratch::new(gpu, capacity, options.outputs())?,
            frames: None,
            rendered: None,
            host_frames: Frames::in_host(gpu, options.frames_in_flight),
            options,
            bands: DepthBands::default(),
            pending: VecDeque::new(),
        })
    }

    /// Compiles the kernels that a model needs besides those of other models. Compiling can take longer than a frame:
    /// [`Renderer::record`] refuses models that are not prepared. [`Renderer::reserve`] prepares its model, too.
    ///
    /// # Errors
    /// Those of Vulkan.
    pub fn prepare(&mut self, model: &Model) -> Result<()> {
        if let Some(occlusion) = &mut self.occlusion {
            occlusion.prepare(&self.gpu, model)?;
        }
        self.forward.prepare(&self.gpu, model)
    }

    /// Grows the buffers for a frame of `model` through `camera` with up to `isects` (splat, tile) pairs, limited to
    /// one binding of the device; frames with more are drawn in bands. Allocates and compiles: to be called outside of
    /// a host's frames.
    pub fn reserve(&mut self, model: &Model, camera: &Camera, isects: usize) -> Result<()> {
        self.prepare(model)?;
        let wanted = Capacity::for_image(model.splat_count, isects, camera.width, camera.height);
        let capacity = self.scratch.capacity.max(wanted);
        let capacity = capacity.within(self.gpu.caps(), ISECT_BYTES);
        if capacity != self.scratch.capacity {
            // Frees the old buffers first, unless a host's frame uses them: memory may not suffice for both.
            self.release()?;
            for capacity in [Capacity::LEAST, capacity] {
                self.scratch = Scratch::new(&self.gpu, capacity, self.options.outputs())?;
            }
        }
        Ok(())
    }

    /// Lets go of the last rendered model, whose buffers a frame keeps until the next.
    pub(crate) fn release(&mut self) -> Result<()> {
        self.frames.as_mut().map_or(Ok(()), Frames::release)
    }

    /// As [`Renderer::reserve`], but for fewer intersections if memory does not suffice.
    fn reserve_some(&mut self, model: &Model, camera: &Camera, mut isects: usize) -> Result<()> {
        loop {
            match self.reserve(model, camera, isects) {
                Err(Error::OutOfMemory { .. }) if isects > self.scratch.capacity.tiles => {
                    isects /= 2;
                }
                result => return result,
            }
        }
    }

    /// Records a picture into a host's command buffer and writes it to the host's image, or behind the surfaces of the
    /// host's depth image ([`HostTarget`]). Nothing is submitted or waited for. Returns the statistics of a frame's
    /// pictures once `frames_in_flight` further frames have been begun. A picture that does not fit is incomplete;
    /// those recorded after its statistics are drawn in more bands, until the host calls [`Renderer::reserve`] with
    /// [`Stats::isects`].
    ///
    /// # Errors
    /// [`Error::Config`] if the model or the image exceeds the reserved capacity, the model is not prepared or has
    /// another kind or precision, camera and images differ in size, or the options lack a part of the target;
    /// [`Error::Unsupported`] for an image of a format that kernels cannot write or read; errors of Vulkan and memory.
    /// After an error, too, the command buffer can be submitted, and the images are in their states `after`, the
    /// contents of the picture undefined. The picture has no statistics; later ones are not affected.
    pub fn record<'a>(
        &mut self,
        commands: &mut HostCommands,
        model: &Model,
        camera: &Camera,
        view: &ViewOptions,
        target: impl Into<HostTarget<'a>>,
    ) -> Result<Option<Stats>> {
        self.record_to(commands, model, camera, view, target.into())
    }

    fn record_to(
        &mut self,
        commands: &mut HostCommands,
        model: &Model,
        camera: &Camera,
        view: &ViewOptions,
        target: HostTarget<'_>,
    ) -> Result<Option<Stats>> {
        let frame = self.host_frames.frame_in(commands);
        let in_flight = self.host_frames.in_flight() as u64;
        let admitted = self.admit(model, camera, &target);
        let finished = admitted.and_then(|()| self.finished_before((frame + 1).saturating_sub(in_flight)));
        let begun = finished.and_then(|finished| Ok((finished, self.host_frames.begin_in(commands)?)));
        let (finished, mut rec) = match begun {
            Ok(begun) => begun,
            Err(error) => {
                let images = [Some(target.color), target.depth.map(|depth| depth.image)];
                images
                    .iter()
                    .flatten()
                    .for_each(|image| commands.pass(&self.gpu, image));
                return Err(error);
            }
        };
        let (scratch, degree) = (&self.scratch, self.options.sh_degree);
        rec.fill(&scratch.counts, 0);
        let mut forward = &self.forward;
        if let (Some(occlusion), Some(depth)) = (&self.occlusion, &target.depth) {
            occlusion.read(&mut rec, depth, scratch);
            forward = &occlusion.forward;
        }
        let view = ViewOptions {
            background: target.blend.background(view.background),
            ..*view
        };
        forward.record(&mut rec, model, scratch, &view_of(camera, &view), degree, self.bands);
        target.show(&mut rec, scratch, (&self.present, self.overlay.as_ref()));
        let counts = rec.read_back(&scratch.counts, 0..COUNT_SLOTS as usize);
        rec.finish()?;
        self.pending.push_back(PendingPicture {
            frame,
            capacity: scratch.capacity,
            bands: self.bands,
            not_finite: model.not_finite,
            counts: counts?,
        });
        Ok(finished)
    }

    /// Checks the inputs of a picture.
    fn admit(&self, model: &Model, camera: &Camera, target: &HostTarget<'_>) -> Result<()> {
        target.color.check_writable(&self.gpu)?;
        self.check(model)?;
        let (size, [width, height]) = ([camera.width, camera.height], target.color.image().extent());
        if size != [width, height] {
            let [w, h] = size;
            let what = format!("the camera has {w}x{h} pixels, the image to draw to {width}x{height}");
            return Err(Error::Config(what));
        }
        if target.blend.reads() {
            if self.overlay.is_none() {
                return Err(Error::Config(
                    "a host's pixels: the renderer was made without RenderOptions::with_host_color".into(),
                ));
            }
            target.color.check_readable(&self.gpu)?;
            target.blend.check()?;
        }
        if let Some(depth) = &target.depth {
            if self.occlusion.is_none() {
                return Err(Error::Config(
                    "a host's depth: the renderer was made without RenderOptions::with_host_depth".into(),
                ));
            }
            Occlusion::check(&self.gpu, depth, size)?;
        }
        if !self.forward.is_prepared(model) {
            return Err(Error::Config(
                "the model's kernels are not compiled: call prepare first".into(),
            ));
        }
        let capacity = self.scratch.capacity;
        let wanted = Capacity::for_image(model.splat_count, 0, camera.width, camera.height);
        match capacity.max(wanted) == capacity {
            true => Ok(()),
            false => Err(Error::Config(format!(
                "{wanted:?} exceeds the renderer's {capacity:?}: call reserve first"
            ))),
        }
    }

    /// Refuses models of another kind or precision than the kernels'.
    fn check(&self, model: &Model) -> Result<()> {
        let (wanted, found) = (self.options.primitive.name(), model.primitive.name());
        if wanted != found {
            let text = format!("the model's splats are of the kind {found}, but the renderer draws {wanted}");
            return Err(Error::Config(text));
        }
        let (wanted, found) = (self.options.precision, model.precision);
        match wanted == found {
            true => Ok(()),
            false => Err(Error::Config(format!(
                "the model lies on the device as {found:?}, but the renderer draws {wanted:?}"
            ))),
        }
    }

    /// Copies a scene to the device by commands in a host's command buffer, for devices adopted without a queue; with a
    /// queue, [`Model::upload`] does. Pictures of the model may follow in the same commands.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`] and errors of Vulkan; the command buffer can be submitted nevertheless.
    pub fn record_upload(&mut self, commands: &mut HostCommands, splats: &Splats) -> Result<Model> {
        let mut rec = self.host_frames.begin_in(commands)?;
        let model = Model::record_upload(&mut rec, splats, self.options.precision);
        rec.finish()?;
        model
    }

    /// Stages of the last rendered image with their device time in nanoseconds; empty on devices without timestamps.
    pub fn timings(&self) -> Result<Vec<(&'static str, f64)>> {
        match (self.rendered, &self.frames) {
            (Some(last), Some(frames)) => frames.timings(last),
            _ => Ok(Vec::new()),
        }
    }

    /// Bands that complete the picture that left `counts`.
    fn bands_after(&self, bands: DepthBands, counts: &[u32]) -> Result<DepthBands> {
        let limit = list_limit(self.gpu.caps().kind);
        let bands = bands.after(counts, &self.scratch.capacity, limit)?;
        if bands.count > 1 && self.options.compatibility == Compatibility::Inria {
            return Err(Error::Unsupported {
                what: "a picture by the rules of the 3DGS code that takes more than one pass".into(),
            });
        }
        Ok(bands)
    }

    /// Worst statistics of the pictures in frames before `first`, which the host has waited for. Later pictures get the
    /// bands that the last of them needed.
    fn finished_before(&mut self, first: u64) -> Result<Option<Stats>> {
        let mut worst: Option<Stats> = None;
        while self.pending.front().is_some_and(|p| p.frame < first) {
            let Some(picture) = self.pending.pop_front() else {
                break;
            };
            let counts = picture.counts.elements();
            let stats = Stats {
                isects: counts[COUNT_ISECT_WANTED as usize] as usize,
                isect_capacity: picture.capacity.isects,
                bands: picture.bands.count,
                complete: counts[COUNT_FAILED as usize] == 0,
                not_finite: picture.not_finite,
            };
            worst = Some(worst.map_or(stats, |worst| worst.worse(stats)));
            if self.options.compatibility == Compatibility::Engine {
                self.bands = self.bands_after(picture.bands, counts)?;
            }
        }
        Ok(worst)
    }

    /// Renders one image and reads it back. Grows the buffers as needed; draws in bands if they cannot grow.
    pub fn render(&mut self, model: &Model, camera: &Camera, view: &ViewOptions) -> Result<RenderedImage> {
        self.check(model)?;
        let expected = isects_expected(model.splat_count, camera.width, camera.height);
        self.reserve_some(model, camera, expected)?;
        let view = view_of(camera, view);
        let mut bands = DepthBands::default();
        loop {
            let pixels = camera.width as usize * camera.height as usize;
            let (forward, scratch) = (&self.forward, &self.scratch);
            let (degree, outputs) = (self.options.sh_degree, self.options.outputs());
            let of = |wanted: bool, planes: u32| 0..if wanted { planes as usize * pixels } else { 0 };
            let frames = own_frames(&mut self.frames, &self.gpu)?;
            let (ticket, (counts, image, depth, surface)) = frames.submit(|rec| {
                rec.fill(&scratch.counts, 0);
                forward.record(rec, model, scratch, &view, degree, bands);
                Ok((
                    rec.read_back(&scratch.counts, 0..COUNT_SLOTS as usize)?,
                    rec.read_back(&scratch.image, 0..4 * pixels)?,
                    rec.read_back(&scratch.depth, of(outputs.depth, 1))?,
                    rec.read_back(&scratch.surface, of(outputs.surface, SURFACE_PLANES))?,
                ))
            })?;
            frames.wait(ticket)?;
            self.rendered = Some(ticket);
            let counts = counts.get();
            if counts[COUNT_FAILED as usize] == 0 {
                let surface = outputs.surface.then(|| surface.get());
                return Ok(unpack(camera, &image.get(), depth.get(), surface.as_deref()));
            }
            let wanted = counts[COUNT_ISECT_WANTED as usize] as usize;
            self.reserve_some(model, camera, wanted.saturating_add(wanted / 8))?;
            bands = self.bands_after(bands, &counts)?;
        }
    }
}

/// Ring of the renderer's own frames, made for the first.
fn own_frames<'a>(frames: &'a mut Option<Frames>, gpu: &Gpu) -> Result<&'a mut Frames> {
    match frames {
        Some(frames) => Ok(frames),
        none => Ok(none.insert(Frames::new(gpu, 1, true)?)),
    }
}

fn unpack(camera: &Camera, image: &[f32], depth: Vec<f32>, surface: Option<&[f32]>) -> RenderedImage {
    let pixels = camera.width as usize * camera.height as usize;
    let rgb = (0..pixels)
        .map(|i| [image[i], image[pixels + i], image[2 * pixels + i]])
        .collect();
    let transmittance = image[3 * pixels..].to_vec();
    let surface = surface.map(|planes| Surface::unpack(camera, planes, &transmittance));
    RenderedImage {
        width: camera.width,
        height: camera.height,
        rgb,
        transmittance,
        depth,
        surface,
    }
}
