//! Uncompressed video for other programs: YUV4MPEG2 and bare RGB frames.
//!
//! YUV4MPEG2: 4:4:4, 8 bits, BT.709, limited range. Y = 16 + 219 (0.2126 R + 0.7152 G + 0.0722 B), Cb = 128 + 224 (B −
//! Y') / 1.8556, Cr = 128 + 224 (R − Y') / 1.5748, of values from 0 to 1. Bare frames: red, green and blue bytes, row
//! by row.

use super::png::to_byte;
use std::io::{Result, Write};

/// Layout of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VideoLayout {
    /// YUV4MPEG2.
    Y4m,
    /// Bare RGB.
    Rgb24,
}

/// Writer of frames of one size.
#[derive(Debug)]
pub struct VideoWriter<W: Write> {
    out: W,
    layout: VideoLayout,
    pixels: usize,
    bytes: Vec<u8>,
}

impl<W: Write> VideoWriter<W> {
    /// Writes the header, if the layout has one. `rate` is in frames a second, of which a bare stream tells nothing.
    pub fn new(mut out: W, layout: VideoLayout, [width, height]: [u32; 2], rate: f64) -> Result<VideoWriter<W>> {
        if layout == VideoLayout::Y4m {
            let [over, under] = ratio(rate);
            let header = "Ip A1:1 C444 XCOLORRANGE=LIMITED";
            writeln!(out, "YUV4MPEG2 W{width} H{height} F{over}:{under} {header}")?;
        }
        Ok(VideoWriter {
            out,
            layout,
            pixels: width as usize * height as usize,
            bytes: Vec::new(),
        })
    }

    /// Writes a frame of display-referred colours `[row][column]`, clamped to 0 to 1, and flushes it.
    ///
    /// # Panics
    /// If the number of pixels is not the stream's.
    pub fn frame(&mut self, rgb: &[[f32; 3]]) -> Result<()> {
        assert_eq!(rgb.len(), self.pixels, "as many pixels as the stream has");
        self.bytes.clear();
        match self.layout {
            VideoLayout::Rgb24 => self.bytes.extend(rgb.as_flattened().iter().map(|v| to_byte(*v))),
            VideoLayout::Y4m => {
                self.bytes.extend(b"FRAME\n");
                for plane in 0..3 {
                    self.bytes
                        .extend(rgb.iter().map(|pixel| luma_and_chroma(*pixel)[plane]));
                }
            }
        }
        self.out.write_all(&self.bytes)?;
        self.out.flush()
    }
}

/// Y, Cb and Cr of a colour.
fn luma_and_chroma(rgb: [f32; 3]) -> [u8; 3] {
    // NaN is 0, as in pictures.
    let [r, g, b] = rgb.map(|v| if v.is_nan() { 0.0 } else { f64::from(v.clamp(0.0, 1.0)) });
    let luma = 0.2126 * r + 0.7152 * g + 0.0722 * b;
    let chroma = |v: f64, range: f64| 128.0 + 224.0 * (v - luma) / range;
    [16.0 + 219.0 * luma, chroma(b, 1.8556), chroma(r, 1.5748)].map(|v| v.round() as u8)
}

/// A rate as a ratio: whole, over 1001 as in television, or in thousandths.
fn ratio(rate: f64) -> [u64; 2] {
    let is_whole = |value: f64| (value - value.round()).abs() < 1e-6 * value;
    let television = (rate * 1.001).round() * 1000.0;
    match () {
        () if is_whole(rate) => [rate.round() as u64, 1],
        () if (television / 1001.0 - rate).abs() < 1e-3 * rate => [television as u64, 1001],
        () => [(rate * 1000.0).round().max(1.0) as u64, 1000],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_ratios() {
        let rates = [24.0, 30.0, 29.97, 23.976, 59.94, 12.5, 0.1, 1000.0];
        let ratios = [
            [24, 1],
            [30, 1],
            [30_000, 1001],
            [24_000, 1001],
            [60_000, 1001],
            [12_500, 1000],
            [100, 1000],
            [1000, 1],
        ];
        assert_eq!(rates.map(ratio), ratios);
    }

    #[test]
    fn colours_are_those_of_bt_709() {
        let black = luma_and_chroma([0.0, -1.0, f32::NAN]);
        assert_eq!(
            (black, luma_and_chroma([1.0, 2.0, 1.0])),
            ([16, 128, 128], [235, 128, 128])
        );
        // ITU-R BT.709, table of full colour bars.
        assert_eq!(luma_and_chroma([1.0, 0.0, 0.0]), [63, 102, 240]);
        assert_eq!(luma_and_chroma([0.0, 1.0, 0.0]), [173, 42, 26]);
        assert_eq!(luma_and_chroma([0.0, 0.0, 1.0]), [32, 240, 118]);
    }

    #[test]
    fn frames_follow_the_header() {
        let pixels = [[0.0, 0.5, 1.0], [1.0, 0.0, 0.0]];
        let mut stream = Vec::new();
        let mut writer = VideoWriter::new(&mut stream, VideoLayout::Y4m, [2, 1], 25.0).unwrap();
        writer.frame(&pixels).unwrap();
        writer.frame(&pixels).unwrap();
        let header = b"YUV4MPEG2 W2 H1 F25:1 Ip A1:1 C444 XCOLORRANGE=LIMITED\n";
        let planes = pixels.map(luma_and_chroma);
        let frame: Vec<u8> = b"FRAME\n"
            .iter()
            .copied()
            .chain((0..3).flat_map(|i| planes.map(|p| p[i])))
            .collect();
        assert_eq!(stream, [&header[..], &frame, &frame].concat());
        let mut bare = Vec::new();
        let mut writer = VideoWriter::new(&mut bare, VideoLayout::Rgb24, [2, 1], 25.0).unwrap();
        writer.frame(&pixels).unwrap();
        assert_eq!(bare, [0, 128, 255, 255, 0, 0]);
    }
}
