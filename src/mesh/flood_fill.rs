//! Outside of a closed mesh: voxels that are reached from the border of the volume, or from a camera, without passing
//! the inside of a surface.
//!
//! Unknown voxels that are reached are outside, the others are solid: a body seen from all sides is filled, and a
//! surface seen from one side gets a back at the truncation behind it.

use super::volume::{Key, SIDE, VOXELS, Volume};
use std::collections::{HashMap, VecDeque};

/// Bits of a block's voxels.
type Bits = [u64; VOXELS / 64];

/// Block and index of a voxel, or of all voxels of a block that is not stored (`u16::MAX`).
type VoxelPlace = (Key, u16);

/// The blocks' voxels by side.
#[derive(Debug)]
pub(super) struct FloodFill {
    /// First and last block, with a layer around all that are stored.
    low: Key,
    high: Key,
    /// By stored block: voxels inside a surface, and voxels that are reached.
    blocks: HashMap<Key, (Bits, Bits)>,
    /// By block in the box: whether a block that is not stored is reached.
    reached: Vec<bool>,
}

const WHOLE: u16 = u16::MAX;

impl FloodFill {
    /// Nothing reached yet, over blocks under these keys.
    pub(super) fn new(keys: &[Key]) -> FloodFill {
        let fold = |start: i32, of: fn(i32, i32) -> i32| {
            [0, 1, 2].map(|axis| keys.iter().map(|key| key[axis]).fold(start, of))
        };
        let (low, high) = match keys.is_empty() {
            true => ([0; 3], [0; 3]),
            false => (
                fold(i32::MAX, i32::min).map(|k| k - 1),
                fold(i32::MIN, i32::max).map(|k| k + 1),
            ),
        };
        let count = (0..3).map(|axis| (high[axis] - low[axis] + 1) as usize).product();
        FloodFill {
            low,
            high,
            blocks: HashMap::new(),
            reached: vec![false; count],
        }
    }

    /// Blocks in the box, for limits on memory.
    pub(super) fn boxed(keys: &[Key]) -> u64 {
        let side = |axis: usize| {
            let all = || keys.iter().map(|key| i64::from(key[axis]));
            all()
                .max()
                .zip(all().min())
                .map_or(1, |(high, low)| (high - low + 3) as u64)
        };
        side(0).saturating_mul(side(1)).saturating_mul(side(2))
    }

    /// Notes the voxels of a volume that at least `views_min` views saw inside a surface.
    pub(super) fn note(&mut self, volume: &Volume, views_min: u32, wanted: impl Fn(&Key) -> bool) {
        for key in volume.keys.iter().filter(|key| wanted(key)) {
            let Some(block) = volume.block(*key) else {
                continue;
            };
            let mut inside = Bits::default();
            for i in 0..VOXELS {
                if block.voxel(i, views_min).is_some_and(|voxel| voxel.distance < 0.0) {
                    inside[i / 64] |= 1 << (i % 64);
                }
            }
            self.blocks.insert(*key, (inside, Bits::default()));
        }
    }

    /// Spreads from the border of the box and from the voxels of cameras.
    pub(super) fn spread(&mut self, cameras: &[[i32; 3]]) {
        let mut pending: VecDeque<VoxelPlace> = VecDeque::new();
        let border = self.low;
        self.reach((border, WHOLE), &mut pending);
        for voxel in cameras {
            let key = voxel.map(|k| k.div_euclid(SIDE as i32));
            let inner = voxel.map(|k| k.rem_euclid(SIDE as i32) as usize);
            self.reach((key, place_of(inner)), &mut pending);
        }
        while let Some((key, place)) = pending.pop_front() {
            for axis in 0..3 {
                for step in [-1, 1] {
                    match place {
                        WHOLE => self.leave_block(key, axis, step, &mut pending),
                        _ => self.leave_voxel(key, place, axis, step, &mut pending),
                    }
                }
            }
        }
    }

    /// Side of an unknown voxel: 1 outside, -1 inside.
    pub(super) fn side(&self, key: Key, place: usize) -> f32 {
        let is_reached = match self.blocks.get(&key) {
            Some((_, reached)) => reached[place / 64] >> (place % 64) & 1 == 1,
            None => self.cell(key).is_none_or(|cell| self.reached[cell]),
        };
        if is_reached { 1.0 } else { -1.0 }
    }

    /// Index of a block in the box.
    fn cell(&self, key: Key) -> Option<usize> {
        let inside = (0..3).all(|axis| (self.low[axis]..=self.high[axis]).contains(&key[axis]));
        let side = |axis: usize| (self.high[axis] - self.low[axis] + 1) as usize;
        let at = |axis: usize| (key[axis] - self.low[axis]) as usize;
        inside.then(|| at(0) + side(0) * (at(1) + side(1) * at(2)))
    }

    /// Reaches a voxel unless it is inside a surface; of a block that is not stored, all its voxels.
    fn reach(&mut self, (key, place): VoxelPlace, pending: &mut VecDeque<VoxelPlace>) {
        if let Some((inside, reached)) = self.blocks.get_mut(&key) {
            let (word, bit) = (usize::from(place) / 64, 1 << (place % 64));
            if (inside[word] | reached[word]) & bit == 0 {
                reached[word] |= bit;
                pending.push_back((key, place));
            }
        } else if let Some(cell) = self.cell(key)
            && !self.reached[cell]
        {
            self.reached[cell] = true;
            pending.push_back((key, WHOLE));
        }
    }

    fn leave_voxel(&mut self, mut key: Key, place: u16, axis: usize, step: i32, pending: &mut VecDeque<VoxelPlace>) {
        let place = usize::from(place);
        let mut inner = [place % SIDE, place / SIDE % SIDE, place / (SIDE * SIDE)];
        let to = inner[axis] as i32 + step;
        key[axis] += to.div_euclid(SIDE as i32);
        inner[axis] = to.rem_euclid(SIDE as i32) as usize;
        self.reach((key, place_of(inner)), pending);
    }

    /// From a block that is not stored to the layer of voxels beside it.
    fn leave_block(&mut self, mut key: Key, axis: usize, step: i32, pending: &mut VecDeque<VoxelPlace>) {
        key[axis] += step;
        if !self.blocks.contains_key(&key) {
            return self.reach((key, WHOLE), pending);
        }
        for i in 0..SIDE * SIDE {
            let mut inner = [i % SIDE; 3];
            inner[(axis + 1) % 3] = i / SIDE;
            inner[axis] = if step > 0 { 0 } else { SIDE - 1 };
            self.reach((key, place_of(inner)), pending);
        }
    }
}

fn place_of(inner: [usize; 3]) -> u16 {
    (inner[0] + SIDE * (inner[1] + SIDE * inner[2])) as u16
}
