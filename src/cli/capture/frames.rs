//! Frames of a video: more than wanted are taken, and of each stretch the sharpest is kept.

use super::photographs;
use super::tool::Tool;
use crate::cli::output::Output;
use crate::io::parallel::try_map;
use crate::io::photo;
use crate::{Error, Result};
use rayon::prelude::*;
use std::path::Path;

/// Frames taken for each that is kept.
const TAKEN_PER_KEPT: u32 = 3;

/// Longest side of frames, pixels: more shows little more at the rates of videos.
const SIDE_MAX: u32 = 1920;

/// Takes frames of a video into `images` of a folder.
pub(super) fn extract(ffmpeg: &Tool, video: &Path, out: &Path, wanted: u32, output: Output) -> Result<()> {
    let name = video.to_string_lossy();
    let said = ffmpeg.errors_of(&["-hide_banner", "-i", &name])?;
    let seconds = duration(&said).filter(|_| said.contains("Video:"));
    let seconds = seconds.ok_or_else(|| Error::file(video, "is no video that ffmpeg can read"))?;
    let rate = f64::from(wanted * TAKEN_PER_KEPT) / seconds;
    let taken = out.join("frames");
    for folder in [&taken, &out.join("images")] {
        if folder.is_dir() {
            std::fs::remove_dir_all(folder).map_err(Error::io(folder))?;
        }
        std::fs::create_dir_all(folder).map_err(Error::io(folder))?;
    }
    // No more frames than the video has, and an even height.
    let filter = format!("fps=min(source_fps\\,{rate:.4}),scale='min({SIDE_MAX},iw)':-2");
    ffmpeg
        .command("frames", "-hide_banner")
        .option("-loglevel", "error")
        .path("-i", video)
        .option("-vf", &filter)
        .option("-qscale:v", "2")
        .word(&taken.join("%05d.jpg").to_string_lossy())
        .run(0, out, output)?;
    let names = photographs(&taken)?;
    for (index, name) in sharpest(&taken, &names)?.into_iter().enumerate() {
        let to = out.join("images").join(format!("{:05}.jpg", index + 1));
        std::fs::rename(taken.join(name), &to).map_err(Error::io(&to))?;
    }
    std::fs::remove_dir_all(&taken).map_err(Error::io(&taken))
}

/// Seconds in ffmpeg's "Duration: 00:01:02.50".
fn duration(said: &str) -> Option<f64> {
    let word = said.split("Duration: ").nth(1)?.split(',').next()?;
    let parts: Vec<f64> = word
        .split(':')
        .map(|part| part.trim().parse().ok())
        .collect::<Option<_>>()?;
    let [hours, minutes, seconds] = parts[..] else {
        return None;
    };
    Some(3600.0 * hours + 60.0 * minutes + seconds).filter(|seconds| *seconds > 0.0)
}

/// The sharpest of each stretch of frames.
fn sharpest<'a>(folder: &Path, names: &'a [String]) -> Result<Vec<&'a String>> {
    let scores = try_map(names.par_iter(), |name| Ok(quality(&folder.join(name))?.sharpness))?;
    let stretches = names
        .chunks(TAKEN_PER_KEPT as usize)
        .zip(scores.chunks(TAKEN_PER_KEPT as usize));
    let best = |(names, scores): (&'a [String], &[f64])| {
        let ranked = names.iter().zip(scores);
        ranked.max_by(|a, b| a.1.total_cmp(b.1)).map(|(name, _)| name)
    };
    Ok(stretches.filter_map(best).collect())
}

/// Figures of a photograph that tell why it may be of no use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PhotoQuality {
    /// Variance of the Laplacian of the luminance over 3 × 3 pixels, at a quarter of the size.
    pub(super) sharpness: f64,
    /// Mean luminance, 0 to 1.
    pub(super) brightness: f64,
}

/// Quality of a photograph.
pub(super) fn quality(path: &Path) -> Result<PhotoQuality> {
    let photo = photo::decode(path)?;
    let [width, height] = [photo.width, photo.height].map(|size| (size / 4).max(3));
    let small = photo::reduce(photo, width, height);
    let gray = |[r, g, b, _]: [u8; 4]| 0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b);
    let values: Vec<f64> = small.rgba.iter().map(|&pixel| gray(pixel) / 255.0).collect();
    let (width, height) = (width as usize, height as usize);
    let (mut sum, mut square, mut count) = (0.0, 0.0, 0.0);
    for y in 1..height - 1 {
        for x in 1..width - 1 {
            let at = y * width + x;
            let around = values[at - 1] + values[at + 1] + values[at - width] + values[at + width];
            let edge = around - 4.0 * values[at];
            sum += edge;
            square += edge * edge;
            count += 1.0;
        }
    }
    Ok(PhotoQuality {
        sharpness: square / count - (sum / count).powi(2),
        brightness: values.iter().sum::<f64>() / values.len() as f64,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_read_from_what_ffmpeg_says() {
        let said = "  Duration: 00:01:02.50, start: 0.000000, bitrate: 1 kb/s\n  Stream #0:0: Video: h264";
        assert_eq!(duration(said), Some(62.5));
        assert_eq!(duration("  Duration: N/A, start: 0"), None);
        assert_eq!(duration("no such file"), None);
    }
}
