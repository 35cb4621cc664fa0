//! What a run will take of the device's memory, in words: for `ashfall info --predict` and before training.

use super::output::{bytes, grouped};
use super::train::ConfigArgs;
use crate::render::{
    Blocks, ByDegree, Capacity, Need, Outputs, Purpose, Slots, frame_needs, index_needs,
    isects_expected, model_needs, of_degree, total,
};
use crate::scene::{Dataset, Splats};
use crate::train::{Residency, TrainConfig, TrainSize, splats_expected};
use crate::{Error, Result};
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write;

/// What is to be predicted.
#[derive(Clone, Debug, Default, PartialEq, Args)]
#[command(next_help_heading = "Prediction")]
pub(super) struct PredictArgs {
    /// Say what device memory training takes, buffer by buffer: on the data set at PATH, or on --photos
    /// photographs of --size. Of a scene at PATH, or without photographs: what drawing it takes
    #[arg(long)]
    pub predict: bool,
    /// Splats [default: as many as the strategy leads to, where that can be known; else those it begins with]
    #[arg(long, value_name = "N", requires = "predict")]
    pub splats: Option<usize>,
    /// Size of the pictures [default: the data set's, or 1920x1080]
    #[arg(long, value_name = "WxH", requires = "predict", value_parser = parse_image_size)]
    pub size: Option<[u32; 2]>,
    /// Photographs trained on [default: the data set's, or none: only drawing]
    #[arg(long, value_name = "N", requires = "predict")]
    pub photos: Option<usize>,
    /// (Splat, tile) pairs of a frame [default: what scenes of so many splats at such a size usually have]
    #[arg(long, value_name = "N", requires = "predict")]
    pub isects: Option<usize>,
}

/// Splats where nothing says how many.
const SPLATS: usize = 100_000;
/// Size where nothing says which.
const SIZE: [u32; 2] = [1920, 1080];

/// Longest side of a picture that a size may name.
const SIDE_MAX: u32 = 1 << 15;

/// `1920x1080`.
pub(super) fn parse_image_size(text: &str) -> std::result::Result<[u32; 2], String> {
    let side = |text: &str| text.trim().parse::<u32>().ok();
    let sides = text.split_once(['x', 'X', '×']);
    match sides.map(|(width, height)| (side(width), side(height))) {
        Some((Some(width), Some(height)))
            if (1..=SIDE_MAX).contains(&width) && (1..=SIDE_MAX).contains(&height) =>
        {
            Ok([width, height])
        }
        _ => Err(format!(
            "a size is WIDTHxHEIGHT in pixels, 1 to {SIDE_MAX} each"
        )),
    }
}

/// What something will take of the device's memory.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Prediction {
    /// What it is, in words.
    what: String,
    /// Buffer by buffer.
    needs: Vec<Need>,
    /// Bytes without which it cannot be done, where that is another sum.
    essential_bytes: u64,
    /// Bytes that one splat more takes, where their number is open.
    per_splat: Option<f64>,
    splats: usize,
    isects: usize,
}

impl Prediction {
    /// Of training that begins with what `size` says and comes to have `expected` splats.
    pub(crate) fn of(mut size: TrainSize, expected: Option<usize>) -> Prediction {
        if let Some(splats) = expected.filter(|&splats| splats > size.splats) {
            size.splats = splats;
            size.isects = isects_expected(splats, size.image[0], size.image[1]);
        }
        Prediction::training(&size, expected.is_none())
    }

    fn training(size: &TrainSize, is_open: bool) -> Prediction {
        let (photos, [width, height]) = (size.photos, size.image);
        let count = photos.resident + photos.streamed;
        let streamed = match photos.streamed {
            0 => String::new(),
            streamed => format!(" ({} of them uploaded step by step)", grouped(streamed)),
        };
        Prediction {
            what: format!(
                "training {} splats of degree {} on {} photographs of {width}×{height}{streamed}",
                grouped(size.splats),
                size.sh_degree,
                grouped(count),
            ),
            needs: size.needs(),
            essential_bytes: size.essential_bytes(),
            per_splat: is_open.then(|| size.bytes_per_splat()),
            splats: size.splats,
            isects: size.isects,
        }
    }

    fn drawing(counts: ByDegree, [width, height]: [u32; 2], isects: usize) -> Prediction {
        let splats: usize = counts.iter().sum();
        let blocks = Blocks::anywhere(counts);
        let mut needs = vec![model_needs(blocks)];
        needs.extend(Some(index_needs(blocks)).filter(|need| need.bytes > 0));
        let capacity = Capacity::for_image(splats.max(1), isects, width, height);
        needs.extend(frame_needs(capacity, Outputs::default()));
        let essential = needs.iter().filter(|need| need.purpose.is_essential());
        Prediction {
            what: format!(
                "drawing {} splats {} at {width}×{height}",
                grouped(splats),
                of_degrees(counts)
            ),
            essential_bytes: essential.map(|need| need.bytes).sum(),
            needs,
            per_splat: None,
            splats,
            isects,
        }
    }

