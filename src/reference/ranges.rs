//! Range of each tile in the sorted intersections: one binary search per end.

/// Half-open `[begin, end)` into `tile_from_isect` (ascending) for every tile; `begin == end` for empty tiles.
pub fn ranges(tile_from_isect: &[u32], tile_count: u32) -> Vec<[u32; 2]> {
    assert!(tile_from_isect.is_sorted(), "tiles out of order");
    (0..tile_count)
        .map(|tile| {
            let begin = tile_from_isect.partition_point(|&t| t < tile);
            let end = tile_from_isect.partition_point(|&t| t <= tile);
            [begin as u32, end as u32]
        })
        .collect()
}
