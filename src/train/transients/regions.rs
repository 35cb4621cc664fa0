//! Regions of patches that stand out.

use super::PatchGrid;

/// A patch lies within a region if at most one of so many neighbours is outside.
const HOLE_SHARE: usize = 4;

/// Thresholds of regions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegionRule {
    /// Score from which a patch begins a region.
    pub seed: f64,
    /// Score from which a neighbour belongs to it.
    pub edge: f64,
    /// Least patches of a region.
    pub least: usize,
    /// Most patches of all regions.
    pub most: usize,
}

/// Patches of the regions: those that hang together, corners included, with scores from `edge` on, one of them from
/// `seed` on, and `least` of them; and patches that lie within, with at most a quarter of their neighbours outside. Of
/// more than `most`, those with the highest scores.
pub fn regions(grid: PatchGrid, scores: &[f32], rule: RegionRule) -> Vec<bool> {
    let mut inside = vec![false; grid.count()];
    let score = |place: usize| f64::from(scores[place]);
    let mut is_seen = inside.clone();
    for seed in (0..grid.count()).filter(|&place| score(place) >= rule.seed) {
        let mut region = Vec::new();
        let mut open = vec![seed];
        while let Some(place) = open.pop() {
            if is_seen[place] || score(place) < rule.edge {
                continue;
            }
            is_seen[place] = true;
            region.push(place);
            open.extend(grid.around(place));
        }
        if region.len() >= rule.least {
            region.into_iter().for_each(|place| inside[place] = true);
        }
    }
    let is_within = |place: usize| {
        let (mut all, mut outside) = (0, 0);
        for other in grid.around(place) {
            all += 1;
            outside += usize::from(!inside[other]);
        }
        inside[place] || all > 0 && HOLE_SHARE * outside <= all
    };
    let mut found: Vec<usize> = (0..grid.count()).filter(|&place| is_within(place)).collect();
    if found.len() > rule.most {
        found.sort_by(|&a, &b| score(b).total_cmp(&score(a)).then(a.cmp(&b)));
        found.truncate(rule.most);
    }
    let mut kept = vec![false; grid.count()];
    found.into_iter().for_each(|place| kept[place] = true);
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    const RULE: RegionRule = RegionRule {
        seed: 0.6,
        edge: 0.2,
        least: 2,
        most: 100,
    };

    /// Regions of scores drawn as digits, tenths.
    fn found(drawing: &[&str], rule: RegionRule) -> Vec<String> {
        let (columns, rows) = (drawing[0].len() as u32, drawing.len() as u32);
        let grid = PatchGrid::of(8 * columns, 8 * rows);
        let digits = drawing.iter().flat_map(|row| row.bytes());
        let scores: Vec<f32> = digits.map(|digit| f32::from(digit - b'0') / 10.0).collect();
        let inside = regions(grid, &scores, rule);
        let row = |row: &[bool]| row.iter().map(|&inside| if inside { '#' } else { '.' }).collect();
        inside.chunks(columns as usize).map(row).collect()
    }

    #[test]
    fn regions_grow_from_seeds_through_edges_and_corners() {
        let drawing = ["0000003", "0370003", "0020000", "0002000", "4000008"];
        let wanted = [".......", ".##....", "..#....", "...#...", "......."];
        assert_eq!(found(&drawing, RULE), wanted);
        let single = RegionRule { least: 1, ..RULE };
        assert_eq!(found(&drawing, single)[4], "......#");
        assert_eq!(found(&["000", "010"], RULE), ["...", "..."]);
    }

    #[test]
    fn holes_are_filled_and_the_cap_keeps_the_highest() {
        let ring = ["000000", "077700", "070700", "077700", "000000"];
        assert_eq!(found(&ring, RULE)[2], ".###..");
        let all = ["99", "98", "76"];
        let capped = RegionRule { most: 3, ..RULE };
        assert_eq!(found(&all, capped), ["##", "#.", ".."]);
        assert_eq!(found(&["9"], RegionRule { least: 1, ..RULE }), ["#"]);
    }
}