    fn bytes(&self) -> u64 {
        total(&self.needs)
    }

    /// Bytes by purpose, largest first.
    fn by_purpose(&self) -> Vec<(Purpose, u64)> {
        let mut sums: Vec<(Purpose, u64)> = Vec::new();
        for need in &self.needs {
            match sums
                .iter_mut()
                .find(|(purpose, _)| *purpose == need.purpose)
            {
                Some((_, sum)) => *sum += need.bytes,
                None => sums.push((need.purpose, need.bytes)),
            }
        }
        sums.sort_by_key(|&(_, sum)| std::cmp::Reverse(sum));
        sums
    }

    /// In one line.
    pub(crate) fn line(&self, limit: u64) -> String {
        let parts = self.by_purpose().into_iter().take(4);
        let parts: Vec<String> = parts
            .map(|(purpose, sum)| format!("{} {}", purpose.name(), bytes(sum)))
            .collect();
        let mut line = format!(
            "memory: {} for {} splats ({}, …)",
            bytes(self.bytes()),
            grouped(self.splats),
            parts.join(", ")
        );
        if let Some(more) = self.per_splat {
            // Writing to a string does not fail.
            _ = write!(
                line,
                "; {} for each further 1,000",
                bytes((1e3 * more) as u64)
            );
        }
        if self.bytes() > limit {
            _ = write!(line, "; more than the {} there are", bytes(limit));
        }
        line
    }

    /// As a table.
    pub(crate) fn table(&self, limit: u64) -> String {
        let mut text = format!("{}\n\n", self.what);
        let mut row = |name: &str, purpose: &str, size: u64| {
            _ = writeln!(
                text,
                "{name:<24} {purpose:<14} {:>16} {:>12}",
                grouped(size as usize),
                bytes(size)
            );
        };
        for need in &self.needs {
            row(need.name, need.purpose.name(), need.bytes);
        }
        row("total", "", self.bytes());
        text.push('\n');
        for (purpose, sum) in self.by_purpose() {
            let share = 100.0 * sum as f64 / self.bytes() as f64;
            _ = writeln!(
                text,
                "{:<14} {:>12} {share:>5.1} %",
                purpose.name(),
                bytes(sum)
            );
        }
        let ratio = self.bytes() as f64 / self.essential_bytes.max(1) as f64;
        _ = writeln!(
            text,
            "\nAll is {ratio:.2} times what {} (splat, tile) pairs, parameters, moments and photographs alone take \
             ({}).",
            grouped(self.isects),
            bytes(self.essential_bytes)
        );
        if let Some(more) = self.per_splat {
            _ = writeln!(
                text,
                "Density control adds splats as it sees fit: {} for each further 1,000. --splats or --max-splats \
                 predict for more.",
                bytes((1e3 * more) as u64)
            );
        }
        _ = match self.bytes() > limit {
            true => write!(text, "The device has less: {}.", bytes(limit)),
            false => write!(text, "The device has {}.", bytes(limit)),
        };
        text
    }

    /// For machines.
    pub(crate) fn value(&self) -> Value {
        let buffers: Vec<Value> = self
            .needs
            .iter()
            .map(|need| json!({"name": need.name, "purpose": need.purpose.name(), "bytes": need.bytes}))
            .collect();
        json!({
            "what": self.what,
            "splats": self.splats,
            "isects": self.isects,
            "bytes": self.bytes(),
            "essential_bytes": self.essential_bytes,
            "bytes_per_further_splat": self.per_splat,
            "buffers": buffers,
        })
    }
}

/// "of degree 3", or how many there are of which.
fn of_degrees(counts: ByDegree) -> String {
    let present = (0..).zip(counts).filter(|&(_, count)| count > 0);
    let present: Vec<(u32, usize)> = present.collect();
    match present[..] {
        [] => "of no degree".into(),
        [(degree, _)] => format!("of degree {degree}"),
        _ => {
            let of = |&(degree, count): &(u32, usize)| format!("{} of {degree}", grouped(count));
            let parts: Vec<String> = present.iter().map(of).collect();
            format!("of several degrees ({})", parts.join(", "))
        }
    }
}

impl PredictArgs {
    /// Of training on a data set.
    pub(crate) fn on_dataset(
        &self,
        dataset: &Dataset,
        config: &TrainConfig,
        limit: u64,
    ) -> Prediction {
        let first = match dataset.points.len() {
            0 => config.init.random_count as usize,
            points => points.min(config.splat_limit()),
        };
        let size = TrainSize::of(dataset, config, limit, first);
        self.training(size, config, limit)
    }

