//! Bytes and operations of a training step, stage by stage, from its counts.

use crate::layout::{
    COLOR_STEPS, GEOMETRY_PLANES, GRADIENT_PLANES, LOSS_TILE_HEIGHT, TILE_HEIGHT, TILE_PIXELS, TILE_WIDTH,
};
use crate::render::{DEPTH_SORT, plane_count, tile_sort};
use serde::Serialize;

/// Counts of a training step of 3D Gaussians, of which its work is a function.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StepLoad {
    /// Splats.
    pub splats: usize,
    /// Splats with a tile, mean of the steps.
    pub visible: f64,
    /// (Splat, tile) pairs, mean of the steps.
    pub isects: f64,
    /// Width and height of the photographs, pixels.
    pub size: [u32; 2],
    /// SH degree.
    pub sh_degree: u32,
    /// Distance of SSIM's windows, pixels.
    pub ssim_stride: u32,
}

/// Work of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StageLoad {
    /// Name, as in the rows of the bench.
    pub stage: &'static str,
    /// Bytes read and written.
    pub bytes: f64,
    /// Operations of single precision; 0 for stages with few per byte.
    pub operations: f64,
}

/// Bytes of a projected splat.
const RECORD: f64 = 40.0;
/// Bytes of a plane of four numbers.
const PLANE: f64 = 16.0;
/// Bytes of a colour's gradient.
const COLOR: f64 = 12.0;
/// Bytes of a pair of a key and a value in a pass of a sort: keys are read twice, values once, both are written.
const SORTED: f64 = 20.0;
/// Bytes of a scan by value: read to sum chunks, read and written to add them.
const SCANNED: f64 = 12.0;
/// Bytes of the gradient of a splat in a tile.
const GRADIENT: f64 = 36.0;

/// Operations of a listed splat at a pixel: exponent 4, exponential and cap 2, two comparisons, weight 1, colours 6,
/// transmittance 2. Pixels that are finished early save theirs.
const BLENDED: f64 = 17.0;
/// Operations of the same in the gradient: those up to the weight 10 (with the quotient of the transmittance), the
/// colour ahead 5, that behind 3, gradient of alpha 4, sums of colours 6 and of the exponent's moments 5.
const TAKEN_OFF: f64 = 33.0;
/// Operations of a sum of 11 weighted numbers with symmetric weights.
const WINDOW: f64 = 16.0;
/// Rows of windows beyond a tile.
const OVERLAP: f64 = 10.0;

impl StepLoad {
    /// Work of each stage, in order.
    pub fn stages(&self) -> Vec<StageLoad> {
        let [forward, backward] = self.loss_operations();
        let per_pair = self.isects * f64::from(TILE_PIXELS);
        let loads = [
            ("project", self.projected(), 0.0),
            ("sort_depth", self.sorted_by_depth(), 0.0),
            ("expand", self.isects * 12.0 + self.visible * 40.0, 0.0),
            ("sort_tile", self.sorted_by_tile(), 0.0),
            (
                "rasterize",
                self.isects * (8.0 + RECORD) + self.pixels() * 20.0,
                per_pair * BLENDED,
            ),
            ("loss", self.pixels() * (16.0 + self.slopes()), forward),
            ("loss_backward", self.pixels() * (28.0 + self.slopes()), backward),
            (
                "rasterize_backward",
                self.isects * (8.0 + RECORD + GRADIENT) + self.pixels() * 20.0,
                per_pair * TAKEN_OFF,
            ),
            ("project_backward", self.projected_backward(), 0.0),
            ("adam", self.updated(), 0.0),
        ];
        let load = |(stage, bytes, operations)| StageLoad {
            stage,
            bytes,
            operations,
        };
        loads.map(load).to_vec()
    }

    fn pixels(&self) -> f64 {
        self.size.map(f64::from).iter().product()
    }

    fn tiles(&self) -> usize {
        let [width, height] = self.size;
        (width.div_ceil(TILE_WIDTH) * height.div_ceil(TILE_HEIGHT)) as usize
    }

    /// Planes of parameters.
    fn planes(&self) -> f64 {
        plane_count(self.sh_degree) as f64
    }

    /// Means of all splats, all parameters of visible ones; records and tile counts.
    fn projected(&self) -> f64 {
        self.splats as f64 * (PLANE + 4.0) + self.visible * (PLANE * (self.planes() - 1.0) + RECORD)
    }

    /// Visible splats: found by a scan, compacted, sorted, their tile counts gathered and scanned.
    fn sorted_by_depth(&self) -> f64 {
        let gathered = 12.0;
        self.splats as f64 * (SCANNED + 8.0)
            + self.visible * (12.0 + f64::from(DEPTH_SORT.passes) * SORTED + gathered + SCANNED)
    }

    fn sorted_by_tile(&self) -> f64 {
        let tiles = self.tiles();
        self.isects * (SORTED * f64::from(tile_sort(tiles).passes) + 4.0) + 16.0 * tiles as f64
    }

    /// Bytes of SSIM's slopes by pixel.
    fn slopes(&self) -> f64 {
        36.0 / f64::from(self.ssim_stride * self.ssim_stride)
    }

    /// Operations of the loss and of its gradient: sums along rows, of which neighbouring tiles share some, then along
    /// columns.
    fn loss_operations(&self) -> [f64; 2] {
        let stride = f64::from(self.ssim_stride);
        let shared = 1.0 + OVERLAP / f64::from(LOSS_TILE_HEIGHT);
        let (moments, slopes) = (4.0 * WINDOW, 3.0 * WINDOW / stride);
        let (products, compared, differed, stored) = (8.0, 45.0, 6.0, 12.0);
        let forward = shared * (moments / stride + products) + (moments + compared) / (stride * stride) + differed;
        let backward = shared * slopes / stride + slopes + stored;
        [forward, backward].map(|operations| 3.0 * self.pixels() * operations)
    }

    /// Geometry of all splats and gradients of all; SH, record and statistics of visible ones; gradients by tile.
    fn projected_backward(&self) -> f64 {
        let gradients = PLANE * f64::from(GRADIENT_PLANES);
        let all = 4.0 + 2.0 * PLANE + gradients;
        let visible = PLANE * (self.planes() - 2.0) + RECORD + 4.0 + 2.0 * PLANE;
        self.splats as f64 * all + self.visible * visible + self.isects * GRADIENT
    }

    /// Parameters and both moments, read and written, those of the harmonics once in several steps; gradients of the
    /// geometry and of the colour, which is put aside and read again.
    fn updated(&self) -> f64 {
        let geometry = f64::from(GEOMETRY_PLANES);
        let harmonics = (self.planes() - geometry) / f64::from(COLOR_STEPS);
        let states = 6.0 * PLANE * (geometry + harmonics);
        self.splats as f64 * (states + PLANE * (geometry + 1.0) + 2.0 * COLOR)
    }
}
