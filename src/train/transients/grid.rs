//! Patches of a photograph.

/// Most patches along a side of a photograph.
const SIDE_MAX: u32 = 128;

/// Words of a bit for each patch of any photograph.
pub(crate) const PATCH_WORDS: usize = (SIDE_MAX * SIDE_MAX / 32) as usize;

/// log2 of the smallest patch, pixels along a side.
const SHIFT_MIN: u32 = 3;

/// Square patches that cover a photograph, in rows from the top.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PatchGrid {
    /// log2 of a patch's pixels along a side.
    pub shift: u32,
    /// Patches in a row.
    pub columns: u32,
    /// Rows of patches.
    pub rows: u32,
}

impl PatchGrid {
    /// Patches of 8 × 8 pixels, or of the next power of two with at most 128 along a side.
    pub fn of(width: u32, height: u32) -> PatchGrid {
        let longest = u64::from(width.max(height));
        let mut shift = SHIFT_MIN;
        while longest > u64::from(SIDE_MAX) << shift {
            shift += 1;
        }
        PatchGrid {
            shift,
            columns: width.div_ceil(1 << shift),
            rows: height.div_ceil(1 << shift),
        }
    }

    /// The same patches of the photograph with width and height halved so many times, rounded up; `None` if they would
    /// have less than a pixel.
    pub fn halved(self, times: u32) -> Option<PatchGrid> {
        let shift = self.shift.checked_sub(times)?;
        Some(PatchGrid { shift, ..self })
    }

    /// Number of patches.
    pub fn count(self) -> usize {
        self.columns as usize * self.rows as usize
    }

    /// Words with a bit for each patch.
    pub fn words(self) -> usize {
        self.count().div_ceil(32)
    }

    /// Patch of a pixel.
    pub fn place(self, x: u32, y: u32) -> usize {
        (y >> self.shift) as usize * self.columns as usize + (x >> self.shift) as usize
    }

    /// Up to eight patches about a patch.
    pub fn around(self, place: usize) -> impl Iterator<Item = usize> {
        let (columns, rows) = (self.columns as usize, self.rows as usize);
        let (x, y) = (place % columns, place / columns);
        let rows = y.saturating_sub(1)..(y + 2).min(rows);
        let columns_near = x.saturating_sub(1)..(x + 2).min(columns);
        let all = rows.flat_map(move |y| columns_near.clone().map(move |x| y * columns + x));
        all.filter(move |&other| other != place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patches_cover_photographs_of_any_size_and_half_of_it() {
        let sizes = [
            [1, 1],
            [8, 9],
            [97, 131],
            [1024, 3],
            [1025, 768],
            [6000, 4001],
            [65_535, 1],
        ];
        for [width, height] in sizes {
            let grid = PatchGrid::of(width, height);
            assert!(grid.columns.max(grid.rows) <= SIDE_MAX && grid.words() <= PATCH_WORDS);
            assert_eq!(grid.place(width - 1, height - 1), grid.count() - 1);
            for times in 1..=3 {
                let small = grid.halved(times).unwrap_or(grid);
                let [width, height] = [width, height].map(|length: u32| length.div_ceil(1 << times));
                assert_eq!(small.place(width - 1, height - 1), grid.count() - 1);
            }
        }
        assert_eq!(PatchGrid::of(8, 9).halved(4), None);
        assert_eq!(PatchGrid::of(1024, 3).shift, 3);
        assert_eq!(PatchGrid::of(1025, 3).shift, 4);
    }

    #[test]
    fn neighbours_lie_within() {
        let grid = PatchGrid::of(24, 16);
        assert_eq!(grid.around(0).collect::<Vec<_>>(), [1, 3, 4]);
        assert_eq!(grid.around(4).collect::<Vec<_>>(), [0, 1, 2, 3, 5]);
        assert_eq!(PatchGrid::of(1, 1).around(0).count(), 0);
    }
}
