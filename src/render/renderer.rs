//! Rendering for users: record into a host's commands, or render and read back.

use super::accuracy::Accuracy;
use super::compatibility::Compatibility;
use super::forward::{Forward, check_lists};
use super::memory::isects_expected;
use super::model::Model;
use super::scratch::{Capacity, Scratch};
use super::view::{ViewOptions, view_of};
use crate::gpu::{Frames, Gpu, HostCommands, HostImage, Readback, Recorder, Ticket};
use crate::kernels::present;
use crate::layout::{COUNT_FAILED, COUNT_ISECT_WANTED, COUNT_SLOTS};
use crate::scene::{Camera, NotFinite, Splats};
use crate::{Error, Result};
use std::collections::VecDeque;

/// How a renderer is set up.
#[derive(Clone, Copy, Debug)]
pub struct RenderOptions {
    /// Frames that may be in flight at once.
    pub frames_in_flight: usize,
    /// What it has room for from the start.
    pub capacity: Capacity,
    /// Highest spherical-harmonic degree drawn; scenes of a higher one are drawn up to it.
    pub sh_degree: u32,
    /// Whether images come with expected depth.
    pub with_depth: bool,
    /// Where frames may save work at a bounded error.
    pub accuracy: Accuracy,
    /// Whose rules frames are drawn by.
    pub compatibility: Compatibility,
}

impl Default for RenderOptions {
    fn default() -> RenderOptions {
        RenderOptions {
            frames_in_flight: 2,
            capacity: Capacity {
                isects: 1 << 18,
                ..Capacity::LEAST
            },
            sh_degree: 3,
            with_depth: false,
            accuracy: Accuracy::default(),
            compatibility: Compatibility::Engine,
        }
    }
}

/// An image read back from the device.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Row by row from the top; display-referred, background blended in, not clamped at 1.
    pub rgb: Vec<[f32; 3]>,
    /// What passes through all splats, 0 to 1.
    pub transmittance: Vec<f32>,
    /// Σ weight · z in world units; divide by 1 − transmittance for the mean. Empty unless asked for.
    pub depth: Vec<f32>,
}

/// Renders scenes on one device.
pub struct Renderer {
    gpu: Gpu,
    forward: Forward,
    present: Option<present::Present>,
    scratch: Scratch,
    /// Of [`Renderer::render`].
    frames: Frames,
    /// The last of them.
    rendered: Option<Ticket>,
    /// Of [`Renderer::record`]: when one is done is for the host to know.
    host_frames: Frames,
    options: RenderOptions,
    /// What the host's frames in flight have to report, by frame, oldest first.
    pending: VecDeque<Pending>,
}

/// A picture on its way: its frame, what it has room for, what it leaves out, and what it will have counted.
struct Pending {
    frame: u64,
    isect_capacity: usize,
    not_finite: Option<NotFinite>,
    counts: Readback<u32>,
}

/// How close a frame came to its limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stats {
    /// (Splat, tile) pairs that the frame wanted.
    pub isects: usize,
    /// Those it had room for. If it wanted more, it shows the background only.
    pub isect_capacity: usize,
    /// Whether more splats lie over one tile than a software device can follow: the picture is wrong then,
    /// and room does not help.
    pub list_too_long: bool,
    /// Splats that were left out because a number of theirs is not finite.
    pub not_finite: Option<NotFinite>,
}

impl Stats {
    /// Whether there was room for the frame.
    pub fn fits(&self) -> bool {
        self.isects <= self.isect_capacity
    }
}

impl std::fmt::Debug for Renderer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Renderer({:?}, {:?})", self.gpu, self.scratch.capacity)
    }
}

impl Renderer {
    /// Compiles the kernels and allocates for `options.capacity`.
    pub fn new(gpu: &Gpu, options: RenderOptions) -> Result<Renderer> {
        let presents = gpu.caps().supports(present::Variant::Base.info()).is_ok();
        let present = || present::Present::new(gpu, present::Present::prefer(gpu.caps()));
        Ok(Renderer {
            gpu: gpu.clone(),
            forward: Forward::by_rules_of(
                gpu,
                options.sh_degree,
                options.with_depth,
                &options.accuracy,
                options.compatibility,
            )?,
            present: presents.then(present).transpose()?,
            scratch: Scratch::new(gpu, options.capacity)?,
            frames: Frames::new(gpu, 1, true)?,
            rendered: None,
            host_frames: Frames::new(gpu, options.frames_in_flight, false)?,
            options,
            pending: VecDeque::new(),
        })
    }

    /// Makes room for a frame of `model` through `camera` with up to `isects` (splat, tile) pairs.
    pub fn reserve(&mut self, model: &Model, camera: &Camera, isects: usize) -> Result<()> {
        let wanted = Capacity::for_image(model.splat_count, isects, camera.width, camera.height);
        let capacity = self.scratch.capacity.max(wanted);
        if capacity != self.scratch.capacity {
            // The old buffers go first, as far as no host's frame uses them: there may not be room for both.
            self.frames.release()?;
            self.scratch = Scratch::new(&self.gpu, Capacity::LEAST)?;
            self.scratch = Scratch::new(&self.gpu, capacity)?;
        }
        Ok(())
    }

