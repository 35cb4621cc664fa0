//! Optimiser state on the device.

use super::colors::PendingColors;
use super::state::{HostState, Planes, SH_PLANE};
use crate::Result;
use crate::gpu::{Buffer, Gpu};
use crate::layout::{COLOR_STEPS, GEOMETRY_PLANES, GRADIENT_PLANES};
use crate::render::{
    Allocate, Block, Blocks, ByDegree, Model, Need, Precision, Purpose, Slots, buffers, of_degree, plane_count,
};
use crate::scene::{ScreenFilter, sh_basis, sh_coefficient_count};

/// Parameters, gradients and moments in planes of vec4, and the statistics of density control.
#[derive(Debug)]
pub(crate) struct DeviceState {
    /// Parameters, in the layout of rendering.
    pub(crate) model: Model,
    /// Highest SH degree of the run.
    pub(super) sh_degree: u32,
    /// Mapping between slots and splats.
    pub(super) slots: Slots,
    pub(super) moments: MomentBuffers,
    pub(crate) buffers: GradientBuffers,
}

buffers! {
    /// Moments of the parameters, in their layout.
    pub(crate) struct MomentBuffers(blocks: Blocks) {
        moment1: Vec<Buffer<[f32; 4]>>, Moments, blocks.sizes();
        moment2: Vec<Buffer<[f32; 4]>>, Moments, blocks.sizes();
    }
}

buffers! {
    /// Gradients of a step, of so many splats of each degree.
    pub(crate) struct GradientBuffers(blocks: Blocks) {
        /// Of every block if kept for inspection or depth bands, else of the current block.
        gradients: Vec<Buffer<[f32; 4]>>, Gradients, vec![gradient_sizes(blocks).max().unwrap_or(0)];
        /// Of colours, in each step since the last update of the harmonics.
        d_colors: Vec<Buffer<[f32; 3]>>, Gradients, color_sizes(blocks);
        statistics: Buffer<[f32; 4]>, Gradients, blocks.splats();
    }
}

/// Blocks of splats in such slots, without spare room.
pub(super) fn blocks_of(gpu: &Gpu, slots: &Slots, sh_degree: u32) -> Blocks {
    let room = match slots.counts.iter().sum() {
        0 => of_degree(1, sh_degree),
        1.. => slots.counts,
    };
    Blocks::new(gpu.caps(), room, Precision::Full)
}

/// Vec4 of the gradients of each block.
fn gradient_sizes(blocks: Blocks) -> impl Iterator<Item = usize> {
    let strides = blocks.strides().into_iter();
    strides.map(|stride| stride * GRADIENT_PLANES as usize)
}

/// Gradients of colours of each block.
fn color_sizes(blocks: Blocks) -> Vec<usize> {
    let strides = blocks.strides().into_iter();
    strides.map(|stride| stride * COLOR_STEPS as usize).collect()
}

impl DeviceState {
    /// Bytes of the buffers.
    pub(crate) fn needs(room: ByDegree) -> Vec<Need> {
        let blocks = Blocks::anywhere(room);
        [
            Model::needs(blocks),
            MomentBuffers::needs(blocks),
            GradientBuffers::needs(blocks),
        ]
        .concat()
    }

    /// Bytes of the gradients of all blocks beyond those of one: all exist at once if a photograph is drawn in bands.
    pub(crate) fn further_gradients(room: ByDegree) -> Need {
        let sizes = || gradient_sizes(Blocks::anywhere(room));
        let further = sizes().sum::<usize>() - sizes().max().unwrap_or(0);
        Need::new("gradients", Purpose::Gradients, size_of::<[f32; 4]>(), further)
    }

    /// Maximum number of splats of a degree on the device: one binding must hold a vec4 per splat, and memory the
    /// parameters with their moments.
    pub(crate) fn splat_limit(gpu: &Gpu, sh_degree: u32) -> usize {
        let range = gpu.caps().reach();
        let planes = plane_count(sh_degree) as u64;
        let by_binding = range / 16;
        let by_memory = gpu.memory_limit() / (3 * 16 * planes);
        usize::try_from(by_binding.min(by_memory)).unwrap_or(usize::MAX)
    }

