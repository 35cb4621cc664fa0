//! Animations of nodes: translation, rotation and scale over time.

use super::super::check::Check;
use super::super::reader::excerpt;
use super::accessor::{AccessorRows, Component, ComponentKind};
use super::buffers::Buffers;
use super::json::{Document, NodeJson, SamplerJson, ShapeJson, entry};
use super::node::{Affine, NodeMotion, affine};
use glam::{DQuat, DVec4};
use std::collections::BTreeMap;

/// Most frames of an animation: 55 minutes at 30 a second.
const FRAMES_MAX: f64 = 100_000.0;

/// Interpolation between two keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum KeyMode {
    Linear,
    Step,
    /// Each key has a tangent before it, its value, and a tangent after it.
    Cubic,
}

/// Values of a property at increasing times.
struct Track {
    mode: KeyMode,
    /// Seconds, at least one.
    times: Vec<f64>,
    values: Vec<DVec4>,
}

/// Tracks of a node, in the order translation, rotation, scale.
type NodeTracks = [Option<Track>; 3];

/// Names of the properties, in the order of the tracks, and the shapes of their values.
const PROPERTIES: [(&str, ShapeJson); 3] = [
    ("translation", ShapeJson::Vec3),
    ("rotation", ShapeJson::Vec4),
    ("scale", ShapeJson::Vec3),
];

/// Forms of the values of rotations.
const ROTATIONS: [ComponentKind; 5] = [
    (Component::F32, false),
    (Component::I8, true),
    (Component::U8, true),
    (Component::I16, true),
    (Component::U16, true),
];

/// Tracks of all nodes.
pub(super) struct Motions<'a> {
    nodes: &'a [NodeJson],
    tracks: BTreeMap<u32, NodeTracks>,
}

impl<'a> Motions<'a> {
    /// Reads all animations; of two tracks of one property the first counts. A track has at most a key for each of
    /// `file_bytes`.
    pub(super) fn read(document: &'a Document, buffers: &Buffers<'_>, file_bytes: usize) -> Check<Motions<'a>> {
        let mut tracks: BTreeMap<u32, NodeTracks> = BTreeMap::new();
        let mut keys = file_bytes;
        for (index, animation) in document.animations.iter().enumerate() {
            for (channel, of) in animation.channels.iter().enumerate() {
                let property = PROPERTIES.iter().position(|(name, _)| *name == of.target.path);
                // Others are weights of meshes, and extensions.
                let (Some(node), Some(property)) = (of.target.node, property) else {
                    continue;
                };
                entry(&document.nodes, node, "node")?;
                let place = &mut tracks.entry(node).or_default()[property];
                if place.is_none() {
                    let sampler = entry(&animation.samplers, of.sampler, "sampler")?;
                    let track = Track::read(document, buffers, sampler, property, &mut keys)
                        .map_err(|what| format!("animation {index}, channel {channel}: {what}"))?;
                    *place = Some(track);
                }
            }
        }
        Ok(Motions {
            nodes: &document.nodes,
            tracks,
        })
    }

    /// Whether one of the nodes has a track.
    pub(super) fn touches(&self, nodes: &[u32]) -> bool {
        nodes.iter().any(|node| self.tracks.contains_key(node))
    }

    /// Times of the frames from the first key of these nodes to their last.
    pub(super) fn frames(&self, nodes: &[u32], rate: f64) -> Check<Vec<f64>> {
        let (mut first, mut last) = (f64::INFINITY, f64::NEG_INFINITY);
        for track in nodes
            .iter()
            .filter_map(|node| self.tracks.get(node))
            .flatten()
            .flatten()
        {
            first = first.min(track.times[0]);
            last = last.max(track.times[track.times.len() - 1]);
        }
        // A frame that rounding puts behind the end counts.
        let count = ((last - first) * rate + 1e-3).floor() + 1.0;
        if !(1.0..=FRAMES_MAX).contains(&count) {
            return Err(format!(
                "{count} frames of animation are not between 1 and {FRAMES_MAX}"
            ));
        }
        Ok((0..count as u32).map(|i| first + f64::from(i) / rate).collect())
    }

    /// Matrix of a node by itself at a time.
    pub(super) fn affine(&self, node: u32, time: f64) -> Check<Affine> {
        let json = entry(self.nodes, node, "node")?;
        let Some([translation, rotation, scale]) = self.tracks.get(&node) else {
            return affine(json);
        };
        let mut motion = NodeMotion::of(json);
        if let Some(track) = translation {
            motion.translation = track.at(time).truncate().into();
        }
        if let Some(track) = rotation {
            motion.rotation = track.rotation_at(time).into();
        }
        if let Some(track) = scale {
            motion.scale = track.at(time).truncate().into();
        }
        motion.affine().map_err(|what| format!("node {node}: {what}"))
    }
}

