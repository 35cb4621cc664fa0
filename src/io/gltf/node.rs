//! Nodes of a scene: instances of meshes, with their matrices down from the root.

use super::super::check::Check;
use super::json::{Document, ExtrasJson, NodeJson, entry};
use glam::{DMat3, DQuat, DVec3};

/// Most nodes from a root down to a leaf.
const DEPTH_MAX: u32 = 256;

/// A mesh placed in the world.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct NodeInstance {
    pub(super) mesh: u32,
    /// For messages.
    pub(super) node: u32,
    /// World from mesh: linear part and translation.
    pub(super) affine: Affine,
    /// Whether the node marks its translation as the origin of the means.
    pub(super) marks_origin: bool,
}

/// Affine map, in `f64`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Affine {
    pub(super) linear: DMat3,
    pub(super) translation: DVec3,
}

impl Affine {
    pub(super) const IDENTITY: Affine = Affine {
        linear: DMat3::IDENTITY,
        translation: DVec3::ZERO,
    };

    pub(super) fn after(self, first: Affine) -> Affine {
        Affine {
            linear: self.linear * first.linear,
            translation: self.linear * first.translation + self.translation,
        }
    }
}

/// A node of the default scene, and the product of the matrices down to it.
pub(super) struct PlacedNode<'a> {
    pub(super) index: u32,
    pub(super) node: &'a NodeJson,
    /// 1 for a root.
    pub(super) depth: u32,
    #[cfg(feature = "train")]
    pub(super) parent: Option<u32>,
    pub(super) affine: Affine,
}

/// Instances of the default scene, in the order of its nodes, a parent before its children.
pub(super) fn instances(document: &Document) -> Check<Vec<NodeInstance>> {
    let mut instances = Vec::new();
    visit(document, |placed| {
        if let Some(mesh) = placed.node.mesh {
            let extras = &placed.node.extras;
            instances.push(NodeInstance {
                mesh,
                node: placed.index,
                affine: placed.affine,
                marks_origin: placed.depth == 1 && matches!(extras, Some(ExtrasJson::Own { splat_origin: true })),
            });
        }
    })?;
    Ok(instances)
}

/// Visits the nodes of the default scene in their order, a parent before its children. Without scenes, all nodes
/// without a parent are roots.
pub(super) fn visit<'a>(document: &'a Document, mut see: impl FnMut(PlacedNode<'a>)) -> Check<()> {
    let scene = match (document.scene, document.scenes.is_empty()) {
        (None, true) => None,
        (index, _) => Some(entry(&document.scenes, index.unwrap_or(0), "scene")?),
    };
    let roots = scene.map_or_else(|| orphans(document), |scene| scene.nodes.clone());
    let mut seen = vec![false; document.nodes.len()];
    let root = |&node: &u32| (node, 1, None, Affine::IDENTITY);
    let mut stack: Vec<(u32, u32, Option<u32>, Affine)> = roots.iter().rev().map(root).collect();
    while let Some((index, depth, _parent, outer)) = stack.pop() {
        let node = entry(&document.nodes, index, "node")?;
        if std::mem::replace(&mut seen[index as usize], true) {
            return Err(format!("node {index} is in a cycle or has two parents"));
        }
        if depth > DEPTH_MAX {
            return Err(format!("node {index} is more than {DEPTH_MAX} levels deep"));
        }
        let own = affine(node).map_err(|what| format!("node {index}: {what}"))?;
        let affine = outer.after(own);
        see(PlacedNode {
            index,
            node,
            depth,
            #[cfg(feature = "train")]
            parent: _parent,
            affine,
        });
        let children = node.children.iter().rev();
        stack.extend(children.map(|&child| (child, depth + 1, Some(index), affine)));
    }
    Ok(())
}

/// Nodes without a parent.
fn orphans(document: &Document) -> Vec<u32> {
    let mut is_child = vec![false; document.nodes.len()];
    for child in document.nodes.iter().flat_map(|node| &node.children) {
        if let Some(mark) = is_child.get_mut(*child as usize) {
            *mark = true;
        }
    }
    (0..)
        .zip(is_child)
        .filter_map(|(node, is_child)| (!is_child).then_some(node))
        .collect()
}

/// Translation, rotation (x, y, z, w) and scale of a node without a matrix.
#[derive(Clone, Copy, Debug)]
pub(super) struct NodeMotion {
    pub(super) translation: [f64; 3],
    pub(super) rotation: [f64; 4],
    pub(super) scale: [f64; 3],
}

impl NodeMotion {
    pub(super) fn of(node: &NodeJson) -> NodeMotion {
        NodeMotion {
            translation: node.translation.as_deref().copied().unwrap_or_default(),
            rotation: node.rotation.as_deref().copied().unwrap_or([0.0, 0.0, 0.0, 1.0]),
            scale: node.scale.as_deref().copied().unwrap_or([1.0; 3]),
        }
    }

    pub(super) fn affine(&self) -> Check<Affine> {
        let [x, y, z, w] = self.rotation;
        let length = x.hypot(y).hypot(z.hypot(w));
        if !(length > 0.0 && length.is_finite()) {
            return Err(format!("its rotation has the length {length}"));
        }
        let rotation = DQuat::from_xyzw(x / length, y / length, z / length, w / length);
        Ok(Affine {
            linear: DMat3::from_quat(rotation) * DMat3::from_diagonal(self.scale.into()),
            translation: self.translation.into(),
        })
    }
}

/// Matrix of a node by itself.
pub(super) fn affine(node: &NodeJson) -> Check<Affine> {
    let Some(matrix) = &node.matrix else {
        return NodeMotion::of(node).affine();
    };
    let [x, y, z, t] = [0, 4, 8, 12].map(|i| DVec3::new(matrix[i], matrix[i + 1], matrix[i + 2]));
    if [3, 7, 11, 15].map(|i| matrix[i]) != [0.0, 0.0, 0.0, 1.0] {
        return Err("the last row of its matrix is not 0, 0, 0, 1".into());
    }
    Ok(Affine {
        linear: DMat3::from_cols(x, y, z),
        translation: t,
    })
}
