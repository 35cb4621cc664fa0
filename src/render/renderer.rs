//! Rendering for users: record into a host's commands, or render and read back.

use super::capacity::Capacity;
use super::compatibility::Compatibility;
use super::depth_bands::{DepthBands, list_limit};
use super::forward::Forward;
use super::memory::isects_expected;
use super::model::Model;
use super::options::RenderOptions;
use super::scratch::Scratch;
use super::view::{ViewOptions, view_of};
use crate::gpu::{Frames, Gpu, HostCommands, HostImage, Readback, Recorder, Ticket};
use crate::kernels::present;
use crate::layout::{COUNT_FAILED, COUNT_ISECT_WANTED, COUNT_SLOTS};
use crate::scene::{Camera, NotFinite, Splats};
use crate::{Error, Result};
use std::collections::VecDeque;

/// Bytes that a (splat, tile) pair takes of any one array.
const ISECT_BYTES: u64 = 4;

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

/// Coverage below which a pixel has no depth: one level of 8 bits.
const COVERAGE_MIN: f32 = 1.0 / 255.0;

impl Rendered {
    /// Coverage of each pixel, 0 to 1.
    pub fn alpha(&self) -> Vec<f32> {
        self.transmittance.iter().map(|t| 1.0 - t).collect()
    }

    /// Mean depth of each pixel along the view's z axis in world units; infinite where coverage is below 1/255. Empty
    /// unless depth was asked for.
    pub fn mean_depth(&self) -> Vec<f32> {
        let mean = |(sum, transmittance): (&f32, &f32)| match 1.0 - transmittance {
            alpha if alpha >= COVERAGE_MIN => sum / alpha,
            _ => f32::INFINITY,
        };
        self.depth
            .iter()
            .zip(&self.transmittance)
            .map(mean)
            .collect()
    }
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
    /// Of the pictures that a host will record next, as those that are done have shown.
    bands: DepthBands,
    /// What the host's frames in flight have to report, by frame, oldest first.
    pending: VecDeque<Pending>,
}

/// A picture on its way.
struct Pending {
    /// Of which frame.
    frame: u64,
    /// What it has room for.
    capacity: Capacity,
    bands: DepthBands,
    /// What it leaves out.
    not_finite: Option<NotFinite>,
    /// What it will have counted.
    counts: Readback<u32>,
}

/// How close a frame came to its limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stats {
    /// (Splat, tile) pairs that the frame wanted.
    pub isects: usize,
    /// Those it had room for at a time. If it wanted more, it was drawn in bands, one after the other, which takes
    /// longer: [`Renderer::reserve`] helps.
    pub isect_capacity: usize,
    /// Bands that were recorded. That they do not suffice is known when a picture is done: those recorded from then
    /// on have more.
    pub bands: u32,
    /// Whether the picture shows all that it should. If not, the splats behind some depth are missing, or all.
    pub complete: bool,
    /// Splats that were left out because a number of theirs is not finite.
    pub not_finite: Option<NotFinite>,
}

impl Stats {
    /// Whether there was room for all of the frame at once.
    pub fn fits(&self) -> bool {
        self.isects <= self.isect_capacity
    }

    /// The worse of both in every respect.
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
    /// Compiles the kernels, but for those that somebody else on this device holds, and allocates for
    /// `options.capacity`.
    pub fn new(gpu: &Gpu, options: RenderOptions) -> Result<Renderer> {
        let presents = gpu.caps().supports(present::Variant::Base.info()).is_ok();
        let present = || present::Present::new(gpu, present::Choice::default());
        let capacity = options.capacity.within(gpu.caps(), ISECT_BYTES);
        Ok(Renderer {
            gpu: gpu.clone(),
            forward: Forward::for_rendering(gpu, &options)?,
            present: presents.then(present).transpose()?,
            scratch: Scratch::new(gpu, capacity, options.outputs())?,
            frames: Frames::new(gpu, 1, true)?,
            rendered: None,
            host_frames: Frames::new(gpu, options.frames_in_flight, false)?,
            options,
            bands: DepthBands::default(),
            pending: VecDeque::new(),
        })
    }

