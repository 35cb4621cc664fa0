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
    for (title, is_log, value) in FIGURES {
        let markers = points.iter().map(|point| Marker {
            series: names.iter().position(|name| *name == point.series).unwrap_or(0),
            x: point.bytes as f64,
            y: value(&point.error),
            is_hollow: point.is_given,
            ..Marker::default()
        });
        let plot = ScatterPlot {
            size: [720, 420],
            titles: ["bytes", title],
            are_log: [true, is_log],
            markers: markers.filter(|m| m.y.is_finite()).collect(),
            are_courses: true,
            ..ScatterPlot::default()
        };
        if !plot.markers.is_empty() {
            body += &page::figure("wide", &plot.svg()?, "");
        }
    }
    body += &rows(points, splats);
    Ok(document("export", &body))
}

/// Title, true for a logarithmic axis, and value of a figure.
type Figure = (&'static str, bool, fn(&PictureError) -> f64);

const FIGURES: [Figure; 4] = [
    ("PSNR against the original's pictures, dB", false, PictureError::psnr_db),
    ("SSIM against the original's pictures", false, |e| e.ssim),
    ("largest difference of a channel", true, |e| e.largest),
    ("PSNR against photographs, minus the original's, dB", false, |e| {
        e.against_photos.map_or(f64::NAN, |change| change[0])
    }),
];

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
