//! Reading the splats of a document's default scene.

use super::super::check::Check;
use super::super::loaded::{AxesBy, Collector, LoadedSplats, StoredAs, StoredSplat};
use super::super::reader::{Reader, excerpt};
use super::super::source::Source;
use super::super::spz;
use super::attributes::{Attributes, PrimitiveSplats, is_beyond_degree_3, position};
use super::buffers::Buffers;
use super::json::{Document, PrimitiveJson, SplatsJson, entry};
use super::node::{NodeInstance, instances};
use super::placement::Placement;
use super::{EXTENSION, glb, json};
use crate::error::{Error, Result};
use crate::scene::{Axes, ScreenFilter, sh_coefficient_count};
use glam::{DMat3, DVec3};
use std::collections::BTreeMap;
use std::path::Path;

/// A translation of so many times the splats' own size becomes their origin: `f32` positions would be rounded to
/// 1000 · 2⁻²⁴ of that size, 1/16,000.
const ORIGIN_SIZES: f64 = 1000.0;

/// A mesh's primitives with splats, and its instances.
struct SplatMesh<'a> {
    contents: Vec<PrimitiveSplats<'a>>,
    instances: Vec<NodeInstance>,
}

/// State of reading a document.
struct SceneReading<'a> {
    path: &'a Path,
    document: &'a Document,
    buffers: &'a Buffers<'a>,
    /// Length of the file in bytes.
    file_bytes: u64,
    /// Splats of all instances so far, but for the first ones of SPZ files.
    total: u64,
    /// Bytes of the SPZ files so far.
    payload_bytes: u64,
    filters: Vec<ScreenFilter>,
    warnings: Vec<String>,
}

/// Reads the splats of the default scene: a `.glb` or `.gltf` file with the files that it names beside it, or such a
/// file in memory that holds all of its buffers. The result is in glTF's axes, left, up, front; world units are the
/// file's.
///
/// # Errors
/// Names the file and the part: neither GLB nor glTF 2.0, a required extension that is not supported, no splats,
/// missing attributes, rows beyond a buffer, buffers that cannot be had, nodes in a cycle or too deep, matrices with a
/// mirror or shear, more splats than the file can justify (see [the module](self)).
pub fn read<'a>(source: impl Into<Source<'a>>) -> Result<LoadedSplats> {
    let source = source.into();
    let path = source.name();
    let file = Reader::all(source)?;
    let folder = match source.in_memory() {
        Some(_) => None,
        None => Some(path.parent().unwrap_or(Path::new(""))),
    };
    read_file(path, &file, folder).map_err(|what| Error::file(path, what))
}

fn read_file(path: &Path, file: &[u8], folder: Option<&Path>) -> Check<LoadedSplats> {
    let container = glb::split(file)?;
    let document = json::parse(container.json)?;
    let buffers = Buffers::new(&document, container.chunk, folder)?;
    let mut reading = SceneReading {
        path,
        document: &document,
        buffers: &buffers,
        file_bytes: file.len() as u64,
        total: 0,
        payload_bytes: 0,
        filters: Vec::new(),
        warnings: Vec::new(),
    };
    if container.trailing > 0 {
        reading.warn(format!(
            "the {} bytes after the stated length were ignored",
            container.trailing
        ));
    }
    if document
        .extensions_used
        .iter()
        .any(|name| name == "EXT_mesh_gpu_instancing")
    {
        reading.warn("EXT_mesh_gpu_instancing is not supported: its instances are left out".into());
    }
    let meshes = reading.meshes()?;
    reading.warn_of_others();
    reading.collect(&meshes)
}

/// Whether a primitive holds splats.
fn splats_of(primitive: &PrimitiveJson) -> Option<(Option<&SplatsJson>, Option<u32>)> {
    let extensions = primitive.extensions.as_ref()?;
    let payload = extensions.payloads.spz();
    let payload = payload.or_else(|| extensions.splats.as_ref().and_then(|splats| splats.extensions.spz()));
    (extensions.splats.is_some() || payload.is_some()).then_some((extensions.splats.as_ref(), payload))
}

impl<'a> SceneReading<'a> {
    /// Adds a warning, once.
    fn warn(&mut self, what: String) {
        let warning = format!("{}: {what}", self.path.display());
        if !self.warnings.contains(&warning) && self.warnings.len() < 100 {
            self.warnings.push(warning);
        }
    }