    /// Uploads `state`, to be drawn with `filter`, into buffers without spare capacity: sizes change seldom, and spare
    /// capacity would cost five times. Statistics start at 0.
    pub(crate) fn new(gpu: &Gpu, state: &HostState, filter: ScreenFilter) -> Result<DeviceState> {
        let slots = Slots::of(&state.degrees);
        let blocks = blocks_of(gpu, &slots, state.sh_degree);
        let mut device = DeviceState {
            model: Model {
                primitive: state.primitive,
                ..Model::empty(gpu, blocks, state.sh_degree, filter)?
            },
            sh_degree: state.sh_degree,
            slots,
            moments: MomentBuffers::new(gpu, blocks)?,
            buffers: GradientBuffers::new(gpu, blocks)?,
        };
        device.fill(gpu, state)?;
        Ok(device)
    }

    /// Gradient buffer of a block.
    pub(crate) fn gradients(&self, block: Block) -> &Buffer<[f32; 4]> {
        &self.buffers.gradients[block.index.min(self.buffers.gradients.len() - 1)]
    }

    /// Gives every block its own gradient buffer, so that all gradients of a step exist at once.
    pub(crate) fn keep_gradients(&mut self, gpu: &Gpu) -> Result<()> {
        let sizes: Vec<usize> = gradient_sizes(self.model.blocks).collect();
        if sizes.len() == self.buffers.gradients.len() {
            return Ok(());
        }
        self.buffers.gradients = Allocate::allocate(gpu, "gradients", sizes)?;
        Ok(())
    }

    /// Whether the buffers can hold `state`.
    pub(crate) fn fits(&self, state: &HostState) -> bool {
        let slots = Slots::of(&state.degrees);
        let mut rooms = slots.counts.iter().zip(self.model.blocks.room);
        let has_index = !self.model.splat_from_slot.is_empty();
        rooms.all(|(&count, room)| count <= room) && (has_index || slots.splat_from_slot.is_none())
    }

    /// Uploads a state that fits, or the planes that it has; statistics start at 0.
    pub(crate) fn fill(&mut self, gpu: &Gpu, state: &HostState) -> Result<()> {
        self.slots = Slots::of(&state.degrees);
        self.model.splat_count = state.len();
        self.model.counts = self.slots.counts;
        for block in self.model.blocks.of(self.slots.counts) {
            let splats = self.slots.of_slots(block.slots());
            if let Some(index) = self.model.splat_from_slot.get(block.index) {
                gpu.upload(index, 0, &splats)?;
            }
            for (buffers, planes) in [
                (&self.model.params, &state.params),
                (&self.moments.moment1, &state.m),
                (&self.moments.moment2, &state.v),
            ] {
                for (i, plane) in planes.iter().take(plane_count(block.degree)).enumerate() {
                    let rows: Vec<[f32; 4]> = splats.iter().map(|&s| plane[s as usize]).collect();
                    gpu.upload(&buffers[block.index], block.plane(i).start, &rows)?;
                }
            }
        }
        gpu.run(|rec| rec.fill(&self.buffers.statistics, 0))
    }

    /// Planes up to the run's SH degree; zeros above a splat's own degree.
    fn planes(&self, gpu: &Gpu, buffers: &[Buffer<[f32; 4]>]) -> Result<Planes> {
        self.gathered(gpu, buffers, plane_count(self.sh_degree), plane_count)
    }

    /// So many planes, of which a block holds those for its degree.
    fn gathered(
        &self,
        gpu: &Gpu,
        buffers: &[Buffer<[f32; 4]>],
        count: usize,
        held: impl Fn(u32) -> usize,
    ) -> Result<Planes> {
        let mut planes = vec![vec![[0.0; 4]; self.model.splat_count]; count];
        for block in self.model.blocks.of(self.slots.counts) {
            let splats = self.slots.of_slots(block.slots());
            let stored = planes.iter_mut().take(held(block.degree));
            for (i, plane) in stored.enumerate() {
                let rows = gpu.download(&buffers[block.index], block.plane(i))?;
                let rows = splats.iter().zip(rows);
                rows.for_each(|(&splat, row)| plane[splat as usize] = row);
            }
        }
        Ok(planes)
    }

