//! `meta.json` of versions 1 and 2.

use super::super::check::Check;
use super::super::reader::excerpt;
use super::codes::{SogCodes, Tables, opacity_logits};
use crate::scene::ScreenFilter;
use serde::Deserialize;
use serde_json::json;

/// Names of the images in files that are written, in their order.
pub(super) const NAMES: [&str; 7] = [
    "means_l.webp",
    "means_u.webp",
    "quats.webp",
    "scales.webp",
    "sh0.webp",
    "shN_centroids.webp",
    "shN_labels.webp",
];

/// Contents of either version.
pub(super) struct Meta {
    /// `SOG 1` or `SOG 2`.
    pub(super) format: &'static str,
    pub(super) count: u64,
    pub(super) filter: ScreenFilter,
    /// Names of the images in the order of [`NAMES`], without the last two if there are no harmonics.
    pub(super) names: Vec<String>,
    pub(super) tables: Tables,
    pub(super) palette: Option<PaletteMeta>,
    /// Repairs, without the file's name.
    pub(super) warnings: Vec<String>,
}

/// Part about the harmonics of degree 1 and up.
pub(super) struct PaletteMeta {
    /// `None` if only the width of the image tells it.
    pub(super) sh_degree: Option<u32>,
    /// Coefficients by code.
    pub(super) table: Vec<f32>,
}

#[derive(Deserialize)]
struct Head {
    version: Option<f64>,
    model: Option<String>,
    #[serde(default)]
    antialias: bool,
}

#[derive(Deserialize)]
struct ImageNames {
    files: [String; 1],
}

#[derive(Deserialize)]
struct Means {
    /// Version 1 only.
    shape: Option<Vec<u64>>,
    mins: [f64; 3],
    maxs: [f64; 3],
    files: [String; 2],
}

#[derive(Deserialize)]
struct Version2 {
    count: u64,
    means: Means,
    scales: CodebookImages,
    quats: ImageNames,
    sh0: CodebookImages,
    #[serde(rename = "shN")]
    palette: Option<CodebookPalette>,
}

#[derive(Deserialize)]
struct CodebookImages {
    codebook: Vec<Option<f32>>,
    files: [String; 1],
}

#[derive(Deserialize)]
struct CodebookPalette {
    bands: u32,
    codebook: Vec<Option<f32>>,
    files: [String; 2],
}

#[derive(Deserialize)]
struct Version1 {
    means: Means,
    scales: LinearImages<[f64; 3]>,
    quats: ImageNames,
    sh0: LinearImages<[f64; 4]>,
    #[serde(rename = "shN")]
    palette: Option<LinearPalette>,
}

#[derive(Deserialize)]
struct LinearImages<T> {
    mins: T,
    maxs: T,
    files: [String; 1],
}

#[derive(Deserialize)]
struct LinearPalette {
    mins: f64,
    maxs: f64,
    files: [String; 2],
}

impl Meta {
    /// Parses a `meta.json`; an error says what is wrong with it.
    pub(super) fn parse(bytes: &[u8]) -> Check<Meta> {
        let said = |e: serde_json::Error| format!("cannot be parsed as JSON of a SOG scene: {e}");
        let head: Head = serde_json::from_slice(bytes).map_err(said)?;
        let filter = match head.model.as_deref() {
            Some("antialiased") => ScreenFilter::Mip,
            Some("2dgs") => return Err("the model is 2dgs: 2D Gaussian scenes are not supported".into()),
            _ if head.antialias => ScreenFilter::Mip,
            _ => ScreenFilter::Classic,
        };
        let mut meta = match head.version {
            Some(2.0) => version2(serde_json::from_slice(bytes).map_err(said)?)?,
            None | Some(1.0) => version1(serde_json::from_slice(bytes).map_err(said)?)?,
            Some(other) => return Err(format!("the version is {other}; 1 and 2 can be read")),
        };
        if let Some(model) = head
            .model
            .filter(|m| !["antialiased", "default", "3dgs"].contains(&m.as_str()))
        {
            let model = excerpt(&model);
            meta.warnings.push(format!("unknown model {model} taken for default"));
        }
        meta.filter = filter;
        Ok(meta)
    }
}