    /// Records a picture into a host's command buffer and writes it to the host's image. Nothing is
    /// submitted or waited for. Once `frames_in_flight` further frames have been begun, returns how the
    /// pictures of the oldest fared: one that does not fit shows only the background, and the host calls
    /// [`Renderer::reserve`] with the number it wanted before it records the next.
    ///
    /// # Errors
    /// [`Error::Config`] where the model or the image exceed the reserved capacity,
    /// [`Error::Unsupported`] where the host has not enabled what presenting needs.
    pub fn record(
        &mut self,
        commands: &mut HostCommands,
        model: &Model,
        camera: &Camera,
        view: &ViewOptions,
        target: &HostImage,
    ) -> Result<Option<Stats>> {
        let present = self.present.as_ref().ok_or_else(|| Error::Unsupported {
            what: "presenting: the feature shaderStorageImageWriteWithoutFormat is not enabled"
                .into(),
        })?;
        let capacity = self.scratch.capacity;
        let wanted = Capacity::for_image(model.splat_count, 0, camera.width, camera.height);
        if capacity.max(wanted) != capacity {
            return Err(Error::Config(format!(
                "{wanted:?} exceeds the renderer's {capacity:?}: call reserve first"
            )));
        }
        let size = [camera.width, camera.height];
        assert_eq!(
            target.image().extent(),
            size,
            "camera and target differ in size"
        );
        let frame = self.host_frames.frame_in(commands);
        let in_flight = self.host_frames.in_flight() as u64;
        let finished = finished_before(&mut self.pending, (frame + 1).saturating_sub(in_flight));
        let mut rec = self.host_frames.begin_in(commands)?;
        record_frame(
            &mut rec,
            &self.forward,
            model,
            &self.scratch,
            camera,
            view,
            self.options.sh_degree,
        );
        rec.acquire(target);
        let io = present::Bindings {
            view: &self.scratch.view,
            image: &self.scratch.image,
            target: target.image(),
        };
        present.record(&mut rec, io, size);
        rec.release(target);
        let counts = rec.read_back(&self.scratch.counts, 0..COUNT_SLOTS as usize)?;
        self.pending.push_back(Pending {
            frame,
            isect_capacity: capacity.isects,
            not_finite: model.not_finite,
            counts,
        });
        rec.finish()?;
        Ok(finished)
    }

    /// Copies a scene to the device by commands in a host's command buffer, for hosts that give us no
    /// queue; else [`Model::upload`] does. Pictures of it may be recorded behind, into the same commands.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn record_upload(&mut self, commands: &mut HostCommands, splats: &Splats) -> Result<Model> {
        let mut rec = self.host_frames.begin_in(commands)?;
        let model = Model::record_upload(&mut rec, splats)?;
        rec.finish()?;
        Ok(model)
    }

    /// The stages of the image rendered last and the nanoseconds that each took on the device; nothing
    /// where it has no timestamps.
    pub fn timings(&self) -> Result<Vec<(&'static str, f64)>> {
        self.rendered
            .map_or(Ok(Vec::new()), |last| self.frames.timings(last))
    }

    /// Renders one image and reads it back, growing buffers as needed.
    pub fn render(
        &mut self,
        model: &Model,
        camera: &Camera,
        view: &ViewOptions,
    ) -> Result<Rendered> {
        let expected = isects_expected(model.splat_count, camera.width, camera.height);
        self.reserve(model, camera, expected)?;
        loop {
            let pixels = camera.width as usize * camera.height as usize;
            let (forward, scratch) = (&self.forward, &self.scratch);
            let (degree, with_depth) = (self.options.sh_degree, self.options.with_depth);
            let (ticket, (counts, image, depth)) = self.frames.submit(|rec| {
                record_frame(rec, forward, model, scratch, camera, view, degree);
                Ok((
                    rec.read_back(&scratch.counts, 0..COUNT_SLOTS as usize)?,
                    rec.read_back(&scratch.image, 0..4 * pixels)?,
                    rec.read_back(&scratch.depth, 0..if with_depth { pixels } else { 0 })?,
                ))
            })?;
            self.frames.wait(ticket)?;
            self.rendered = Some(ticket);
            let counts = counts.get();
            check_lists(&counts)?;
            if counts[COUNT_FAILED as usize] == 0 {
                return Ok(unpack(camera, &image.get(), depth.get()));
            }
            let wanted = counts[COUNT_ISECT_WANTED as usize] as usize;
            self.reserve(model, camera, wanted + wanted / 8)?;
        }
    }
}

/// The neediest picture of the frames before `first`, which the host has waited for.
fn finished_before(pending: &mut VecDeque<Pending>, first: u64) -> Option<Stats> {
    let count = pending.iter().take_while(|p| p.frame < first).count();
    let finished = pending.drain(..count).map(|picture| {
        let counts = picture.counts.get();
        Stats {
            isects: counts[COUNT_ISECT_WANTED as usize] as usize,
            isect_capacity: picture.isect_capacity,
            list_too_long: check_lists(&counts).is_err(),
            not_finite: picture.not_finite,
        }
    });
    finished.reduce(|a, b| Stats {
        isects: a.isects.max(b.isects),
        isect_capacity: a.isect_capacity.min(b.isect_capacity),
        list_too_long: a.list_too_long || b.list_too_long,
        not_finite: a.not_finite.or(b.not_finite),
    })
}

fn record_frame(
    rec: &mut Recorder<'_>,
    forward: &Forward,
    model: &Model,
    scratch: &Scratch,
    camera: &Camera,
    view: &ViewOptions,
    sh_degree: u32,
) {
    rec.fill(&scratch.counts, 0);
    let view = view_of(camera, view);
    forward.record(rec, model, scratch, &view, sh_degree.min(model.sh_degree));
}

fn unpack(camera: &Camera, image: &[f32], depth: Vec<f32>) -> Rendered {
    let pixels = camera.width as usize * camera.height as usize;
    let rgb = (0..pixels)
        .map(|i| [image[i], image[pixels + i], image[2 * pixels + i]])
        .collect();
    let transmittance = image[3 * pixels..].to_vec();
    Rendered {
        width: camera.width,
        height: camera.height,
        rgb,
        transmittance,
        depth,
    }
}
