//! Attributes of a primitive: its splats, row by row.

use super::super::check::Check;
use super::super::loaded::logit;
use super::EXTENSION;
use super::accessor::{AccessorRows, Component, ComponentKind};
use super::buffers::Buffers;
use super::json::{Document, PrimitiveJson, ShapeJson};
use super::placement::LocalSplat;
use crate::scene::{SH_C0, Splats};
use glam::DVec3;

const FLOAT: ComponentKind = (Component::F32, false);

/// Splats of a primitive: decoded from attributes as they are asked for, or unpacked.
pub(super) enum PrimitiveSplats<'a> {
    Attributes(Box<Attributes<'a>>),
    Unpacked(Box<Splats>),
}

/// Columns of a primitive's splats.
pub(super) struct Attributes<'a> {
    position: AccessorRows<'a>,
    rotation: AccessorRows<'a>,
    scale: AccessorRows<'a>,
    color: SplatColor<'a>,
    /// Coefficients from degree 1 on.
    harmonics: Vec<AccessorRows<'a>>,
}

/// Opacity and constant coefficient.
enum SplatColor<'a> {
    Own {
        opacity: AccessorRows<'a>,
        constant: AccessorRows<'a>,
    },
    /// Displayed colour and opacity, in drafts.
    Fallback(AccessorRows<'a>),
}

/// Opacity and harmonics of a splat.
pub(super) struct Look {
    pub(super) opacity_logit: f32,
    /// Whether the opacity was not between 0 and 1.
    pub(super) is_clamped: bool,
}

/// The accessor of an attribute under its name, or that of drafts.
fn find(primitive: &PrimitiveJson, name: &str) -> Option<u32> {
    let named = |name: String| primitive.attributes.get(&name).copied();
    named(format!("{EXTENSION}:{name}")).or_else(|| named(format!("_{name}")))
}

/// Whether a primitive has harmonics above degree 3.
pub(super) fn is_beyond_degree_3(primitive: &PrimitiveJson) -> bool {
    (4..10).any(|degree| find(primitive, &format!("SH_DEGREE_{degree}_COEF_0")).is_some())
}

/// Opens the positions alone, whose count is that of all attributes.
pub(super) fn position<'a>(
    document: &Document,
    buffers: &'a Buffers,
    primitive: &PrimitiveJson,
) -> Check<AccessorRows<'a>> {
    let index = primitive
        .attributes
        .get("POSITION")
        .ok_or("the attribute POSITION is missing")?;
    let mut kinds = vec![FLOAT];
    if document
        .extensions_used
        .iter()
        .any(|name| name == "KHR_mesh_quantization")
    {
        let integers = [Component::I8, Component::U8, Component::I16, Component::U16];
        kinds.extend(
            integers
                .iter()
                .flat_map(|&component| [(component, false), (component, true)]),
        );
    }
    AccessorRows::open(document, buffers, *index, &[ShapeJson::Vec3], &kinds)
        .map_err(|what| format!("POSITION: {what}"))
}