    /// Meshes with splats that the scene shows, in the order of their first instances.
    fn meshes(&mut self) -> Check<Vec<SplatMesh<'a>>> {
        let mut order = Vec::new();
        let mut by_mesh: BTreeMap<u32, Vec<NodeInstance>> = BTreeMap::new();
        for instance in instances(self.document)? {
            let of_mesh = by_mesh.entry(instance.mesh).or_default();
            if of_mesh.is_empty() {
                order.push(instance.mesh);
            }
            of_mesh.push(instance);
        }
        let mut meshes = Vec::new();
        for index in order {
            let instances = by_mesh.remove(&index).unwrap_or_default();
            let mesh = entry(&self.document.meshes, index, "mesh")?;
            let mut contents = Vec::new();
            for (i, primitive) in mesh.primitives.iter().enumerate() {
                let content = self.primitive(primitive, instances.len() as u64);
                contents.extend(content.map_err(|what| format!("mesh {index}, primitive {i}: {what}"))?);
            }
            if !contents.is_empty() {
                meshes.push(SplatMesh { contents, instances });
            }
        }
        let has_splats = |mesh: &json::MeshJson| mesh.primitives.iter().any(|p| splats_of(p).is_some());
        let all = self.document.meshes.iter().filter(|mesh| has_splats(mesh)).count();
        match (meshes.is_empty(), all, self.document.meshes.len()) {
            (true, 0, 1..) => Err(format!("holds no splats: no mesh has the extension {EXTENSION}")),
            (true, 1.., _) => Err(format!("its default scene shows none of the {all} meshes with splats")),
            _ => Ok(meshes),
        }
    }

    /// Splats of a primitive with so many instances; `None` if it has other contents.
    fn primitive(&mut self, primitive: &PrimitiveJson, instances: u64) -> Check<Option<PrimitiveSplats<'a>>> {
        let Some((splats, payload)) = splats_of(primitive) else {
            return Ok(None);
        };
        if let Some(splats) = splats {
            self.warn_of_strings(splats);
        }
        if is_beyond_degree_3(primitive) {
            self.warn("harmonics above degree 3 are left out".into());
        }
        if let Some(view) = payload {
            let content = self.payload(view)?;
            self.count(content.count(), instances - 1)?;
            return Ok(Some(content));
        }
        let position = position(self.document, self.buffers, primitive)?;
        let other = splats.and_then(|splats| splats.extensions.others.keys().next());
        if let (Some(other), false) = (other, position.has_data()) {
            return Err(format!(
                "its splats are in the extension {}, which is not supported",
                excerpt(other)
            ));
        }
        self.count(position.count(), instances)?;
        self.filters.push(ScreenFilter::Classic);
        let attributes = Attributes::open(self.document, self.buffers, primitive, position)?;
        Ok(Some(PrimitiveSplats::Attributes(Box::new(attributes))))
    }

    /// Splats of an SPZ file in a buffer view, in glTF's axes.
    fn payload(&mut self, view: u32) -> Check<PrimitiveSplats<'a>> {
        let bytes = self.buffers.view(view)?.bytes;
        self.payload_bytes = self.payload_bytes.saturating_add(bytes.len() as u64);
        let all = self.bytes();
        if self.payload_bytes > all {
            return Err(format!(
                "its SPZ files so far have {} bytes, more than the {all} read",
                self.payload_bytes
            ));
        }
        let mut loaded = spz::read(Source::bytes(self.path, bytes)).map_err(|error| match error {
            Error::File { what, .. } => format!("its SPZ file: {what}"),
            other => format!("its SPZ file: {other}"),
        })?;
        for warning in loaded.warnings {
            if !self.warnings.contains(&warning) {
                self.warnings.push(warning);
            }
        }
        let axes = loaded.stored.axes;
        if loaded.stored.axes_by == AxesBy::Assumption {
            self.warn(format!(
                "its SPZ file does not state its axes; {axes} was assumed, as the draft of the extension does, though \
                 some programs take {} there",
                Axes::LUF
            ));
        }
        loaded.splats.change_axes(axes, Axes::LUF);
        self.filters.push(loaded.splats.filter);
        Ok(PrimitiveSplats::Unpacked(Box::new(loaded.splats)))
    }

    /// Bytes read so far: the file and its external buffers.
    fn bytes(&self) -> u64 {
        self.file_bytes + self.buffers.external_bytes()
    }

    /// Adds splats to the total, and compares that with the bytes read.
    fn count(&mut self, splats: u64, instances: u64) -> Check<()> {
        self.total = self.total.saturating_add(splats.saturating_mul(instances));
        let bytes = self.bytes();
        match self.total <= bytes {
            true => Ok(()),
            false => Err(format!(
                "{} splats in all instances so far are more than the {bytes} bytes of the file and its buffers justify \
                 (one for each byte)",
                self.total
            )),
        }
    }

    fn warn_of_strings(&mut self, splats: &SplatsJson) {
        let known: [(&str, &Option<String>, &[&str]); 4] = [
            ("kernel", &splats.kernel, &["ellipse"]),
            ("projection", &splats.projection, &["perspective"]),
            ("sortingMethod", &splats.sorting_method, &["cameraDistance"]),
            // The last is that of a draft.
            ("colorSpace", &splats.color_space, &["srgb_rec709_display", "BT.709"]),
        ];
        for (name, value, defaults) in known {
            match value.as_deref() {
                Some("lin_rec709_display") if name == "colorSpace" => self.warn(
                    "its colours are linear (colorSpace lin_rec709_display) and shown as stored, darker than meant"
                        .into(),
                ),
                Some(value) if !defaults.contains(&value) => {
                    self.warn(format!("unknown {name} {} taken for {}", excerpt(value), defaults[0]));
                }
                _ => {}
            }
        }
    }

    /// Warns of primitives that are no splats.
    fn warn_of_others(&mut self) {
        let others = |mesh: &json::MeshJson| mesh.primitives.iter().filter(|p| splats_of(p).is_none()).count();
        let meshes = self.document.meshes.iter().filter(|mesh| others(mesh) > 0).count();
        if meshes > 0 {
            let primitives: usize = self.document.meshes.iter().map(others).sum();
            self.warn(format!(
                "{primitives} primitives of {meshes} meshes hold no splats and were ignored"
            ));
        }
    }

    /// All instances' splats in the world.
    fn collect(mut self, meshes: &[SplatMesh]) -> Check<LoadedSplats> {
        let contents = || meshes.iter().flat_map(|mesh| &mesh.contents);
        let sh_degree = contents().map(PrimitiveSplats::sh_degree).max().unwrap_or(0);
        let count = meshes.iter().map(|mesh| {
            let splats: u64 = mesh.contents.iter().map(PrimitiveSplats::count).sum();
            splats * mesh.instances.len() as u64
        });
        // In range: `count` has compared it with the bytes in memory.
        let count = count.sum::<u64>() as usize;
        let filter = self.filter();
        let origin = origin(meshes)?;
        let mut collector = Collector::new(count, sh_degree, filter);
        let mut sh = vec![0.0; sh_coefficient_count(sh_degree) * 3];
        let mut clamped = 0;
        for mesh in meshes {
            for instance in &mesh.instances {
                let placement = placement(instance, origin, sh_degree)?;
                for content in &mesh.contents {
                    sh.fill(0.0);
                    for index in 0..content.count() as usize {
                        let splat = placement.apply(&content.splat(index));
                        let look = content.look(index, &mut sh);
                        placement.rotate_harmonics(&mut sh);
                        clamped += usize::from(look.is_clamped);
                        collector.push(&StoredSplat {
                            mean: splat.mean.as_vec3().into(),
                            quaternion: splat.quaternion,
                            log_scale: splat.log_scale.as_vec3().into(),
                            opacity_logit: look.opacity_logit,
                            sh: &sh,
                        });
                    }
                }
            }
        }
        if clamped > 0 {
            self.warn(format!(
                "{clamped} of {count} opacities are not between 0 and 1 and were clamped"
            ));
        }
        let stored = StoredAs {
            format: "glTF".into(),
            axes: Axes::LUF,
            axes_by: AxesBy::Format,
        };
        let mut loaded = collector.finish(self.path, stored, self.warnings);
        loaded.splats.origin = origin;
        Ok(loaded)
    }

    /// Filter that all primitives share, else the default.
    fn filter(&mut self) -> ScreenFilter {
        let first = self.filters.first().copied().unwrap_or_default();
        if self.filters.iter().any(|filter| *filter != first) {
            let name = ScreenFilter::default().name();
            self.warn(format!(
                "its splats have several render modes and are shown in mode \"{name}\""
            ));
            return ScreenFilter::default();
        }
        first
    }
}

