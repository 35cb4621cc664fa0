//! Perspective cameras of a document's default scene, still or animated.

use super::super::check::Check;
use super::animation::Motions;
use super::buffers::Buffers;
use super::json::{Document, entry};
use super::node::{Affine, visit};
use super::{glb, json};
use glam::{DMat3, DVec3};
use std::path::Path;

/// A camera in the world of the file.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct NodeCamera {
    /// For messages.
    pub(in super::super) node: u32,
    /// World from camera, camera axes x right, y up, z backward; a positive scale of each axis has no meaning.
    pub(in super::super) linear: DMat3,
    pub(in super::super) translation: DVec3,
    /// Vertical field of view, radians.
    pub(in super::super) yfov: f64,
    /// Width over height.
    pub(in super::super) aspect: Option<f64>,
}

/// Cameras of a scene.
pub(in super::super) struct SceneCameras {
    /// At least one.
    pub(in super::super) cameras: Vec<NodeCamera>,
    /// Whether they are one camera at successive times.
    pub(in super::super) is_animated: bool,
    pub(in super::super) warnings: Vec<String>,
}

/// Whether a file begins as a GLB file does.
pub(in super::super) fn is_binary(file: &[u8]) -> bool {
    file.starts_with(glb::MAGIC)
}

/// Nodes with a perspective camera in the order of the default scene; if one of them is animated, itself or by a node
/// above it, the first such one at `rate` frames a second, from the first time of its tracks to the last.
pub(in super::super) fn cameras(file: &[u8], folder: Option<&Path>, rate: f64) -> Check<SceneCameras> {
    let container = glb::split(file)?;
    let document = json::parse_any(container.json)?;
    let buffers = Buffers::new(&document, container.chunk, folder)?;
    let mut parents = vec![None; document.nodes.len()];
    let (mut found, mut others) = (Vec::new(), 0_u32);
    visit(&document, |placed| {
        parents[placed.index as usize] = placed.parent;
        found.extend(placed.node.camera.map(|camera| (placed.index, camera, placed.affine)));
    })?;
    let mut cameras = Vec::new();
    for (node, camera, affine) in found {
        let fault = |what: String| format!("camera {camera}: {what}");
        match perspective(&document, camera).map_err(fault)? {
            Some((yfov, aspect)) => cameras.push(NodeCamera {
                node,
                linear: units(affine.linear),
                translation: affine.translation,
                yfov,
                aspect,
            }),
            None => others += 1,
        }
    }
    let mut warnings = Vec::new();
    if others > 0 {
        warnings.push(match others {
            1 => "1 of the cameras is not perspective and is left out".into(),
            _ => format!("{others} of the cameras are not perspective and are left out"),
        });
    }
    if cameras.is_empty() {
        return Err(format!(
            "its default scene has no perspective camera, but {others} of other kinds"
        ));
    }
    let motions = Motions::read(&document, &buffers, file.len())?;
    let chain = |camera: &&NodeCamera| motions.touches(&ancestry(&parents, camera.node));
    let Some(moving) = cameras.iter().find(chain).copied() else {
        return Ok(SceneCameras {
            cameras,
            is_animated: false,
            warnings,
        });
    };
    if cameras.len() > 1 {
        let (all, node) = (cameras.len(), moving.node);
        warnings.push(format!("of {all} cameras, the animated one of node {node} is taken"));
    }
    Ok(SceneCameras {
        cameras: animated(&motions, &ancestry(&parents, moving.node), &moving, rate)?,
        is_animated: true,
        warnings,
    })
}

/// Vertical field of view and aspect ratio of a perspective camera.
fn perspective(document: &Document, index: u32) -> Check<Option<(f64, Option<f64>)>> {
    let Some(camera) = &entry(&document.cameras, index, "camera")?.perspective else {
        return Ok(None);
    };
    let (yfov, aspect) = (camera.yfov, camera.aspect_ratio);
    if !(yfov > 0.0 && yfov < std::f64::consts::PI) {
        return Err(format!("a \"yfov\" of {yfov} is not between 0 and π"));
    }
    if aspect.is_some_and(|aspect| !(aspect > 0.0 && aspect.is_finite())) {
        let aspect = aspect.unwrap_or_default();
        return Err(format!("an \"aspectRatio\" of {aspect} is not positive"));
    }
    Ok(Some((yfov, aspect)))
}

/// A node and its parents up to the root.
fn ancestry(parents: &[Option<u32>], node: u32) -> Vec<u32> {
    std::iter::successors(Some(node), |node| parents[*node as usize]).collect()
}

/// Columns of unit length; those of no length stay.
fn units(linear: DMat3) -> DMat3 {
    let unit = |axis: DVec3| axis.try_normalize().unwrap_or(axis);
    DMat3::from_cols(unit(linear.x_axis), unit(linear.y_axis), unit(linear.z_axis))
}

/// A camera at the times of the frames.
fn animated(motions: &Motions<'_>, chain: &[u32], camera: &NodeCamera, rate: f64) -> Check<Vec<NodeCamera>> {
    let times = motions.frames(chain, rate)?;
    let at = |time: f64| {
        let mut affine = Affine::IDENTITY;
        for &node in chain {
            affine = motions.affine(node, time)?.after(affine);
        }
        Ok(NodeCamera {
            linear: units(affine.linear),
            translation: affine.translation,
            ..*camera
        })
    };
    times.into_iter().map(at).collect()
}
