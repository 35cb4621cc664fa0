//! Page of the curve of an export: bytes against errors of pictures, for every format and setting.

use crate::export::PictureError;
use crate::lab::page::scatter::{Marker, ScatterPlot};
use crate::lab::page::{self, Fact, decimals, distinct, document, grouped, legend, table};
use crate::{Error, Result};

/// A file of the scene and the error of its pictures.
#[derive(Clone, Debug, PartialEq)]
pub struct CurvePoint {
    /// Format, or writer of a file that was given.
    pub series: String,
    /// Setting of the format, or name of the file.
    pub setting: String,
    /// Length of the file.
    pub bytes: u64,
    /// Error against the original's pictures.
    pub error: PictureError,
    /// Whether the file was given.
    pub is_given: bool,
}

/// Columns of the CSV.
const COLUMNS: [&str; 10] = [
    "series",
    "setting",
    "given",
    "bytes",
    "bytes_per_splat",
    "psnr_db",
    "ssim",
    "largest",
    "photo_psnr_change_db",
    "photo_ssim_change",
];

/// The curve as CSV.
///
/// # Errors
/// When a row cannot be written.
pub fn csv(points: &[CurvePoint], splats: usize) -> Result<Vec<u8>> {
    let mut writer = csv::WriterBuilder::new()
        .quote_style(csv::QuoteStyle::NonNumeric)
        .from_writer(Vec::new());
    let failed = |error: &dyn std::fmt::Display| Error::Config(format!("CSV: {error}"));
    writer.write_record(COLUMNS).map_err(|e| failed(&e))?;
    for point in points {
        let error = &point.error;
        let against = |i: usize| error.against_photos.map_or(String::new(), |c| format!("{:.4}", c[i]));
        let row = [
            point.series.clone(),
            point.setting.clone(),
            point.is_given.to_string(),
            point.bytes.to_string(),
            format!("{:.3}", point.bytes as f64 / splats.max(1) as f64),
            format!("{:.3}", error.psnr_db()),
            format!("{:.5}", error.ssim),
            format!("{:.4}", error.largest),
            against(0),
            against(1),
        ];
        writer.write_record(row).map_err(|e| failed(&e))?;
    }
    writer.into_inner().map_err(|e| failed(&e))
}

/// The page's text.
///
/// # Errors
/// When a figure cannot be drawn.
pub fn html(points: &[CurvePoint], splats: usize, facts: &[Fact]) -> Result<String> {
    let names = distinct(points.iter().map(|point| point.series.as_str()));
    let series = names.iter().enumerate().map(|(i, name)| (i, *name));
    let mut body = format!(
        "<h1>Bytes against error</h1>\n{}{}",
        page::facts(facts),
        legend(series)?
    );
    let markers = |value: fn(&PictureError) -> f64, unit: f64| -> Vec<Marker> {
        let marker = |point: &CurvePoint| Marker {
            series: names.iter().position(|name| *name == point.series).unwrap_or(0),
            x: point.bytes as f64 / unit,
            y: value(&point.error),
            is_hollow: point.is_given,
            ..Marker::default()
        };
        points
            .iter()
            .map(marker)
            .filter(|marker| marker.y.is_finite())
            .collect()
    };
    for (title, is_log, value) in FIGURES {
        let plot = figure(["bytes", title], [true, is_log], markers(value, 1.0));
        body += &page::figure("wide", &plot.svg()?, "");
    }
    let original = points
        .iter()
        .find(|point| point.series == "ply")
        .map_or(1, |point| point.bytes);
    let mut against = markers(photo_change_db, original as f64 / 100.0);
    if !against.is_empty() {
        against.extend(published(names.len()));
        let titles = [
            "% of the bytes of the .ply",
            "PSNR against photographs, minus the original's, dB",
        ];
        body += &page::figure("wide", &figure(titles, [true, false], against).svg()?, PUBLISHED_NOTE);
    }
    body += &rows(points, splats);
    Ok(document("export", &body))
}

fn figure(titles: [&'static str; 2], are_log: [bool; 2], markers: Vec<Marker>) -> ScatterPlot {
    ScatterPlot {
        size: [720, 420],
        titles,
        are_log,
        markers,
        are_courses: true,
        ..ScatterPlot::default()
    }
}

/// Title, true for a logarithmic axis, and value of a figure.
type Figure = (&'static str, bool, fn(&PictureError) -> f64);

const FIGURES: [Figure; 3] = [
    ("PSNR against the original's pictures, dB", false, PictureError::psnr_db),
    ("SSIM against the original's pictures", false, |e| e.ssim),
    ("largest difference of a channel", true, |e| e.largest),
];

fn photo_change_db(error: &PictureError) -> f64 {
    error.against_photos.map_or(f64::NAN, |change| change[0])
}

/// Published means over the nine scenes of Mip-NeRF 360: method, PSNR in decibels and megabytes.
const PUBLISHED: [(&str, f64, f64); 12] = [
    ("HAC++", 27.60, 8.7),
    ("HAC++", 27.82, 19.4),
    ("HEMGS", 27.75, 12.5),
    ("HEMGS", 27.93, 21.0),
    ("ContextGS", 27.62, 13.3),
    ("CodecGS", 27.30, 10.3),
    ("FCGS", 27.05, 36.3),
    ("FCGS", 27.39, 67.2),
    ("RDO-Gaussian", 27.05, 23.5),
    ("MesonGS", 26.99, 25.9),
    ("LightGaussian", 27.28, 42.0),
    ("Self-Organizing Gaussians", 27.08, 40.3),
];

/// 3DGS in the same survey: PSNR in decibels and megabytes.
const PUBLISHED_3DGS: [f64; 2] = [27.21, 734.0];

const PUBLISHED_NOTE: &str = "Hollow: given files, and, by name, published means over the nine scenes of Mip-NeRF 360 \
    against 3DGS there (27.21 dB, 734 MB; 3DGS compression survey, April 2025). All of these but FCGS train for their \
    size, and most need decoders of their own.";

/// Markers of the published means, series from `first` on.
fn published(first: usize) -> impl Iterator<Item = Marker> {
    let [psnr_db, megabytes] = PUBLISHED_3DGS;
    let series = |name: &str| PUBLISHED.iter().position(|(other, ..)| *other == name).unwrap_or(0);
    PUBLISHED.iter().map(move |(name, psnr, size)| Marker {
        series: first + series(name),
        text: (*name).to_owned(),
        x: 100.0 * size / megabytes,
        y: psnr - psnr_db,
        is_hollow: true,
        ..Marker::default()
    })
}

fn rows(points: &[CurvePoint], splats: usize) -> String {
    let head = [
        "format",
        "setting",
        "bytes",
        "bytes a splat",
        "PSNR, dB",
        "SSIM",
        "largest",
        "photographs: dB",
        "SSIM",
    ];
    let row = |point: &CurvePoint| {
        let error = &point.error;
        let against = |i: usize, digits| decimals(error.against_photos.map(|change| change[i]), digits);
        let cells = vec![
            point.series.clone(),
            point.setting.clone(),
            grouped(point.bytes as usize),
            format!("{:.2}", point.bytes as f64 / splats.max(1) as f64),
            format!("{:.2}", error.psnr_db()),
            format!("{:.4}", error.ssim),
            format!("{:.3}", error.largest),
            against(0, 3),
            against(1, 4),
        ];
        (false, cells)
    };
    table("numbers", &head, points.iter().map(row))
}