    /// Makes room for a frame of `model` through `camera` with up to `isects` (splat, tile) pairs, or as many as one
    /// binding of the device reaches; frames with more are drawn in bands.
    pub fn reserve(&mut self, model: &Model, camera: &Camera, isects: usize) -> Result<()> {
        let wanted = Capacity::for_image(model.splat_count, isects, camera.width, camera.height);
        let capacity = self.scratch.capacity.max(wanted);
        let capacity = capacity.within(self.gpu.caps(), ISECT_BYTES);
        if capacity != self.scratch.capacity {
            // The old buffers go first, as far as no host's frame uses them: there may not be room for both.
            self.frames.release()?;
            for capacity in [Capacity::LEAST, capacity] {
                self.scratch = Scratch::new(&self.gpu, capacity, self.options.outputs())?;
            }
        }
        Ok(())
    }

    /// As [`Renderer::reserve`], but for fewer intersections where memory does not suffice.
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

    /// Records a picture into a host's command buffer and writes it to the host's image. Nothing is
    /// submitted or waited for. Once `frames_in_flight` further frames have been begun, returns how the
    /// pictures of the oldest fared. One that does not fit is incomplete; those recorded after that is known are
    /// drawn in more bands, until the host calls [`Renderer::reserve`] with the number of pairs that were wanted.
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
        if self.present.is_none() {
            return Err(Error::Unsupported {
                what: "presenting: the feature shaderStorageImageWriteWithoutFormat is not enabled"
                    .into(),
            });
        }
        self.check(model)?;
        self.forward.prepare(&self.gpu, model)?;
        let capacity = self.scratch.capacity;
        let wanted = Capacity::for_image(model.splat_count, 0, camera.width, camera.height);
        if capacity.max(wanted) != capacity {
            return Err(Error::Config(format!(
                "{wanted:?} exceeds the renderer's {capacity:?}: call reserve first"
            )));
        }
        let size = [camera.width, camera.height];
        assert_eq!(target.image().extent(), size, "camera and target differ");
        let frame = self.host_frames.frame_in(commands);
        let in_flight = self.host_frames.in_flight() as u64;
        let finished = self.finished_before((frame + 1).saturating_sub(in_flight))?;
        let mut rec = self.host_frames.begin_in(commands)?;
        let picture = Picture {
            model,
            camera,
            view,
        };
        let (forward, scratch) = (&self.forward, &self.scratch);
        record_frame(
            &mut rec,
            forward,
            scratch,
            picture,
            self.options.sh_degree,
            self.bands,
        );
        rec.acquire(target);
        let io = present::Bindings {
            view: &self.scratch.view,
            image: &self.scratch.image,
            target: target.image(),
        };
        if let Some(present) = &self.present {
            present.record(&mut rec, io, present::groups(size));
        }
        rec.release(target);
        let counts = rec.read_back(&self.scratch.counts, 0..COUNT_SLOTS as usize)?;
        self.pending.push_back(Pending {
            frame,
            capacity,
            bands: self.bands,
            not_finite: model.not_finite,
            counts,
        });
        rec.finish()?;
        Ok(finished)
    }

    /// Refuses models that its kernels would misread.
    fn check(&self, model: &Model) -> Result<()> {
        let (wanted, found) = (self.options.precision, model.precision);
        match wanted == found {
            true => Ok(()),
            false => Err(Error::Config(format!(
                "the model lies on the device as {found:?}, but the renderer draws {wanted:?}"
            ))),
        }
    }

    /// Copies a scene to the device by commands in a host's command buffer, for hosts that give us no
    /// queue; else [`Model::upload`] does. Pictures of it may be recorded behind, into the same commands.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn record_upload(&mut self, commands: &mut HostCommands, splats: &Splats) -> Result<Model> {
        let mut rec = self.host_frames.begin_in(commands)?;
        let model = Model::record_upload(&mut rec, splats, self.options.precision)?;
        rec.finish()?;
        Ok(model)
    }

    /// The stages of the image rendered last and the nanoseconds that each took on the device; nothing
    /// where it has no timestamps.
    pub fn timings(&self) -> Result<Vec<(&'static str, f64)>> {
        self.rendered
            .map_or(Ok(Vec::new()), |last| self.frames.timings(last))
    }

    /// The bands that a picture needs which has left `counts`.
    fn bands_after(&self, bands: DepthBands, counts: &[u32]) -> Result<DepthBands> {
        let limit = list_limit(self.gpu.caps().kind);
        let bands = bands.after(counts, &self.scratch.capacity, limit)?;
        if bands.count > 1 && self.options.compatibility == Compatibility::Inria {
            return Err(Error::Unsupported {
                what: "a picture by the rules of the 3DGS code that takes more than one pass"
                    .into(),
            });
        }
        Ok(bands)
    }

    /// What the pictures of the frames before `first` have to report, which the host has waited for; those to come
    /// have the bands that the last of them needed.
    fn finished_before(&mut self, first: u64) -> Result<Option<Stats>> {
        let mut worst: Option<Stats> = None;
        while self.pending.front().is_some_and(|p| p.frame < first) {
            let Some(picture) = self.pending.pop_front() else {
                break;
            };
            let counts = picture.counts.get();
            let stats = Stats {
                isects: counts[COUNT_ISECT_WANTED as usize] as usize,
                isect_capacity: picture.capacity.isects,
                bands: picture.bands.count,
                complete: counts[COUNT_FAILED as usize] == 0,
                not_finite: picture.not_finite,
            };
            worst = Some(worst.map_or(stats, |worst| worst.worse(stats)));
            if self.options.compatibility == Compatibility::Engine {
                self.bands = self.bands_after(picture.bands, &counts)?;
            }
        }
        Ok(worst)
    }

    /// Renders one image and reads it back, growing buffers as needed; in bands where they cannot grow.
    pub fn render(
        &mut self,
        model: &Model,
        camera: &Camera,
        view: &ViewOptions,
    ) -> Result<Rendered> {
        self.check(model)?;
        self.forward.prepare(&self.gpu, model)?;
        let expected = isects_expected(model.splat_count, camera.width, camera.height);
        self.reserve_some(model, camera, expected)?;
        let picture = Picture {
            model,
            camera,
            view,
        };
        let mut bands = DepthBands::default();
        loop {
            let pixels = camera.width as usize * camera.height as usize;
            let (forward, scratch) = (&self.forward, &self.scratch);
            let (degree, with_depth) = (self.options.sh_degree, self.options.with_depth);
            let (ticket, (counts, image, depth)) = self.frames.submit(|rec| {
                record_frame(rec, forward, scratch, picture, degree, bands);
                Ok((
                    rec.read_back(&scratch.counts, 0..COUNT_SLOTS as usize)?,
                    rec.read_back(&scratch.image, 0..4 * pixels)?,
                    rec.read_back(&scratch.depth, 0..if with_depth { pixels } else { 0 })?,
                ))
            })?;
            self.frames.wait(ticket)?;
            self.rendered = Some(ticket);
            let counts = counts.get();
            if counts[COUNT_FAILED as usize] == 0 {
                return Ok(unpack(camera, &image.get(), depth.get()));
            }
            let wanted = counts[COUNT_ISECT_WANTED as usize] as usize;
            self.reserve_some(model, camera, wanted.saturating_add(wanted / 8))?;
            bands = self.bands_after(bands, &counts)?;
        }
    }
}

/// What is drawn, and how it is looked at.
#[derive(Clone, Copy)]
struct Picture<'a> {
    model: &'a Model,
    camera: &'a Camera,
    view: &'a ViewOptions,
}

fn record_frame(
    rec: &mut Recorder<'_>,
    forward: &Forward,
    scratch: &Scratch,
    picture: Picture<'_>,
    sh_degree: u32,
    bands: DepthBands,
) {
    rec.fill(&scratch.counts, 0);
    let view = view_of(picture.camera, picture.view);
    let sh_degree = sh_degree.min(picture.model.sh_degree);
    forward.record(rec, picture.model, scratch, &view, sh_degree, bands);
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
