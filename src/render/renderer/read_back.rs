//! Pictures rendered and read back.

use super::Renderer;
use crate::Result;
use crate::gpu::{Frames, Gpu};
use crate::layout::{COUNT_FAILED, COUNT_ISECT_WANTED, COUNT_SLOTS, SURFACE_PLANES, View};
use crate::render::capacity::Capacity;
use crate::render::depth_bands::DepthBands;
use crate::render::instances::{FrameContent, Instance};
use crate::render::memory::{isects_expected, total};
use crate::render::model::Model;
use crate::render::occlusion::DepthCode;
use crate::render::rendered::{RenderedImage, unpack};
use crate::render::row_bands::{RowBand, RowBands, binding_limit};
use crate::render::scratch::Scratch;
use crate::render::target::DepthKind;
use crate::render::view::{ViewOptions, view_of};
use crate::scene::Camera;

impl Renderer {
    /// Renders one image and reads it back. Grows the buffers as needed; draws in bands if they cannot grow, and
    /// pictures larger than a binding of the device, or than its memory limit leaves room for, in bands of rows.
    pub fn render(&mut self, model: &Model, camera: &Camera, view: &ViewOptions) -> Result<RenderedImage> {
        self.render_content(model.into(), camera, view)
    }

    /// As [`Renderer::render`], for instances, as [`Renderer::record_instances`] draws them.
    pub fn render_instances(
        &mut self,
        instances: &[Instance<'_>],
        camera: &Camera,
        view: &ViewOptions,
    ) -> Result<RenderedImage> {
        self.render_content(FrameContent::Instances(instances, camera), camera, view)
    }

    fn render_content(
        &mut self,
        content: FrameContent<'_>,
        camera: &Camera,
        view: &ViewOptions,
    ) -> Result<RenderedImage> {
        self.check(content)?;
        let (size, view) = ([camera.width, camera.height], view_of(camera, view));
        let mut bands = self.row_bands(size, content.splat_count()).each();
        let Some(first) = bands.next() else {
            unreachable!("a picture has a band");
        };
        let mut image = self.render_rows(content, camera, &view, first)?;
        for band in bands {
            image.append(self.render_rows(content, camera, &view, band)?);
        }
        Ok(image)
    }

    /// Bands of rows of a picture: the fewest that bindings and the memory limit allow.
    fn row_bands(&self, size: [u32; 2], splats: usize) -> RowBands {
        let outputs = self.options.outputs();
        let bands = RowBands::for_drawing(size, outputs, binding_limit(self.gpu.caps()));
        let held = total(&Scratch::needs(self.scratch.capacity, outputs));
        let taken = self.gpu.memory_in_use().saturating_sub(held);
        let available = self.gpu.memory_limit().saturating_sub(taken);
        let [surface, depth, ids] = [outputs.surface, outputs.depth, outputs.ids].map(u32::from);
        let read = 4 * u64::from(4 + SURFACE_PLANES * surface + depth + 2 * ids);
        bands.while_drawing(|bands| {
            let [width, height] = bands.drawn();
            let wanted = Capacity::for_image(splats, bands.pairs_expected(splats), width, height);
            let capacity = self.scratch.capacity.max(wanted);
            let is_held = wanted.pixels <= self.scratch.capacity.pixels;
            is_held || total(&Scratch::needs(capacity, outputs)) + read * wanted.pixels as u64 <= available
        })
    }

    /// Renders a band of rows of a picture.
    fn render_rows(
        &mut self,
        content: FrameContent<'_>,
        whole: &Camera,
        view: &View,
        rows: RowBand,
    ) -> Result<RenderedImage> {
        let all = isects_expected(content.splat_count(), whole.width, whole.height) as u64;
        let expected = all * u64::from(rows.rows) / u64::from(whole.height.max(1));
        let camera = &Camera {
            height: rows.rows,
            ..*whole
        };
        self.reserve_some(content, camera, expected as usize)?;
        let view = rows.view(view);
        let mut bands = DepthBands::default();
        loop {
            let pixels = camera.width as usize * camera.height as usize;
            let (forward, scratch) = (&self.forward, &self.scratch);
            let (degree, outputs) = (self.options.sh_degree, self.options.outputs());
            let of = |wanted: bool, planes: u32| 0..if wanted { planes as usize * pixels } else { 0 };
            let frames = own_frames(&mut self.frames, &self.gpu)?;
            let (ticket, (counts, image, depth, surface, ids)) = frames.submit(|rec| {
                rec.fill(&scratch.counts, 0);
                forward.record(rec, content, scratch, &view, degree, bands);
                if let Some(picking) = &self.picking {
                    picking.find(rec, scratch, pixels, (DepthCode::DISTANCE, DepthKind::Median), false);
                }
                Ok((
                    rec.read_back(&scratch.counts, 0..COUNT_SLOTS as usize)?,
                    rec.read_back(&scratch.image, 0..4 * pixels)?,
                    rec.read_back(&scratch.depth, of(outputs.depth, 1))?,
                    rec.read_back(&scratch.surface, of(outputs.surface, SURFACE_PLANES))?,
                    (
                        rec.read_back(&scratch.isect_end_from_pixel, of(outputs.ids, 1))?,
                        rec.read_back(&scratch.depth_from_pixel, of(outputs.ids, 1))?,
                    ),
                ))
            })?;
            frames.wait(ticket)?;
            self.rendered = Some(ticket);
            let counts = counts.get();
            if counts[COUNT_FAILED as usize] == 0 {
                let surface = outputs.surface.then(|| surface.elements());
                return Ok(RenderedImage {
                    ids: ids.0.get(),
                    id_depth: ids.1.get(),
                    ..unpack(camera, image.elements(), depth.get(), surface)
                });
            }
            let wanted = counts[COUNT_ISECT_WANTED as usize] as usize;
            self.reserve_some(content, camera, wanted.saturating_add(wanted / 8))?;
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
