//! Predicted device memory, for `ashfall info --predict` and at the start of training.

use super::output::{bytes, grouped};
use super::parse;
use crate::render::{
    Blocks, ByDegree, Capacity, Model, Need, Outputs, Purpose, RowBands, Scratch, Slots, of_degree, total,
};
use crate::scene::{Dataset, Primitive, Splats};
use crate::simplify::controller_needs;
use crate::train::{BufferLimits, Residency, TrainConfig, TrainSize, first_splats, splats_expected};
use crate::{Error, Result};
use clap::Args;
use serde_json::{Value, json};
use std::cmp::Reverse;
use std::collections::BTreeMap;

/// Task of the prediction.
#[derive(Clone, Debug, Default, PartialEq, Args)]
#[command(next_help_heading = "Prediction")]
pub(super) struct PredictArgs {
    /// Predict the device memory of training, on the data set at PATH or on --photos photographs of --size; of a
    /// scene at PATH, or without photographs, that of drawing
    #[arg(long)]
    pub predict: bool,
    /// Splats [default: the strategy's final count, if known; else the initial count]
    #[arg(long, value_name = "N", requires = "predict")]
    pub splats: Option<usize>,
    /// Size of the pictures [default: the data set's, or 1920x1080]
    #[arg(long, value_name = "WxH", requires = "predict", value_parser = parse::image_size)]
    pub size: Option<[u32; 2]>,
    /// Predict training with --parsimony
    #[arg(long, requires = "predict")]
    pub parsimony: bool,
    /// Photographs trained on [default: the data set's, or none: only drawing]
    #[arg(long, value_name = "N", requires = "predict")]
    pub photos: Option<usize>,
    /// (Splat, tile) pairs of a frame [default: typical of this many splats at this size]
    #[arg(long, value_name = "N", requires = "predict")]
    pub isects: Option<usize>,
}

/// Default splat count.
const SPLATS: usize = 100_000;
/// Default image size.
const SIZE: [u32; 2] = [1920, 1080];

/// Device memory of training or drawing, by the closed formula.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Prediction {
    /// Description of the task.
    what: String,
    splats: usize,
    isects: usize,
    needs: Vec<Need>,
    /// Bytes per additional splat in training.
    per_splat: Option<f64>,
}

impl Prediction {
    /// Training with the splats of `size`, or with `expected` if that is more, under a count controller or without.
    pub(crate) fn of(mut size: TrainSize, expected: Option<usize>, is_controlled: bool) -> Prediction {
        let [width, height] = size.image;
        if let Some(splats) = expected.filter(|&splats| splats > size.splats) {
            size.splats = splats;
            size.isects = size.pairs_expected();
        }
        let photos = size.photos.resident + size.photos.streamed;
        let bands = match size.row_bands().count() {
            1 => String::new(),
            count => format!(" in {count} bands of rows"),
        };
        let what = format!(
            "training {} splats of degree {} on {} photographs of {width}×{height}{bands}",
            grouped(size.splats),
            size.sh_degree,
            grouped(photos)
        );
        let mut needs = size.needs();
        if is_controlled {
            needs.extend(controller_needs(&size));
        }
        Prediction {
            what,
            splats: size.splats,
            isects: size.isects,
            needs,
            per_splat: Some(size.bytes_per_splat()),
        }
    }

    /// Bytes by purpose, largest first, then the total, the bytes of 1,000 additional splats, and the device's limit.
    fn rows(&self, limit: u64) -> Vec<(&'static str, String)> {
        let mut sums: BTreeMap<Purpose, u64> = BTreeMap::new();
        for need in &self.needs {
            *sums.entry(need.purpose).or_default() += need.bytes;
        }
        let mut sums: Vec<(Purpose, u64)> = sums.into_iter().collect();
        sums.sort_by_key(|&(_, sum)| Reverse(sum));
        let sums = sums.into_iter();
        let mut rows: Vec<_> = sums.map(|(purpose, sum)| (purpose.name(), bytes(sum))).collect();
        let total = total(&self.needs);
        rows.push(("total", bytes(total)));
        let further = self.per_splat.map(|more| bytes((1e3 * more) as u64));
        rows.extend(further.map(|more| ("each further 1,000", more)));
        let little = if total > limit { ": too little" } else { "" };
        rows.push(("device", bytes(limit) + little));
        rows
    }

    /// One line of text.
    pub(crate) fn line(&self, limit: u64) -> String {
        let rows = self.rows(limit).into_iter();
        let rows: Vec<String> = rows.map(|(name, size)| format!("{name} {size}")).collect();
        format!("memory of {}: {}", self.what, rows.join(", "))
    }

    /// Table of text.
    pub(crate) fn table(&self, limit: u64) -> String {
        let rows = self.rows(limit).into_iter();
        let rows = rows.map(|(name, size)| format!("\n  {name:<20} {size:>12}"));
        self.what.clone() + &rows.collect::<String>()
    }

    /// JSON with every buffer.
    pub(crate) fn value(&self) -> Value {
        let buffer = |need: &Need| json!({"name": need.name, "purpose": need.purpose.name(), "bytes": need.bytes});
        json!({
            "what": self.what,
            "splats": self.splats,
            "isects": self.isects,
            "bytes": total(&self.needs),
            "bytes_per_further_splat": self.per_splat,
            "buffers": self.needs.iter().map(buffer).collect::<Vec<_>>(),
        })
    }
}

