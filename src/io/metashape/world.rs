//! Transforms from the chunk to the world.

use super::super::check::Check;
use super::super::pose;
use super::super::reader::excerpt;
use super::super::xml;
use crate::scene::Similarity;
use glam::{DMat3, DVec3};
use roxmltree::Node;
use std::collections::BTreeMap;

/// Transforms of the chunk and of its components.
pub(super) struct Worlds<'a> {
    chunk: Similarity,
    components: BTreeMap<&'a str, Option<Similarity>>,
}

impl<'a> Worlds<'a> {
    pub(super) fn read(chunk: Node<'a, '_>) -> Check<Worlds<'a>> {
        let mut components = BTreeMap::new();
        let list = xml::child(chunk, "components")
            .into_iter()
            .flat_map(|list| list.children());
        for component in list.filter(|node| node.has_tag_name("component")) {
            let id = component.attribute("id").ok_or("a component has no id")?;
            let world = transform(component).map_err(|what| format!("component {}: {what}", excerpt(id)))?;
            components.insert(id, world);
        }
        Ok(Worlds {
            chunk: transform(chunk)
                .map_err(|what| format!("the chunk: {what}"))?
                .unwrap_or_default(),
            components,
        })
    }

    /// World from chunk for cameras of a component.
    pub(super) fn of(&self, component: Option<&str>) -> Check<Similarity> {
        let Some(id) = component else {
            return Ok(self.chunk);
        };
        let known = self.components.get(id);
        let own = known.ok_or_else(|| format!("its component {} is not in the file", excerpt(id)))?;
        Ok(own.unwrap_or(self.chunk))
    }
}

/// The `<transform>` of a chunk or component: rotation, translation and scale, each of which may be missing.
fn transform(node: Node<'_, '_>) -> Check<Option<Similarity>> {
    let Some(node) = xml::child(node, "transform") else {
        return Ok(None);
    };
    let mut world = Similarity::IDENTITY;
    if let Some(rows) = xml::child(node, "rotation") {
        let rows: [f64; 9] = xml::numbers(rows)?;
        world.rotation = pose::rotation(DMat3::from_cols_array(&rows).transpose(), "<transform>")?.0;
    }
    if let Some(translation) = xml::child(node, "translation") {
        world.translation = DVec3::from(xml::numbers::<3>(translation)?);
    }
    if let Some(scale) = xml::number(node, "scale")? {
        if scale <= 0.0 {
            return Err(format!("the scale {scale} is not positive"));
        }
        world.scale = scale;
    }
    Ok(Some(world))
}
