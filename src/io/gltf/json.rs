//! Parts of a glTF document that splats need, as JSON has them.
//!
//! Members are boxed where a document may have many objects without them: an empty object is three bytes of text.

use super::super::check::Check;
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::collections::BTreeMap;

/// A whole document.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Document {
    pub(super) asset: AssetJson,
    #[serde(default)]
    pub(super) extensions_used: Vec<String>,
    #[serde(default)]
    pub(super) extensions_required: Vec<String>,
    pub(super) scene: Option<u32>,
    #[serde(default)]
    pub(super) scenes: Vec<SceneJson>,
    #[serde(default)]
    pub(super) nodes: Vec<NodeJson>,
    #[serde(default)]
    pub(super) meshes: Vec<MeshJson>,
    #[serde(default)]
    pub(super) accessors: Vec<AccessorJson>,
    #[serde(default)]
    pub(super) buffer_views: Vec<ViewJson>,
    #[serde(default)]
    pub(super) buffers: Vec<BufferJson>,
    #[cfg(feature = "train")]
    #[serde(default)]
    pub(super) cameras: Vec<CameraJson>,
    #[cfg(feature = "train")]
    #[serde(default)]
    pub(super) animations: Vec<AnimationJson>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct AssetJson {
    pub(super) version: String,
    pub(super) min_version: Option<String>,
}

#[derive(Debug, Deserialize)]
pub(super) struct SceneJson {
    #[serde(default)]
    pub(super) nodes: Vec<u32>,
}

#[derive(Debug, Deserialize)]
pub(super) struct NodeJson {
    #[serde(default)]
    pub(super) children: Vec<u32>,
    pub(super) mesh: Option<u32>,
    #[cfg(feature = "train")]
    pub(super) camera: Option<u32>,
    /// By columns.
    pub(super) matrix: Option<Box<[f64; 16]>>,
    pub(super) translation: Option<Box<[f64; 3]>>,
    /// x, y, z, w.
    pub(super) rotation: Option<Box<[f64; 4]>>,
    pub(super) scale: Option<Box<[f64; 3]>>,
    pub(super) extras: Option<ExtrasJson>,
}

/// A mark of this program's own files. Extras of other programs may be anything.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
pub(super) enum ExtrasJson {
    Own {
        /// Whether the translation is the origin of the means.
        #[serde(rename = "splatOrigin")]
        splat_origin: bool,
    },
    Foreign(IgnoredAny),
}

#[cfg(feature = "train")]
#[derive(Debug, Deserialize)]
pub(super) struct CameraJson {
    pub(super) perspective: Option<Box<PerspectiveJson>>,
}

#[cfg(feature = "train")]
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct PerspectiveJson {
    /// Vertical field of view, radians.
    pub(super) yfov: f64,
    /// Width over height.
    pub(super) aspect_ratio: Option<f64>,
}

#[cfg(feature = "train")]
#[derive(Debug, Deserialize)]
pub(super) struct AnimationJson {
    #[serde(default)]
    pub(super) channels: Vec<ChannelJson>,
    #[serde(default)]
    pub(super) samplers: Vec<SamplerJson>,
}

#[cfg(feature = "train")]
#[derive(Debug, Deserialize)]
pub(super) struct ChannelJson {
    pub(super) sampler: u32,
    pub(super) target: TargetJson,
}

#[cfg(feature = "train")]
#[derive(Debug, Deserialize)]
pub(super) struct TargetJson {
    pub(super) node: Option<u32>,
    pub(super) path: String,
}

#[cfg(feature = "train")]
#[derive(Debug, Deserialize)]
pub(super) struct SamplerJson {
    /// Accessor of the times, seconds.
    pub(super) input: u32,
    /// Accessor of the values.
    pub(super) output: u32,
    pub(super) interpolation: Option<String>,
}

#[derive(Debug, Deserialize)]
pub(super) struct MeshJson {
    pub(super) primitives: Vec<PrimitiveJson>,
}

#[derive(Debug, Deserialize)]
pub(super) struct PrimitiveJson {
    #[serde(default)]
    pub(super) attributes: BTreeMap<String, u32>,
    #[serde(default)]
    pub(super) extensions: Option<Box<PrimitiveExtensions>>,
}