impl<'a> Attributes<'a> {
    /// Opens the other attributes; every one must have as many rows as there are positions.
    pub(super) fn open(
        document: &Document,
        buffers: &'a Buffers,
        primitive: &PrimitiveJson,
        position: AccessorRows<'a>,
    ) -> Check<Attributes<'a>> {
        let count = position.count();
        let open = |name: &str, index: u32, shapes: &[ShapeJson], kinds: &[ComponentKind]| {
            let column = AccessorRows::open(document, buffers, index, shapes, kinds)
                .map_err(|what| format!("{name}: {what}"))?;
            match column.count() == count {
                true => Ok(column),
                false => Err(format!("{name} has {} rows, but POSITION {count}", column.count())),
            }
        };
        let wanted = |name: &str, shape: ShapeJson, kinds: &[ComponentKind]| {
            let index = find(primitive, name).ok_or_else(|| format!("the attribute {EXTENSION}:{name} is missing"))?;
            open(name, index, &[shape], kinds)
        };
        let rotations = [FLOAT, (Component::I8, true), (Component::I16, true)];
        let shares = [FLOAT, (Component::U8, true), (Component::U16, true)];
        let scales = [shares.as_slice(), &[(Component::U8, false), (Component::U16, false)]].concat();
        let constant = "SH_DEGREE_0_COEF_0";
        let has_none = find(primitive, "OPACITY").is_none() && find(primitive, constant).is_none();
        let color = match primitive.attributes.get("COLOR_0") {
            Some(&index) if has_none => {
                let shapes = [ShapeJson::Vec4, ShapeJson::Vec3];
                SplatColor::Fallback(open("COLOR_0", index, &shapes, &shares)?)
            }
            _ => SplatColor::Own {
                opacity: wanted("OPACITY", ShapeJson::Scalar, &shares)?,
                constant: wanted(constant, ShapeJson::Vec3, &[FLOAT])?,
            },
        };
        let names = (1..=3).flat_map(|degree| (0..=2 * degree).map(move |n| format!("SH_DEGREE_{degree}_COEF_{n}")));
        let names: Vec<String> = names.collect();
        let degree = (1..=3usize).rev().find(|l| {
            let of_degree = &names[l * l - 1..(l + 1) * (l + 1) - 1];
            of_degree.iter().any(|name| find(primitive, name).is_some())
        });
        let coefficients = degree.map_or(0, |l| (l + 1) * (l + 1) - 1);
        let harmonics = names[..coefficients]
            .iter()
            .map(|name| wanted(name, ShapeJson::Vec3, &[FLOAT]));
        Ok(Attributes {
            rotation: wanted("ROTATION", ShapeJson::Vec4, &rotations)?,
            scale: wanted("SCALE", ShapeJson::Vec3, &scales)?,
            color,
            harmonics: harmonics.collect::<Check<_>>()?,
            position,
        })
    }

    fn splat(&self, index: usize) -> LocalSplat {
        let [x, y, z, w] = self.rotation.row(index);
        LocalSplat {
            mean: DVec3::from(self.position.three(index).map(f64::from)),
            quaternion: [w, x, y, z],
            log_scale: DVec3::from(self.scale.three(index).map(|scale| f64::from(scale).ln())),
        }
    }

    fn look(&self, index: usize, sh: &mut [f32]) -> Look {
        let opacity = match &self.color {
            SplatColor::Own { opacity, constant } => {
                sh[..3].copy_from_slice(&constant.three(index));
                opacity.row(index)[0]
            }
            SplatColor::Fallback(color) => {
                let [r, g, b, opacity] = color.row(index);
                sh[..3].copy_from_slice(&[r, g, b].map(|c| (c - 0.5) / SH_C0));
                opacity
            }
        };
        for (values, column) in sh[3..].chunks_exact_mut(3).zip(&self.harmonics) {
            values.copy_from_slice(&column.three(index));
        }
        Look {
            opacity_logit: logit(opacity.clamp(0.0, 1.0)),
            is_clamped: !(0.0..=1.0).contains(&opacity) && !opacity.is_nan(),
        }
    }
}

impl PrimitiveSplats<'_> {
    /// Number of splats.
    pub(super) fn count(&self) -> u64 {
        match self {
            PrimitiveSplats::Attributes(attributes) => attributes.position.count(),
            PrimitiveSplats::Unpacked(splats) => splats.len() as u64,
        }
    }

    /// Degree of the harmonics.
    pub(super) fn sh_degree(&self) -> u32 {
        match self {
            // 0, 3, 8 or 15 coefficients.
            PrimitiveSplats::Attributes(attributes) => (attributes.harmonics.len() + 1).isqrt() as u32 - 1,
            PrimitiveSplats::Unpacked(splats) => splats.sh_degree,
        }
    }

    /// Place and shape of a splat.
    pub(super) fn splat(&self, index: usize) -> LocalSplat {
        match self {
            PrimitiveSplats::Attributes(attributes) => attributes.splat(index),
            PrimitiveSplats::Unpacked(splats) => LocalSplat {
                mean: DVec3::from(splats.mean[index].map(f64::from)),
                quaternion: splats.quaternion[index],
                log_scale: DVec3::from(splats.log_scale[index].map(f64::from)),
            },
        }
    }

    /// Opacity of a splat; its harmonics at the start of `sh`, whose rest is unchanged.
    pub(super) fn look(&self, index: usize, sh: &mut [f32]) -> Look {
        match self {
            PrimitiveSplats::Attributes(attributes) => attributes.look(index, sh),
            PrimitiveSplats::Unpacked(splats) => {
                let stride = splats.sh_stride();
                sh[..stride].copy_from_slice(&splats.sh[index * stride..][..stride]);
                Look {
                    opacity_logit: splats.opacity_logit[index],
                    is_clamped: false,
                }
            }
        }
    }
}