    /// Copies parameters and moments to the host.
    pub(crate) fn download(&self, gpu: &Gpu) -> Result<HostState> {
        Ok(HostState {
            params: self.planes(gpu, &self.model.params)?,
            m: self.planes(gpu, &self.moments.moment1)?,
            v: self.planes(gpu, &self.moments.moment2)?,
            ..self.without_planes()
        })
    }

    /// Copies the parameters of geometry to the host: a state without harmonics and moments, for refinements.
    pub(super) fn download_geometry(&self, gpu: &Gpu) -> Result<HostState> {
        Ok(HostState {
            params: self.gathered(gpu, &self.model.params, SH_PLANE, |_| SH_PLANE)?,
            ..self.without_planes()
        })
    }

    fn without_planes(&self) -> HostState {
        let mut degrees = vec![0; self.model.splat_count];
        for block in self.model.blocks.of(self.slots.counts) {
            for splat in self.slots.of_slots(block.slots()) {
                degrees[splat as usize] = block.degree as u8;
            }
        }
        HostState {
            primitive: self.model.primitive,
            sh_degree: self.sh_degree,
            degrees,
            params: Planes::new(),
            m: Planes::new(),
            v: Planes::new(),
        }
    }

    /// Downloads the last step's gradients, which must have been kept, in the layout of the parameters.
    pub(crate) fn download_gradients(&self, gpu: &Gpu) -> Result<Planes> {
        assert_eq!(
            self.buffers.gradients.len(),
            self.model.params.len(),
            "gradients were not kept"
        );
        let mut planes = self.gathered(gpu, &self.buffers.gradients, GRADIENT_PLANES as usize, |_| {
            GRADIENT_PLANES as usize
        })?;
        let factors = planes.split_off(GEOMETRY_PLANES as usize);
        planes.resize(plane_count(self.sh_degree), vec![[0.0; 4]; self.model.splat_count]);
        for block in self.model.blocks.of(self.slots.counts) {
            for splat in self.slots.of_slots(block.slots()) {
                let [d_color, direction] = [0, 1].map(|plane: usize| factors[plane][splat as usize]);
                let [x, y, z, _] = direction.map(f64::from);
                let basis = sh_basis([x, y, z]);
                for k in 0..3 * sh_coefficient_count(block.degree) {
                    let plane = &mut planes[GEOMETRY_PLANES as usize + k / 4];
                    plane[splat as usize][k % 4] = (basis[k / 3] * f64::from(d_color[k % 3])) as f32;
                }
            }
        }
        Ok(planes)
    }

    /// Copies the gradients of colours of the steps since the last update of the harmonics, at these camera centres.
    pub(crate) fn download_colors(&self, gpu: &Gpu, positions: Vec<[f32; 3]>) -> Result<PendingColors> {
        let count = self.model.splat_count;
        let mut gradients = vec![[0.0; 3]; positions.len() * count];
        for (block, step) in self.color_blocks(positions.len()) {
            let rows = gpu.download(&self.buffers.d_colors[block.index], block.plane(step))?;
            let splats = self.slots.of_slots(block.slots());
            let rows = splats.iter().zip(rows);
            rows.for_each(|(&splat, row)| gradients[step * count + splat as usize] = row);
        }
        Ok(PendingColors { positions, gradients })
    }

    /// Restores [`DeviceState::download_colors`].
    pub(crate) fn upload_colors(&self, gpu: &Gpu, colors: &PendingColors) -> Result<()> {
        let count = self.model.splat_count;
        for (block, step) in self.color_blocks(colors.positions.len()) {
            let splats = self.slots.of_slots(block.slots());
            let row = |&splat: &u32| colors.gradients[step * count + splat as usize];
            let rows: Vec<[f32; 3]> = splats.iter().map(row).collect();
            gpu.upload(&self.buffers.d_colors[block.index], block.plane(step).start, &rows)?;
        }
        Ok(())
    }

    /// Each block with each of so many steps.
    fn color_blocks(&self, steps: usize) -> impl Iterator<Item = (Block, usize)> {
        let blocks = self.model.blocks.of(self.slots.counts);
        blocks.flat_map(move |block| (0..steps).map(move |step| (block, step)))
    }

    /// Copies the statistics to the host.
    pub(crate) fn download_statistics(&self, gpu: &Gpu) -> Result<Vec<[f32; 4]>> {
        gpu.download(&self.buffers.statistics, 0..self.model.splat_count)
    }
}