/// Extensions of a primitive: splats, and two drafts that stood beside them.
#[derive(Debug, Deserialize)]
pub(super) struct PrimitiveExtensions {
    #[serde(rename = "KHR_gaussian_splatting")]
    pub(super) splats: Option<SplatsJson>,
    #[serde(flatten)]
    pub(super) payloads: PayloadsJson,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SplatsJson {
    pub(super) kernel: Option<String>,
    pub(super) color_space: Option<String>,
    pub(super) projection: Option<String>,
    pub(super) sorting_method: Option<String>,
    #[serde(default)]
    pub(super) extensions: PayloadsJson,
}

/// Compressed forms by name: four of SPZ, and others.
#[derive(Debug, Default, Deserialize)]
pub(super) struct PayloadsJson {
    #[serde(rename = "KHR_gaussian_splatting_compression_spz_2")]
    spz_2: Option<PayloadJson>,
    #[serde(rename = "KHR_gaussian_splatting_compression_spz")]
    spz: Option<PayloadJson>,
    #[serde(rename = "KHR_spz_gaussian_splats_compression")]
    spz_splats: Option<PayloadJson>,
    #[serde(rename = "KHR_spz_compression")]
    spz_first: Option<PayloadJson>,
    #[serde(flatten)]
    pub(super) others: BTreeMap<String, IgnoredAny>,
}

/// Extensions that a document may require.
pub(super) const KNOWN: [&str; 6] = [
    super::EXTENSION,
    "KHR_mesh_quantization",
    "KHR_gaussian_splatting_compression_spz_2",
    "KHR_gaussian_splatting_compression_spz",
    "KHR_spz_gaussian_splats_compression",
    "KHR_spz_compression",
];

impl PayloadsJson {
    /// Buffer view of the SPZ file, if there is one.
    pub(super) fn spz(&self) -> Option<u32> {
        let all = [&self.spz_2, &self.spz, &self.spz_splats, &self.spz_first];
        all.into_iter().flatten().map(|payload| payload.buffer_view).next()
    }
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct PayloadJson {
    buffer_view: u32,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct AccessorJson {
    pub(super) buffer_view: Option<u32>,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) component_type: u32,
    #[serde(default)]
    pub(super) normalized: bool,
    pub(super) count: u64,
    #[serde(rename = "type")]
    pub(super) shape: ShapeJson,
    pub(super) sparse: Option<Box<SparseJson>>,
}

/// Shape of an element.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "UPPERCASE")]
pub(super) enum ShapeJson {
    Scalar,
    Vec2,
    Vec3,
    Vec4,
    Mat2,
    Mat3,
    Mat4,
}

#[derive(Debug, Deserialize)]
pub(super) struct SparseJson {
    pub(super) count: u64,
    pub(super) indices: SparsePartJson,
    pub(super) values: SparsePartJson,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparsePartJson {
    pub(super) buffer_view: u32,
    #[serde(default)]
    pub(super) byte_offset: u64,
    /// Of indices only.
    pub(super) component_type: Option<u32>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct ViewJson {
    pub(super) buffer: u32,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) byte_length: u64,
    pub(super) byte_stride: Option<u64>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferJson {
    pub(super) uri: Option<String>,
    pub(super) byte_length: u64,
}

/// The asset alone, whose version explains why the rest cannot be parsed.
#[derive(Deserialize)]
struct AssetOnly {
    asset: AssetJson,
}

/// Parses and checks version and required extensions.
pub(super) fn parse(text: &[u8]) -> Check<Document> {
    let document = parse_any(text)?;
    let is_foreign = |name: &&String| !KNOWN.contains(&name.as_str());
    if let Some(foreign) = document.extensions_required.iter().find(is_foreign) {
        let name = super::super::reader::excerpt(foreign);
        return Err(format!("requires the extension {name}, which is not supported"));
    }
    Ok(document)
}

/// Parses and checks the version.
pub(super) fn parse_any(text: &[u8]) -> Check<Document> {
    let parsed = serde_json::from_slice::<Document>(text);
    let asset = match &parsed {
        Ok(document) => check_version(&document.asset),
        Err(_) => match serde_json::from_slice::<AssetOnly>(text) {
            Ok(only) => check_version(&only.asset),
            Err(_) => Ok(()),
        },
    };
    asset?;
    parsed.map_err(|e| format!("cannot be parsed as the JSON of glTF: {e}"))
}

fn check_version(asset: &AssetJson) -> Check<()> {
    let version = asset.min_version.as_ref().unwrap_or(&asset.version);
    match version.split('.').next() {
        Some("2") => Ok(()),
        _ => {
            let version = super::super::reader::excerpt(version);
            Err(format!("glTF version {version} is not supported (2.0 is)"))
        }
    }
}

/// Entry of a list at an index from the document.
pub(super) fn entry<'a, T>(list: &'a [T], index: u32, what: &str) -> Check<&'a T> {
    list.get(index as usize)
        .ok_or_else(|| format!("{what} {index} is not there; the document has {}", list.len()))
}