    /// Of training on photographs that are only counted, or of drawing.
    pub(crate) fn on_numbers(&self, config: &TrainConfig, limit: u64) -> Prediction {
        let first = SPLATS.min(config.splat_limit());
        let [width, height] = self.size.unwrap_or(SIZE);
        if self.photos.unwrap_or(0) == 0 {
            let splats = self.splats.unwrap_or(first);
            let isects = self
                .isects
                .unwrap_or(isects_expected(splats, width, height));
            let counts = of_degree(splats, config.sh_degree);
            return Prediction::drawing(counts, [width, height], isects);
        }
        let size = TrainSize {
            splats: first,
            sh_degree: config.sh_degree,
            lower: [0; 3],
            isects: isects_expected(first, width, height),
            image: [width, height],
            photos: Residency::default(),
        };
        self.training(size, config, limit)
    }

    /// Of drawing a scene.
    pub(crate) fn on_scene(&self, splats: &Splats) -> Result<Prediction> {
        if self.photos.is_some() {
            let fault = "--photos: a scene is drawn, not trained; leave PATH or --photos out";
            return Err(Error::Config(fault.into()));
        }
        let [width, height] = self.size.unwrap_or(SIZE);
        let count = self.splats.unwrap_or(splats.len());
        let isects = self.isects.unwrap_or(isects_expected(count, width, height));
        let counts = match self.splats {
            Some(count) => of_degree(count, splats.sh_degree),
            None => Slots::of_scene(splats).counts,
        };
        Ok(Prediction::drawing(counts, [width, height], isects))
    }

    fn training(&self, mut size: TrainSize, config: &TrainConfig, limit: u64) -> Prediction {
        let image = self.size.unwrap_or(size.image);
        let count = self
            .photos
            .unwrap_or(size.photos.resident + size.photos.streamed);
        if self.size.is_some() || self.photos.is_some() {
            size.image = image;
            let sizes = std::iter::repeat_n(image, count);
            size.photos = Residency::of(sizes, config.photo_share, limit);
        }
        let expected = splats_expected(config, size.splats);
        size.splats = self.splats.or(expected).unwrap_or(size.splats);
        let usual = isects_expected(size.splats, image[0], image[1]);
        size.isects = self.isects.unwrap_or(usual);
        Prediction::training(&size, self.splats.or(expected).is_none())
    }

    /// Refuses options that mean nothing without `--predict`.
    pub(crate) fn check(&self, config: &ConfigArgs) -> Result<()> {
        match self.predict || *config == ConfigArgs::default() {
            true => Ok(()),
            false => Err(Error::Config(
                "options of training are for --predict here".into(),
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_of_pictures_are_two_numbers() {
        assert_eq!(parse_image_size("1920x1080"), Ok([1920, 1080]));
        assert_eq!(parse_image_size("1 × 2"), Ok([1, 2]));
        for bad in ["", "x", "12", "0x5", "5x", "1x2x3", "-1x5", "99999x1"] {
            assert!(parse_image_size(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn a_prediction_follows_what_is_known_of_the_run() {
        let mut config = TrainConfig::for_iterations(2_000);
        let args = PredictArgs {
            photos: Some(10),
            size: Some([480, 270]),
            ..PredictArgs::default()
        };
        let open = args.on_numbers(&config, 1 << 30);
        assert!(open.per_splat.is_some_and(|more| more > 720.0));
        assert!(open.line(1 << 30).contains("for each further 1,000"));
        config.max_splats = Some(400_000);
        let capped = args.on_numbers(&config, 1 << 30);
        assert_eq!((capped.splats, capped.per_splat), (400_000, None));
        // One photograph has 4 bytes a pixel, and a quarter of the memory holds all.
        let photos = |prediction: &Prediction| {
            let all = prediction.by_purpose().into_iter();
            let mut photos = all.filter(|(purpose, _)| *purpose == Purpose::Photos);
            photos.next().map(|(_, sum)| sum)
        };
        assert_eq!(photos(&capped), Some(10 * 4 * 480 * 270));
        let limit = capped.bytes() - 1;
        assert!(capped.table(limit).contains("The device has less"));
        let by_name: u64 = capped.needs.iter().map(|need| need.bytes).sum();
        assert_eq!(capped.value()["bytes"], by_name);
        // None at all: the scene is only drawn.
        let drawn = PredictArgs::default().on_numbers(&config, 1 << 30);
        assert!(
            drawn.what.starts_with("drawing 100,000 splats"),
            "{}",
            drawn.what
        );
        assert!(
            drawn
                .needs
                .iter()
                .all(|need| need.purpose != Purpose::Moments)
        );
    }
}
