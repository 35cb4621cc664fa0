//! Splats and depths of a picture's pixels, for picking and for a host's images.
//!
//! The splat of a pixel is the one at which the coverage reaches 1/2, front to back: that of the median depth. Against
//! the splat of the largest weight, it belongs to the depth that is reported with it, is that of the surface behind
//! thin floaters, and takes no state between bands. Where the coverage stays below 1/2 there is neither.

use super::instances::{FrameContent, Instance};
use super::occlusion::{DepthCode, HostDepth};
use super::scratch::Scratch;
use super::target::{DepthKind, HostTarget, PICK_PIXELS_MAX, PickArea};
use crate::gpu::{Gpu, ImageWords, Readback, Recorder};
use crate::kernels::delinearize::{Bindings, Choice, Delinearize, Params};
use crate::{Error, Result};

/// Report on the pixels of an area.
#[derive(Clone, Debug, PartialEq)]
pub struct PickReport {
    /// The area.
    pub area: PickArea,
    /// Pixels of the area, row by row.
    pub pixels: Vec<PickPixel>,
}

/// Report on a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PickPixel {
    /// Instance and splat at which the coverage reaches 1/2; a lone model is instance 0. `None` if it does not.
    pub splat: Option<(usize, usize)>,
    /// Depth of that splat's mean along the view's z axis in world units; infinite without one.
    pub depth: f32,
    /// Transmittance of all splats, 0 to 1.
    pub transmittance: f32,
}