fn version2(meta: Version2) -> Check<Meta> {
    let mut warnings = Vec::new();
    let mut codebook = |name: &str, values: Vec<Option<f32>>| {
        let (values, repair) = sound_codebook(name, values)?;
        warnings.extend(repair);
        Ok::<_, String>(values)
    };
    let scale = codebook("scales", meta.scales.codebook)?;
    let color = codebook("sh0", meta.sh0.codebook)?;
    let mut names = image_names(meta.means.files, meta.quats.files, meta.scales.files, meta.sh0.files);
    let palette = match meta.palette {
        Some(CodebookPalette {
            bands,
            codebook: values,
            files,
        }) => {
            if !(1..=3).contains(&bands) {
                return Err(format!("shN has {bands} bands; 1 to 3 are possible"));
            }
            names.extend(files);
            Some(PaletteMeta {
                sh_degree: Some(bands),
                table: codebook("shN", values)?,
            })
        }
        None => None,
    };
    let tables = Tables {
        mean_min: meta.means.mins,
        mean_max: meta.means.maxs,
        scale: [(); 3].map(|()| scale.clone()),
        color: [(); 3].map(|()| color.clone()),
        opacity_logit: opacity_logits(),
    };
    Ok(Meta {
        format: "SOG 2",
        count: meta.count,
        filter: ScreenFilter::Classic,
        names,
        tables,
        palette,
        warnings,
    })
}

fn version1(meta: Version1) -> Check<Meta> {
    let count = meta.means.shape.as_deref().and_then(|shape| shape.first());
    let count = *count.ok_or("has neither a version nor a shape of means, the count of version 1")?;
    let table = |min: f64, max: f64| -> Vec<f32> {
        let value = |code: u8| min + (max - min) * (f64::from(code) / 255.0);
        (0..=255).map(|code| value(code) as f32).collect()
    };
    let (scales, sh0) = (&meta.scales, &meta.sh0);
    let tables = Tables {
        mean_min: meta.means.mins,
        mean_max: meta.means.maxs,
        scale: [0, 1, 2].map(|axis| table(scales.mins[axis], scales.maxs[axis])),
        color: [0, 1, 2].map(|channel| table(sh0.mins[channel], sh0.maxs[channel])),
        opacity_logit: table(sh0.mins[3], sh0.maxs[3]),
    };
    let mut names = image_names(meta.means.files, meta.quats.files, meta.scales.files, meta.sh0.files);
    let palette = meta.palette.map(|linear| {
        names.extend(linear.files);
        PaletteMeta {
            sh_degree: None,
            table: table(linear.mins, linear.maxs),
        }
    });
    Ok(Meta {
        format: "SOG 1",
        count,
        filter: ScreenFilter::Classic,
        names,
        tables,
        palette,
        warnings: Vec::new(),
    })
}

fn image_names(means: [String; 2], quats: [String; 1], scales: [String; 1], sh0: [String; 1]) -> Vec<String> {
    means.into_iter().chain(quats).chain(scales).chain(sh0).collect()
}

/// Values of a codebook, with the repair of a fault of early splat-transform versions: the first value may be null, and
/// is then extrapolated from the others as the PlayCanvas engine does.
fn sound_codebook(name: &str, values: Vec<Option<f32>>) -> Check<(Vec<f32>, Option<String>)> {
    let mut repair = None;
    let mut sound = Vec::with_capacity(values.len());
    for (i, value) in values.iter().enumerate() {
        sound.push(match (value, values.get(1), values.last()) {
            (Some(value), ..) => *value,
            (None, Some(Some(second)), Some(Some(last))) if i == 0 => {
                repair = Some(format!(
                    "the first value of the codebook of {name} is null and was extrapolated"
                ));
                second + (second - last) / 255.0
            }
            (None, ..) => return Err(format!("value {i} of the codebook of {name} is null")),
        });
    }
    Ok((sound, repair))
}

/// `meta.json` of codes, in version 2.
pub(super) fn text(codes: &SogCodes) -> String {
    let name = |range: std::ops::Range<usize>| &NAMES[range];
    let mut meta = json!({
        "version": 2,
        "asset": { "generator": concat!("ashfall ", env!("CARGO_PKG_VERSION")) },
        "count": codes.len(),
        "means": { "mins": codes.mean_min, "maxs": codes.mean_max, "files": name(0..2) },
        "quats": { "files": name(2..3) },
        "scales": { "codebook": shortest(&codes.scale_codebook), "files": name(3..4) },
        "sh0": { "codebook": shortest(&codes.color_codebook), "files": name(4..5) },
    });
    if codes.filter == ScreenFilter::Mip {
        meta["model"] = "antialiased".into();
        meta["antialias"] = true.into();
    }
    if let Some(palette) = &codes.palette {
        meta["shN"] = json!({
            "count": palette.entries(),
            "bands": palette.sh_degree,
            "codebook": shortest(&palette.codebook),
            "files": name(5..7),
        });
    }
    meta.to_string()
}

/// Numbers of the shortest decimal form that reads as the same single-precision values; 256, as readers expect, by
/// repetition of the last.
fn shortest(values: &[f32]) -> Vec<f64> {
    let parsed = |value: &f32| value.to_string().parse().unwrap_or(f64::from(*value));
    let mut numbers: Vec<f64> = values.iter().map(parsed).collect();
    numbers.resize(256, numbers.last().copied().unwrap_or_default());
    numbers
}
