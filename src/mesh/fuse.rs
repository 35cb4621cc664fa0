//! Fusion of depth maps into a mesh.

use super::depth_map::DepthMap;
use super::depth_maps::DepthMaps;
use super::extract::MeshBuilder;
use super::flood_fill::FloodFill;
use super::volume::{BLOCK_BYTES, Key, Volume, keys_near};
use crate::scene::Mesh;
use crate::stats::quantile;
use crate::{Error, Result};
use glam::{DVec2, DVec3};
use std::collections::BTreeSet;

/// Options of a fusion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FusionOptions {
    /// Edge of a voxel in world units; `None`: the larger of a pixel's footprint at the median depth and a 2048th of
    /// the depths' extent.
    pub voxel: Option<f64>,
    /// Distance from the surface at which distances end, world units; `None`: four voxels.
    pub truncation: Option<f64>,
    /// True for a closed mesh: voxels that no view saw are solid, or outside where they are open to the border or to a
    /// camera.
    pub closed: bool,
    /// Most bytes of voxels at a time; a volume beyond is fused in slabs.
    pub memory: u64,
}

impl Default for FusionOptions {
    fn default() -> FusionOptions {
        FusionOptions {
            voxel: None,
            truncation: None,
            closed: false,
            memory: 160 << 20,
        }
    }
}

/// Truncation in voxels (Curless and Levoy 1996 take a few; thinner walls than two truncations lose their other side).
const TRUNCATION_VOXELS: f64 = 4.0;
/// Least voxels of the extent's diagonal in a voxel by default.
const VOXELS_ACROSS: f64 = 2048.0;
/// Views that a corner of the surface needs, if there are more than two views.
const VIEWS_MIN: u32 = 2;
/// Most slabs of a volume.
const SLABS_MAX: u64 = 16;

/// Part of a fusion, for progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FusionPhase {
    /// Views are drawn and measured.
    Survey,
    /// Blocks near the surface are listed, view by view.
    List,
    /// Views are added to slab `.0` of `.1`.
    Add(usize, usize),
}

/// Facts of a fusion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FusionReport {
    /// Edge of a voxel, world units.
    pub voxel: f64,
    /// Truncation, world units.
    pub truncation: f64,
    /// Median of all depths, world units.
    pub depth_median: f64,
    /// Blocks of 8³ voxels.
    pub blocks: usize,
    /// Bytes of the largest slab's voxels.
    pub slab_bytes: u64,
    /// Slabs.
    pub slabs: usize,
}

/// Fuses depth maps to a mesh. `progress` is told each view of each phase, and may end the fusion with an error.
///
/// Voxels that no view saw, or a single one of several, are unknown, and the mesh is open there. The same maps give the
/// same bytes. Positions are exact to the square of a voxel.
///
/// # Errors
/// Those of drawing and of `progress`. [`Error::Config`] if no view has a surface, or if voxels of this size take more
/// memory than 16 slabs.
pub fn fuse(
    options: &FusionOptions,
    views: &mut DepthMaps<'_>,
    mut progress: impl FnMut(FusionPhase, usize) -> Result<()>,
) -> Result<(Mesh, FusionReport)> {
    let count = views.count();
    let mut report = survey(views, options, &mut progress)?;
    let keys = list(views, options, &report, &mut progress)?;
    report.blocks = keys.len();
    let slabs = slabs(&keys, options.memory, report.voxel)?;
    report.slabs = slabs.len();
    let views_min = if count > 2 { VIEWS_MIN } else { 1 };
    let mut outside = None;
    if options.closed {
        let cells = FloodFill::boxed(&keys);
        if cells > options.memory {
            return Err(too_small(report.voxel, cells, options.memory));
        }
        let mut found = FloodFill::new(&keys);
        let mut cameras = Vec::new();
        for_slabs(views, &keys, &slabs, &mut report, &mut progress, |volume, own| {
            found.note(volume, views_min, own);
        })?;
        for view in 0..count {
            let place = |map: &DepthMap| Ok((map.camera.position / report.voxel).round().as_ivec3().to_array());
            cameras.push(views.with(view, place)?);
        }
        found.spread(&cameras);
        outside = Some(found);
    }
    let mut surface = MeshBuilder::default();
    for_slabs(views, &keys, &slabs, &mut report, &mut progress, |volume, own| {
        surface.add(volume, (views_min, outside.as_ref()), own);
    })?;
    Ok((surface.mesh, report))
}

/// Fuses slab by slab; `with` gets each volume and tells the slab's own blocks from their neighbours.
fn for_slabs(
    views: &mut DepthMaps<'_>,
    keys: &[Key],
    slabs: &[Slab],
    report: &mut FusionReport,
    progress: &mut impl FnMut(FusionPhase, usize) -> Result<()>,
    mut with: impl FnMut(&Volume, &(dyn Fn(&Key) -> bool + Sync)),
) -> Result<()> {
    for (i, (own, slab)) in slabs.iter().enumerate() {
        let mut volume = Volume::new(report.voxel, report.truncation, keys[slab.clone()].to_vec());
        report.slab_bytes = report.slab_bytes.max(slab.len() as u64 * BLOCK_BYTES);
        for view in 0..views.count() {
            progress(FusionPhase::Add(i, slabs.len()), view)?;
            views.with(view, |map| {
                volume.add(map, report.depth_median as f32);
                Ok(())
            })?;
        }
        with(&volume, &|key| own.contains(&key[0]));
    }
    Ok(())
}