/// Instance and splat of an index in [`RenderedImage::ids`](super::RenderedImage::ids), or in a host's image of a
/// picture of these instances; of a lone model, the index is that of the splat.
pub fn locate(instances: &[Instance<'_>], id: u32) -> Option<(usize, usize)> {
    locate_in(&firsts(instances.iter().map(|instance| instance.model.splat_count)), id)
}

/// First index of each of several models of so many splats, and the end of the last.
fn firsts(counts: impl Iterator<Item = usize>) -> Vec<[usize; 2]> {
    let mut end = 0_usize;
    let place = |count: usize| {
        let first = end.next_multiple_of(crate::gpu::PART_ALIGNMENT);
        end = first + count;
        [first, end]
    };
    counts.map(place).collect()
}

fn locate_in(places: &[[usize; 2]], id: u32) -> Option<(usize, usize)> {
    let id = id as usize;
    let index = places.partition_point(|[first, _]| *first <= id).checked_sub(1)?;
    let [first, end] = places[index];
    (id < end).then_some((index, id - first))
}

/// Readback of an area.
pub(super) struct PendingPick {
    area: PickArea,
    places: Vec<[usize; 2]>,
    ids: Readback<u32>,
    depths: Readback<f32>,
    transmittances: Readback<f32>,
}

impl PendingPick {
    /// The report; the frame has run.
    pub(super) fn report(&self) -> PickReport {
        let numbers = self.ids.elements().iter().zip(self.depths.elements());
        let numbers = numbers.zip(self.transmittances.elements());
        let pixel = |((&id, &depth), &transmittance): ((&u32, &f32), &f32)| PickPixel {
            splat: locate_in(&self.places, id),
            depth,
            transmittance,
        };
        PickReport {
            area: self.area,
            pixels: numbers.map(pixel).collect(),
        }
    }
}

/// Kernel of the depths of splats.
#[derive(Debug)]
pub(super) struct Picking(Delinearize);

impl Picking {
    pub(super) fn new(gpu: &Gpu) -> Result<Picking> {
        Ok(Picking(Delinearize::new(gpu, Choice::default())?))
    }

    /// Finds the depths of the pixels' splats, and stores them in a code, of a host's surfaces and the splats the
    /// nearer one if `is_limited`.
    pub(super) fn find(
        &self,
        rec: &mut Recorder<'_>,
        s: &Scratch,
        pixels: usize,
        (code, kind): (DepthCode, DepthKind),
        is_limited: bool,
    ) {
        let io = Bindings {
            id_from_pixel: &s.isect_end_from_pixel,
            blue_depth_from_splat: &s.blue_depth_from_splat,
            limit_from_pixel: &s.limit_from_pixel,
            depth_from_pixel: &s.depth_from_pixel,
            stored_from_pixel: &s.stored_from_pixel,
            sum_from_pixel: &s.depth,
            image: &s.image,
        };
        let params = Params {
            a: code.a,
            b: code.b,
            linear: code.is_linear.into(),
            empty: code.empty,
            limited: is_limited.into(),
            mean: (kind == DepthKind::Expected).into(),
            pixels: pixels as u32,
        };
        self.0.record(rec, io, params, self.0.groups(pixels));
    }

    /// Records the outputs of a composited picture of `size` pixels that a host asks for.
    pub(super) fn show(
        &self,
        rec: &mut Recorder<'_>,
        s: &Scratch,
        size: [u32; 2],
        target: &HostTarget<'_>,
        content: FrameContent<'_>,
    ) -> Result<Option<PendingPick>> {
        let [width, height] = size.map(|side| side as usize);
        if target.depth_out.is_some() || target.pick.is_some() {
            let code = target.depth_out.map_or(DepthCode::DISTANCE, |out| out.code);
            let stored = (code, target.depth_kind);
            self.find(rec, s, width * height, stored, target.depth.is_some());
        }
        if let Some(out) = &target.depth_out {
            rec.copy_to_host(&s.stored_from_pixel, out.image, target.corner(), size);
        }
        if let Some(ids) = target.ids {
            rec.copy_to_host(&s.isect_end_from_pixel, ids, target.corner(), size);
        }
        let Some(area) = target.pick else {
            return Ok(None);
        };
        let from = area.y as usize * width + area.x as usize;
        let rows = (area.width as usize, width, area.height as usize);
        Ok(Some(PendingPick {
            area,
            places: firsts(content.models().map(|model| model.splat_count)),
            ids: rec.read_back_rows(&s.isect_end_from_pixel, from, rows)?,
            depths: rec.read_back_rows(&s.depth_from_pixel, from, rows)?,
            transmittances: rec.read_back_rows(&s.image, 3 * width * height + from, rows)?,
        }))
    }
}

/// Checks the outputs that a host asks for, of a picture of `size` pixels by a renderer with or without the splats of
/// pixels, and depths.
///
/// # Errors
/// [`Error::Config`] for a renderer without, images of another format, a code that is no number, and an area beyond the
/// picture.
pub(super) fn check(target: &HostTarget<'_>, size: [u32; 2], (has_ids, has_depth): (bool, bool)) -> Result<()> {
    let refuse = |what: String| Err(Error::Config(what));
    let is_asked = target.ids.is_some() || target.depth_out.is_some() || target.pick.is_some();
    if is_asked && !has_ids {
        return refuse("splats of pixels: the renderer was made without RenderOptions::with_ids".into());
    }
    if target.depth_out.is_some() && target.depth_kind == DepthKind::Expected && !has_depth {
        return refuse("expected depths: the renderer was made without RenderOptions::with_depth".into());
    }
    if let Some(image) = target.ids {
        image.check_words(ImageWords::Ids)?;
    }
    if let Some(HostDepth { image, code }) = &target.depth_out {
        image.check_words(ImageWords::Depths)?;
        let numbers = [code.a, code.b, code.empty];
        if numbers[..2].iter().any(|number| !number.is_finite()) || code.empty.is_nan() {
            return refuse(format!("{code:?}: a, b and empty are numbers"));
        }
    }
    let Some(area) = target.pick else {
        return Ok(());
    };
    let PickArea { x, y, width, height } = area;
    let reaches =
        |from: u32, count: u32, side: u32| count > 0 && from.checked_add(count).is_some_and(|end| end <= side);
    let is_inside = reaches(x, width, size[0]) && reaches(y, height, size[1]);
    match is_inside && width.checked_mul(height).is_some_and(|count| count <= PICK_PIXELS_MAX) {
        true => Ok(()),
        false => {
            let [w, h] = size;
            refuse(format!(
                "{area:?}: 1 to {PICK_PIXELS_MAX} pixels within the {w}x{h} of the picture are possible"
            ))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::PART_ALIGNMENT;
    use crate::layout::NO_SPLAT;

    #[test]
    fn indices_are_located_in_their_models() {
        let places = firsts([10, 0, PART_ALIGNMENT + 1, 1].into_iter());
        assert_eq!(places[0], [0, 10]);
        assert_eq!(places[2], [PART_ALIGNMENT, 2 * PART_ALIGNMENT + 1]);
        let last = 3 * PART_ALIGNMENT;
        assert_eq!(places[3], [last, last + 1]);
        for (model, [first, end]) in places.iter().enumerate() {
            for id in *first..*end {
                assert_eq!(locate_in(&places, id as u32), Some((model, id - first)));
            }
        }
        for none in [10, PART_ALIGNMENT - 1, last - 1, last + 1, NO_SPLAT as usize] {
            assert_eq!(locate_in(&places, none as u32), None, "{none}");
        }
        assert_eq!(locate_in(&[], 0), None);
    }
}
