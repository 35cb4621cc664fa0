//! Runs of Adam on four parameters of one splat.

use crate::stability::lab::Lab;
use ashfall::gpu::Buffer;
use ashfall::gpu::Groups;
use ashfall::kernels::adam::{self, Adam, Bindings, Params};
use ashfall::layout::{COUNT_POISONED, COUNT_SLOTS, GEOMETRY_PLANES};

/// Decay of the moments.
pub(crate) const BETAS: [f32; 2] = [0.9, 0.999];

/// Learning rate of every parameter in these runs.
pub(crate) const RATE: f32 = 1e-3;

/// One splat's optimiser on the device.
pub(crate) struct Run<'a> {
    lab: &'a Lab,
    kernel: Adam,
    plane: usize,
    step: i32,
    counts: Buffer<u32>,
    params: Buffer<[f32; 4]>,
    gradients: Buffer<[f32; 4]>,
    moments: [Buffer<[f32; 4]>; 2],
    d_colors: Buffer<[f32; 3]>,
}

/// Planes of a splat's geometry.
const PLANES: usize = GEOMETRY_PLANES as usize;

impl<'a> Run<'a> {
    /// Starts with the four parameters of plane `plane`; the other parameters are 0.
    pub(crate) fn new(lab: &'a Lab, plane: usize, start: [f32; 4]) -> Run<'a> {
        let gpu = lab.gpu();
        let zeros = vec![[0.0f32; 4]; PLANES];
        let mut planes = zeros.clone();
        // A zero quaternion in another plane would be normalised to NaNs.
        planes[1] = [1.0, 0.0, 0.0, 0.0];
        planes[plane] = start;
        let buffer = |planes: &[[f32; 4]]| gpu.buffer_from("planes", planes).unwrap();
        Run {
            lab,
            kernel: Adam::new(gpu, adam::Choice::default()).unwrap(),
            plane,
            step: 0,
            counts: gpu.buffer_from("counts", &[0u32; COUNT_SLOTS as usize]).unwrap(),
            params: buffer(&planes),
            gradients: buffer(&zeros),
            moments: [(); 2].map(|()| buffer(&zeros)),
            d_colors: gpu.buffer("d_colors", 1).unwrap(),
        }
    }

    /// One step along a gradient; returns the parameters after it.
    pub(crate) fn step(&mut self, gradient: [f32; 4]) -> [f32; 4] {
        self.step += 1;
        let gpu = self.lab.gpu();
        gpu.upload(&self.gradients, self.plane, &[gradient]).unwrap();
        let correction = |beta: f32| (1.0 / (1.0 - f64::from(beta).powi(self.step))) as f32;
        let push = Params {
            first_splat: 0,
            splat_count: 1,
            stride: 1,
            rate_mean: RATE,
            rate_opacity: RATE,
            rate_quaternion: RATE,
            rate_log_scale: RATE,
            beta1: BETAS[0],
            beta2: BETAS[1],
            epsilon: 1e-15,
            correction1: correction(BETAS[0]),
            correction2: correction(BETAS[1]),
            log_aspect_max: 0.0,
            color_step: 0,
        };
        let io = Bindings {
            counts: &self.counts,
            d_params: &self.gradients,
            params: &self.params,
            moment1: &self.moments[0],
            moment2: &self.moments[1],
            d_colors: &self.d_colors,
        };
        let groups = Groups::Grid([1, PLANES as u32, 1]);
        gpu.run(|rec| self.kernel.record(rec, io, push, groups)).unwrap();
        let all = gpu.download(&self.params, 0..PLANES).unwrap();
        all[self.plane]
    }

    /// Number of non-finite groups of four gradients so far.
    pub(crate) fn poisoned(&self) -> u32 {
        let counts = self.lab.gpu().download(&self.counts, 0..COUNT_SLOTS as usize);
        counts.unwrap()[COUNT_POISONED as usize]
    }
}

/// Parameters after each of a sequence of gradients, for three mean coordinates and an opacity.
pub(crate) fn course(lab: &Lab, gradients: &[[f32; 4]]) -> Vec<[f32; 4]> {
    let mut run = Run::new(lab, 0, [0.0; 4]);
    gradients.iter().map(|&gradient| run.step(gradient)).collect()
}
