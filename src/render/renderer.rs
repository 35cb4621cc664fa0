//! Renderer: records into a host's commands, or renders and reads back.

mod read_back;

use super::capacity::Capacity;
use super::compatibility::Compatibility;
use super::depth_bands::{DepthBands, list_limit};
use super::forward::Forward;
use super::instances::{FrameContent, Instance};
use super::model::Model;
use super::occlusion::Occlusion;
use super::options::RenderOptions;
use super::picking::{self, PendingPick, PickReport, Picking};
use super::scratch::Scratch;
use super::statistics::Stats;
use super::target::HostTarget;
use super::upload::ModelUpload;
use super::view::{ViewOptions, view_of};
use crate::gpu::{Frames, Gpu, HostCommands, Readback, Ticket};
use crate::kernels::{overlay, present};
use crate::layout::{COUNT_FAILED, COUNT_ISECT_WANTED, COUNT_SLOTS};
use crate::scene::{Camera, NotFinite, Splats};
use crate::{Error, Result};
use std::collections::VecDeque;

/// Bytes of a (splat, tile) pair in any one array.
const ISECT_BYTES: u64 = 4;

/// Renders scenes on one device.
pub struct Renderer {
    gpu: Gpu,
    forward: Forward,
    present: present::Present,
    /// Kernel of pictures over a host's pixels, where the options ask for it.
    overlay: Option<overlay::Overlay>,
    /// Kernels of pictures behind a host's surfaces, where the options ask for them.
    occlusion: Option<Occlusion>,
    /// Kernel of the splats of pixels, where the options ask for them.
    picking: Option<Picking>,
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
    /// Reports of finished pictures, oldest first.
    picks: VecDeque<PickReport>,
    /// Stages of the last finished frame of a host.
    host_timings: Vec<(&'static str, f64)>,
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
    /// Readback of the pixels asked for.
    pick: Option<PendingPick>,
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
    /// [`Error::Config`] for thresholds out of range, [`Error::Unsupported`] for outputs and kinds of splats that
    /// the order, the projection or the rules of the 3DGS code exclude ([`RenderOptions`]), [`Error::OutOfMemory`].
    pub fn new(gpu: &Gpu, options: RenderOptions) -> Result<Renderer> {
        options.check_rules()?;
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
            picking: options.with_ids.then(|| Picking::new(gpu)).transpose()?,
            scratch: Scratch::new(gpu, capacity, options.outputs())?,
            frames: None,
            rendered: None,
            host_frames: Frames::in_host(gpu, options.frames_in_flight, options.with_timings)?,
            options,
            bands: DepthBands::default(),
            pending: VecDeque::new(),
            picks: VecDeque::new(),
            host_timings: Vec::new(),
        })
    }

    /// Compiles the kernels that a model needs besides those of other models. Compiling can take longer than a frame:
    /// [`Renderer::record`] refuses models that are not prepared. [`Renderer::reserve`] prepares its model, too.
    ///
    /// # Errors
    /// Those of Vulkan.
    pub fn prepare(&mut self, model: &Model) -> Result<()> {
        if let Some(occlusion) = &mut self.occlusion {
            occlusion.forward.prepare(&self.gpu, model, self.options.sh_degree)?;
        }
        self.forward.prepare(&self.gpu, model, self.options.sh_degree)
    }

    /// As [`Renderer::prepare`], for instances.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for a renderer of surfaces, and those of Vulkan.
    pub fn prepare_instances(&mut self, instances: &[Instance<'_>]) -> Result<()> {
        if self.options.with_surface {
            return Err(Error::Unsupported {
                what: "depths and normals of surfaces of instances".into(),
            });
        }
        let degree = self.options.sh_degree;
        for instance in instances {
            if let Some(occlusion) = &mut self.occlusion {
                occlusion.forward.prepare_instance(&self.gpu, instance.model, degree)?;
            }
            self.forward.prepare_instance(&self.gpu, instance.model, degree)?;
        }
        Ok(())
    }

    /// Grows the buffers for a frame of `model` through `camera` with up to `isects` (splat, tile) pairs, limited to
    /// one binding of the device; frames with more are drawn in bands. Allocates and compiles: to be called outside of
    /// a host's frames.
    pub fn reserve(&mut self, model: &Model, camera: &Camera, isects: usize) -> Result<()> {
        self.reserve_content(model.into(), camera, isects)
    }

    /// As [`Renderer::reserve`], for a picture of instances. Numbers of pairs are those of the whole picture.
    pub fn reserve_instances(&mut self, instances: &[Instance<'_>], camera: &Camera, isects: usize) -> Result<()> {
        self.reserve_content(FrameContent::Instances(instances, camera), camera, isects)
    }

    fn reserve_content(&mut self, content: FrameContent<'_>, camera: &Camera, isects: usize) -> Result<()> {
        match content {
            FrameContent::Model(model) => self.prepare(model)?,
            FrameContent::Instances(instances, _) => self.prepare_instances(instances)?,
        }
        let wanted = Capacity::for_image(content.splat_count(), isects, camera.width, camera.height);
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
    fn reserve_some(&mut self, content: FrameContent<'_>, camera: &Camera, mut isects: usize) -> Result<()> {
        loop {
            match self.reserve_content(content, camera, isects) {
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
    /// another kind or precision, the images do not have the camera's size, or the options lack a part of the target;
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
        self.record_to(commands, model.into(), camera, view, target.into())
    }

    /// As [`Renderer::record`], for models in their places: their splats are sorted together. The filter of `view` does
    /// not count; each instance has its own. Splats at one depth are in the order of the instances.
    ///
    /// # Errors
    /// Those of [`Renderer::record`], and [`Error::Config`] with the number of an instance with a transform that is no
    /// similarity, an opacity, tint or box out of range.
    pub fn record_instances<'a>(
        &mut self,
        commands: &mut HostCommands,
        instances: &[Instance<'_>],
        camera: &Camera,
        view: &ViewOptions,
        target: impl Into<HostTarget<'a>>,
    ) -> Result<Option<Stats>> {
        let content = FrameContent::Instances(instances, camera);
        self.record_to(commands, content, camera, view, target.into())
    }

    fn record_to(
        &mut self,
        commands: &mut HostCommands,
        content: FrameContent<'_>,
        camera: &Camera,
        view: &ViewOptions,
        target: HostTarget<'_>,
    ) -> Result<Option<Stats>> {
        let frame = self.host_frames.frame_in(commands);
        let in_flight = self.host_frames.in_flight() as u64;
        let admitted = self.admit(content, camera, &target);
        let finished = admitted.and_then(|()| self.finished_before((frame + 1).saturating_sub(in_flight)));
        let begun = finished.and_then(|finished| Ok((finished, self.host_frames.begin_in(commands)?)));
        let (finished, mut rec) = match begun {
            Ok(begun) => begun,
            Err(error) => {
                target.images().for_each(|image| commands.pass(&self.gpu, image));
                return Err(error);
            }
        };
        let (scratch, degree) = (&self.scratch, self.options.sh_degree);
        let size = [camera.width, camera.height];
        rec.fill(&scratch.counts, 0);
        let mut forward = &self.forward;
        if let (Some(occlusion), Some(depth)) = (&self.occlusion, &target.depth) {
            occlusion.read(&mut rec, depth, (target.corner(), size), scratch);
            rec.timestamp("linearize");
            forward = &occlusion.forward;
        }
        let view = ViewOptions {
            background: target.blend.background(view.background),
            ..*view
        };
        forward.record(&mut rec, content, scratch, &view_of(camera, &view), degree, self.bands);
        target.show(&mut rec, scratch, size, (&self.present, self.overlay.as_ref()));
        rec.timestamp("present");
        let picking = self.picking.as_ref();
        let pick = picking.map_or(Ok(None), |picking| {
            picking.show(&mut rec, scratch, size, &target, content)
        });
        let counts = rec.read_back(&scratch.counts, 0..COUNT_SLOTS as usize);
        rec.timestamp("outputs");
        rec.finish()?;
        self.pending.push_back(PendingPicture {
            frame,
            capacity: scratch.capacity,
            bands: self.bands,
            not_finite: content.not_finite(),
            counts: counts?,
            pick: pick?,
        });
        Ok(finished)
    }

    /// Checks the inputs of a picture.
    fn admit(&self, content: FrameContent<'_>, camera: &Camera, target: &HostTarget<'_>) -> Result<()> {
        target.color.check_writable(&self.gpu)?;
        self.check(content)?;
        let size = [camera.width, camera.height];
        target.check_sizes(size)?;
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
            Occlusion::check(&self.gpu, depth)?;
        }
        picking::check(target, size, (self.picking.is_some(), self.options.with_depth))?;
        if !self.forward.is_prepared(content, self.options.sh_degree) {
            let function = match content {
                FrameContent::Model(_) => "prepare",
                FrameContent::Instances(..) => "prepare_instances",
            };
            return Err(Error::Config(format!(
                "the model's kernels are not compiled: call {function} first, or reserve"
            )));
        }
        let capacity = self.scratch.capacity;
        let wanted = Capacity::for_image(content.splat_count(), 0, camera.width, camera.height);
        match capacity.max(wanted) == capacity {
            true => Ok(()),
            false => Err(Error::Config(format!(
                "{wanted:?} exceeds the renderer's {capacity:?}: call reserve first"
            ))),
        }
    }

    /// Refuses models of another device, kind or precision than the kernels', and faulty instances.
    fn check(&self, content: FrameContent<'_>) -> Result<()> {
        content.check()?;
        let mut buffers = content.models().flat_map(|model| model.params.first());
        if !buffers.all(|params| params.is_on(&self.gpu)) {
            return Err(Error::Config(
                "the model lies on another device than the renderer's".into(),
            ));
        }
        let wanted = self.options.primitive;
        if let Some(other) = content.models().find(|model| model.primitive != wanted) {
            let (found, wanted) = (other.primitive.name(), wanted.name());
            let text = format!("the model's splats are of the kind {found}, but the renderer draws {wanted}");
            return Err(Error::Config(text));
        }
        let wanted = self.options.precision;
        let mut others = content
            .models()
            .map(|model| model.precision)
            .filter(|&found| found != wanted);
        match others.next() {
            None => Ok(()),
            Some(found) => Err(Error::Config(format!(
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
        let mut upload = self.begin_upload(splats)?;
        self.record_part(commands, &mut upload, usize::MAX)?;
        Ok(upload.model().clone())
    }

    /// Begins an upload in parts over several frames, whose time and staging memory are then bounded. Allocates the
    /// model's buffers: to be called outside of frames.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`] and errors of Vulkan.
    pub fn begin_upload<'a>(&self, splats: &'a Splats) -> Result<ModelUpload<'a>> {
        ModelUpload::new(&self.gpu, splats, self.options.precision)
    }

    /// Records up to `bytes` of an upload into a host's command buffer. Returns the model once all of it is recorded;
    /// pictures of it may follow in the same commands.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`] and errors of Vulkan, after which the upload is not complete; the command buffer can be
    /// submitted nevertheless.
    pub fn record_part(
        &mut self,
        commands: &mut HostCommands,
        upload: &mut ModelUpload<'_>,
        bytes: usize,
    ) -> Result<Option<Model>> {
        let mut rec = self.host_frames.begin_in(commands)?;
        let is_whole = upload.record(&mut rec, bytes);
        rec.finish()?;
        Ok(is_whole.then(|| upload.model().clone()))
    }

    /// Takes the reports of picked pixels, oldest first: those of pictures with [`HostTarget::pick`] whose statistics
    /// have been returned since the last call, in the order of recording.
    pub fn picks(&mut self) -> impl Iterator<Item = PickReport> {
        self.picks.drain(..)
    }

    /// Stages of the pictures of the last finished frame of a host with their device time in nanoseconds, read with its
    /// statistics, without a wait; `between` is the time of the host's commands between two of them. Empty without
    /// [`RenderOptions::with_timings`], and on devices without timestamps.
    pub fn host_timings(&self) -> &[(&'static str, f64)] {
        &self.host_timings
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
            self.picks.extend(picture.pick.as_ref().map(PendingPick::report));
            if self.options.with_timings {
                self.host_timings = self.host_frames.timings_in(picture.frame)?;
            }
            worst = Some(worst.map_or(stats, |worst| worst.worse(stats)));
            if self.options.compatibility == Compatibility::Engine {
                self.bands = self.bands_after(picture.bands, counts)?;
            }
        }
        Ok(worst)
    }
}