/// Draws all views once: the median depth, and from it the voxel and the truncation.
fn survey(
    views: &mut DepthMaps<'_>,
    options: &FusionOptions,
    progress: &mut impl FnMut(FusionPhase, usize) -> Result<()>,
) -> Result<FusionReport> {
    let mut depths = Vec::new();
    let mut footprints = Vec::new();
    let [mut low, mut high] = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    for view in 0..views.count() {
        progress(FusionPhase::Survey, view)?;
        views.with(view, |map| {
            let camera = &map.camera;
            // One pixel of seven in each direction.
            let (width, height) = (camera.width as usize, camera.height as usize);
            let places = (3..height)
                .step_by(7)
                .flat_map(|y| (3..width).step_by(7).map(move |x| (x, y)));
            for (x, y) in places {
                let depth = f64::from(map.depth[y * width + x]);
                if depth.is_nan() {
                    continue;
                }
                let ray = camera.ray_from_pixel(DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
                let point = camera.position + ray * depth;
                (low, high) = (low.min(point), high.max(point));
                depths.push(depth);
                footprints.push(depth / camera.focal.max_element());
            }
            Ok(())
        })?;
    }
    let (Some(depth_median), Some(footprint)) = (quantile(&mut depths, 0.5), quantile(&mut footprints, 0.5)) else {
        return Err(Error::Config(
            "no view has a surface: the scene covers no pixel by half, or the cameras do not see it".into(),
        ));
    };
    views.limit(depth_median as f32);
    let extent = (high - low).length().min(8.0 * depth_median);
    let voxel = options.voxel.unwrap_or_else(|| footprint.max(extent / VOXELS_ACROSS));
    Ok(FusionReport {
        voxel,
        truncation: options.truncation.unwrap_or(TRUNCATION_VOXELS * voxel),
        depth_median,
        ..FusionReport::default()
    })
}

/// Blocks near the surface, in ascending order.
fn list(
    views: &mut DepthMaps<'_>,
    options: &FusionOptions,
    report: &FusionReport,
    progress: &mut impl FnMut(FusionPhase, usize) -> Result<()>,
) -> Result<Vec<Key>> {
    // Indices of voxels are 32-bit.
    let most = report.depth_median * 64.0 / report.voxel;
    if most > f64::from(i32::MAX) {
        return Err(Error::Config(format!(
            "a voxel of {} is too small for this scene",
            report.voxel
        )));
    }
    let mut keys: BTreeSet<Key> = BTreeSet::new();
    for view in 0..views.count() {
        progress(FusionPhase::List, view)?;
        views.with(view, |map| {
            keys.extend(keys_near(map, report.voxel, report.truncation));
            let bytes = keys.len() as u64 * BLOCK_BYTES;
            match bytes <= SLABS_MAX * options.memory {
                true => Ok(()),
                false => Err(too_small(report.voxel, bytes, options.memory)),
            }
        })?;
    }
    Ok(keys.into_iter().collect())
}

fn too_small(voxel: f64, bytes: u64, memory: u64) -> Error {
    // Blocks go by the square of the voxel's size.
    let larger = voxel * (bytes as f64 / memory as f64).sqrt();
    Error::Config(format!(
        "a voxel of {voxel:.3e} world units takes more than {} MiB: try --voxel {larger:.1e}",
        bytes >> 20
    ))
}

/// A slab: the range of its own blocks along x, and of all its blocks among the keys.
type Slab = (std::ops::Range<i32>, std::ops::Range<usize>);

/// Slabs of blocks along x that fit into memory, each with a layer of neighbours on both sides.
fn slabs(keys: &[Key], memory: u64, voxel: f64) -> Result<Vec<Slab>> {
    let layer = |x: i32| keys.partition_point(|key| key[0] < x);
    let (Some(first), Some(last)) = (keys.first(), keys.last()) else {
        return Ok(Vec::new());
    };
    let bytes = |begin: i32, end: i32| (layer(end + 1) - layer(begin - 1)) as u64 * BLOCK_BYTES;
    let mut slabs = Vec::new();
    // A layer before the first: cubes of a closed mesh begin there.
    let mut begin = first[0] - 1;
    while begin <= last[0] {
        let mut end = begin + 1;
        if bytes(begin, end) > memory {
            return Err(too_small(voxel, bytes(begin, end), memory));
        }
        while end <= last[0] && bytes(begin, end + 1) <= memory {
            end += 1;
        }
        slabs.push((begin..end, layer(begin - 1)..layer(end + 1)));
        begin = end;
    }
    Ok(slabs)
}
