//! Requests to the guest's renderer.

use crate::rig::Rig;
use crate::scene::Scene;
use ashfall::render::{ClipBox, Instance, PickArea, SplatOrder, isects_expected};
use ashfall::{Model, Primitive, RenderOptions, Renderer};
use glam::DVec2;

/// Grey levels.
pub(crate) const BACKGROUNDS: [f32; 3] = [0.0, 0.5, 1.0];

/// Options for a scene. Surfels have no order by distance, and that order has no splats of pixels.
pub(crate) fn options(scene: &Scene, wanted: RenderOptions) -> RenderOptions {
    let primitive = scene.splats.primitive;
    let order = match primitive {
        Primitive::Surfel => SplatOrder::Depth,
        _ => wanted.order,
    };
    RenderOptions {
        primitive,
        order,
        with_ids: order == SplatOrder::Depth,
        ..wanted
    }
}

/// Room for pictures of a window's size and so many pairs, or the expected number.
pub(crate) fn make_room(
    renderer: &mut Renderer,
    (model, clip): (&Model, Option<ClipBox>),
    rig: &Rig,
    [width, height]: [u32; 2],
    isects: Option<usize>,
) -> ashfall::Result<()> {
    if width == 0 || height == 0 {
        return Ok(());
    }
    let camera = rig.fitted([width, height]);
    let isects = isects.unwrap_or(isects_expected(model.splat_count, width, height));
    match clip {
        None => renderer.reserve(model, &camera, isects),
        Some(_) => renderer.reserve_instances(&[clipped(model, clip)], &camera, isects),
    }
}

pub(crate) fn clipped(model: &Model, clip: Option<ClipBox>) -> Instance<'_> {
    Instance {
        clip,
        ..Instance::new(model)
    }
}

/// The pixel at a place in a window of this size, or the next one.
pub(crate) fn pixel(place: DVec2, [width, height]: [u32; 2]) -> PickArea {
    let place = place.max(DVec2::ZERO).as_uvec2();
    PickArea {
        x: place.x.min(width - 1),
        y: place.y.min(height - 1),
        width: 1,
        height: 1,
    }
}