impl PredictArgs {
    /// Training on a data set.
    pub(crate) fn on_dataset(&self, dataset: &Dataset, config: &TrainConfig, limits: BufferLimits) -> Prediction {
        let first = first_splats(dataset, config);
        self.training(TrainSize::of(dataset, config, limits, first), config, limits)
    }

    /// Training on a number of photographs without a data set, or drawing.
    pub(crate) fn on_numbers(&self, config: &TrainConfig, limits: BufferLimits) -> Prediction {
        let splats = SPLATS.min(config.splat_limit());
        if self.photos.unwrap_or(0) == 0 {
            return self.drawing(
                of_degree(self.splats.unwrap_or(splats), config.sh_degree),
                config.kind,
                limits,
            );
        }
        let size = TrainSize {
            outputs: config.outputs(),
            splats,
            sh_degree: config.sh_degree,
            lower: [0; 3],
            isects: 0,
            image: SIZE,
            binding: limits.step_binding(config),
            photos: Residency::default(),
            reloads: config.reloads(),
            patches: 0,
            pose_view: None,
        };
        self.training(size, config, limits)
    }

    /// Drawing a scene.
    pub(crate) fn on_scene(&self, splats: &Splats, limits: BufferLimits) -> Result<Prediction> {
        if self.photos.is_some() {
            let fault = "--photos: a scene is drawn, not trained; leave PATH or --photos out";
            return Err(Error::Config(fault.into()));
        }
        let counts = match self.splats {
            Some(count) => of_degree(count, splats.sh_degree),
            None => Slots::of_scene(splats).counts,
        };
        Ok(self.drawing(counts, splats.primitive, limits))
    }

    fn drawing(&self, counts: ByDegree, primitive: Primitive, limits: BufferLimits) -> Prediction {
        let [width, height] = self.size.unwrap_or(SIZE);
        let splats: usize = counts.iter().sum();
        let outputs = Outputs {
            surfels: primitive.into(),
            ..Outputs::default()
        };
        let bands = RowBands::for_drawing([width, height], outputs, limits.binding);
        let isects = self.isects.unwrap_or(bands.pairs_expected(splats));
        let blocks = Blocks::anywhere(counts);
        let [_, rows] = bands.drawn();
        let capacity = Capacity::for_image(splats.max(1), isects, width, rows);
        let mut needs = Model::needs(blocks);
        needs.extend(Scratch::needs(capacity, outputs));
        needs.retain(|need| need.bytes > 0);
        Prediction {
            what: format!("drawing {} splats at {width}×{height}", grouped(splats)),
            splats,
            isects,
            needs,
            per_splat: None,
        }
    }

    fn training(&self, mut size: TrainSize, config: &TrainConfig, limits: BufferLimits) -> Prediction {
        let photos = size.photos.resident + size.photos.streamed;
        if self.size.is_some() || self.photos.is_some() {
            size.image = self.size.unwrap_or(size.image);
            let sizes = std::iter::repeat_n(size.image, self.photos.unwrap_or(photos));
            size.photos = Residency::of(sizes, config.photo_share, limits.memory);
        }
        let expected = self.splats.or_else(|| splats_expected(config, size.splats));
        let expected = expected.unwrap_or(size.splats);
        if !self.parsimony && config.band_pixels == 0 {
            size.binding = size.binding_within(expected, limits.memory);
        }
        size.splats = expected;
        size.isects = self.isects.unwrap_or(size.pairs_expected());
        Prediction::of(size, None, self.parsimony)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: BufferLimits = BufferLimits {
        memory: 1 << 30,
        binding: 1 << 27,
    };

    #[test]
    fn a_prediction_follows_the_settings_of_the_run() {
        let mut config = TrainConfig::for_iterations(2_000);
        let args = PredictArgs {
            photos: Some(10),
            size: Some([480, 270]),
            ..PredictArgs::default()
        };
        let open = args.on_numbers(&config, LIMITS);
        assert!(open.per_splat.is_some_and(|more| more > 720.0));
        assert!(open.line(1 << 30).contains("each further 1,000"));
        let parsimonious = PredictArgs {
            parsimony: true,
            ..args.clone()
        };
        let controlled = parsimonious.on_numbers(&config, LIMITS);
        assert!(total(&controlled.needs) > total(&open.needs));
        config.max_splats = Some(400_000);
        let capped = args.on_numbers(&config, LIMITS);
        assert_eq!(capped.splats, 400_000);
        // One photograph has 4 bytes a pixel, and a quarter of the memory holds all.
        let photos = capped.needs.iter().filter(|need| need.purpose == Purpose::Photos);
        assert_eq!(photos.map(|need| need.bytes).sum::<u64>(), 10 * 4 * 480 * 270);
        let all = total(&capped.needs);
        assert_eq!(capped.value()["bytes"], all);
        assert!(capped.table(all - 1).ends_with("too little"));
        assert!(!capped.table(all).contains("too little"));
        // Without photographs the scene is only drawn.
        let drawn = PredictArgs::default().on_numbers(&config, LIMITS);
        assert!(drawn.what.starts_with("drawing 100,000 splats"), "{}", drawn.what);
        let mut needs = drawn.needs.iter();
        assert!(needs.all(|need| need.purpose != Purpose::Moments));
    }
}