fn placement(instance: &NodeInstance, origin: DVec3, sh_degree: u32) -> Check<Placement> {
    Placement::new(instance.affine, origin, sh_degree).map_err(|what| format!("node {}: {what}", instance.node))
}

/// Origin of the means: the translation of the first instance if its node marks it, or if it is far larger than the
/// splats, which is the median of their distances from it; else zero.
fn origin(meshes: &[SplatMesh]) -> Check<DVec3> {
    let all = || {
        meshes
            .iter()
            .flat_map(|mesh| mesh.instances.iter().map(move |instance| (mesh, instance)))
    };
    let Some((_, first)) = all().next() else {
        return Ok(DVec3::ZERO);
    };
    let translation = first.affine.translation;
    if first.marks_origin && first.affine.linear == DMat3::IDENTITY && all().count() == 1 {
        return Ok(translation);
    }
    if translation == DVec3::ZERO {
        return Ok(DVec3::ZERO);
    }
    let mut sizes: Vec<f32> = Vec::new();
    for (mesh, instance) in all() {
        let placement = placement(instance, translation, 0)?;
        for content in &mesh.contents {
            let size = |index| {
                let splat = content.splat(index);
                let scale = splat.log_scale.max_element().exp() * instance.affine.linear.col(0).length();
                (placement.mean(splat.mean).length() + scale) as f32
            };
            sizes.extend((0..content.count() as usize).map(size).filter(|size| size.is_finite()));
        }
    }
    let middle = sizes.len() / 2;
    let median = match sizes.is_empty() {
        true => return Ok(DVec3::ZERO),
        false => *sizes.select_nth_unstable_by(middle, f32::total_cmp).1,
    };
    let is_far = translation.length() > ORIGIN_SIZES * f64::from(median);
    Ok(if is_far { translation } else { DVec3::ZERO })
}