impl Track {
    fn read(
        document: &Document,
        buffers: &Buffers<'_>,
        sampler: &SamplerJson,
        property: usize,
        keys: &mut usize,
    ) -> Check<Track> {
        let mode = match sampler.interpolation.as_deref() {
            None | Some("LINEAR") => KeyMode::Linear,
            Some("STEP") => KeyMode::Step,
            Some("CUBICSPLINE") => KeyMode::Cubic,
            Some(other) => return Err(format!("there is no interpolation {}", excerpt(other))),
        };
        let float = [(Component::F32, false)];
        let inputs = AccessorRows::open(document, buffers, sampler.input, &[ShapeJson::Scalar], &float)?;
        let kinds: &[ComponentKind] = if property == 1 { &ROTATIONS } else { &float };
        let outputs = AccessorRows::open(document, buffers, sampler.output, &[PROPERTIES[property].1], kinds)?;
        let each = if mode == KeyMode::Cubic { 3 } else { 1 };
        let (count, values) = (inputs.count(), outputs.count());
        if count == 0 || count.checked_mul(each) != Some(values) {
            return Err(format!("{count} times need {each} values each, but there are {values}"));
        }
        let left = (*keys as u64).checked_sub(count);
        let left = left.ok_or_else(|| format!("{count} times are more than the file has bytes for"))?;
        *keys = left as usize;
        let count = count as usize;
        let times: Vec<f64> = (0..count).map(|i| f64::from(inputs.row(i)[0])).collect();
        let is_increasing = times.windows(2).all(|pair| pair[0] < pair[1]);
        if !is_increasing || !times.iter().all(|time| time.is_finite()) {
            return Err("its times do not increase".into());
        }
        let value = |i: usize| DVec4::from(outputs.row(i).map(f64::from));
        let values: Vec<DVec4> = (0..count * each as usize).map(value).collect();
        match values.iter().all(|value| value.is_finite()) {
            true => Ok(Track { mode, times, values }),
            false => Err("a value is not finite".into()),
        }
    }

    /// The keys about a time, and the share of the way between them.
    fn place(&self, time: f64) -> (usize, usize, f64) {
        let after = self.times.partition_point(|key| *key <= time);
        match after {
            0 => (0, 0, 0.0),
            _ if after == self.times.len() => (after - 1, after - 1, 0.0),
            _ => {
                let (from, to) = (self.times[after - 1], self.times[after]);
                (after - 1, after, (time - from) / (to - from))
            }
        }
    }

    fn at(&self, time: f64) -> DVec4 {
        let (from, to, share) = self.place(time);
        match self.mode {
            KeyMode::Linear => self.values[from].lerp(self.values[to], share),
            KeyMode::Step => self.values[from],
            KeyMode::Cubic => {
                let length = self.times[to] - self.times[from];
                let (a, b) = (self.values[3 * from + 1], self.values[3 * to + 1]);
                let (leaving, arriving) = (length * self.values[3 * from + 2], length * self.values[3 * to]);
                let (t, rest) = (share, 1.0 - share);
                let (one, other) = (rest * rest * (1.0 + 2.0 * t), t * t * (3.0 - 2.0 * t));
                one * a + other * b + rest * rest * t * leaving - t * t * rest * arriving
            }
        }
    }

    fn rotation_at(&self, time: f64) -> DVec4 {
        let (from, to, share) = self.place(time);
        if self.mode != KeyMode::Linear || from == to {
            return self.at(time);
        }
        let unit = |value: DVec4| value.try_normalize().map(DQuat::from_vec4);
        match (unit(self.values[from]), unit(self.values[to])) {
            (Some(a), Some(b)) => a.slerp(b, share).into(),
            // Without a length: the fault is told by the node.
            _ => DVec4::ZERO,
        }
    }
}
