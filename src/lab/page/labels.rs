//! Placement of labels beside points, without overlap of each other, the points and the frame.

/// Left, top, right, bottom, pixels.
pub(super) type PixelRect = [i32; 4];

/// Height of a line of text, pixels.
pub(super) const HEIGHT: i32 = 13;

/// Point of a label in pixels, its text, and its rank; the lowest is placed first.
pub(super) type LabelRequest = ([i32; 2], String, u32);

/// Upper bound of a text's width, pixels.
pub(super) fn width(text: &str) -> i32 {
    (text.chars().count() as i32 * 68 + 20) / 10
}

/// Places around a point of radius 6: right, left, above, below, and then a little farther.
fn candidates([x, y]: [i32; 2], text: &str) -> Vec<PixelRect> {
    let (w, h) = (width(text), HEIGHT);
    let mut areas = Vec::new();
    for far in [9, 15, 22] {
        for [left, top] in [
            [x + far, y - h / 2],
            [x - far - w, y - h / 2],
            [x + far - 3, y - far - h + 4],
            [x + far - 3, y + far - 4],
            [x - far + 3 - w, y - far - h + 4],
            [x - far + 3 - w, y + far - 4],
            [x - w / 2, y - far - h],
            [x - w / 2, y + far],
        ] {
            areas.push([left, top, left + w, top + h]);
        }
    }
    areas
}

/// True if two rectangles have a pixel in common.
pub(super) fn overlap(a: &PixelRect, b: &PixelRect) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

fn within(inner: &PixelRect, outer: &PixelRect) -> bool {
    inner[0] >= outer[0] && inner[1] >= outer[1] && inner[2] <= outer[2] && inner[3] <= outer[3]
}

/// Places labels inside `frame`, clear of `obstacles` and of each other; `None` without a free place. Labels without
/// any other place may cross the thin lines in `crossed`.
pub(super) fn place(
    requests: &[LabelRequest],
    frame: &PixelRect,
    obstacles: &[PixelRect],
    crossed: &[PixelRect],
) -> Vec<Option<PixelRect>> {
    let mut order: Vec<usize> = (0..requests.len()).collect();
    order.sort_by_key(|&i| requests[i].2);
    let mut taken = obstacles.to_vec();
    let mut placed = vec![None; requests.len()];
    for index in order {
        let (point, text, _) = &requests[index];
        let free = |area: &PixelRect| within(area, frame) && !taken.iter().any(|t| overlap(t, area));
        let is_clear = |area: &PixelRect| !crossed.iter().any(|line| overlap(line, area));
        let places = || candidates(*point, text).into_iter().filter(free);
        let found = places().find(is_clear).or_else(|| places().next());
        taken.extend(found);
        placed[index] = found;
    }
    placed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cover_nothing() {
        let frame = [0, 0, 400, 300];
        // A dense cluster in a corner, and one alone.
        let named = |i: i32| {
            let place = [380 - i % 7 * 9, 12 + i / 7 * 11];
            (place, format!("1/{}", 1 << (i % 12)), (i % 3) as u32)
        };
        let mut requests: Vec<LabelRequest> = (0..40).map(named).collect();
        requests.push(([100, 200], "alone".into(), 9));
        let around = |&([x, y], ..): &LabelRequest| [x - 6, y - 6, x + 6, y + 6];
        let points: Vec<PixelRect> = requests.iter().map(around).collect();
        let placed = place(&requests, &frame, &points, &[]);
        let areas: Vec<PixelRect> = placed.iter().flatten().copied().collect();
        assert!(placed[40].is_some() && areas.len() > 5 && areas.len() < 41);
        for (i, area) in areas.iter().enumerate() {
            assert!(within(area, &frame));
            assert!(!points.iter().any(|point| overlap(point, area)));
            assert!(!areas[..i].iter().any(|other| overlap(other, area)));
        }
    }

    #[test]
    fn names_cross_lines_only_where_there_is_no_other_place() {
        let frame = [0, 0, 400, 300];
        let request = [([100, 100], "name".into(), 0)];
        let bar = [20, 99, 300, 102];
        let clear = place(&request, &frame, &[], &[bar])[0];
        assert!(clear.is_some_and(|area| !overlap(&area, &bar)));
        // Lines everywhere.
        let all: Vec<PixelRect> = (0..60).map(|i| [0, 5 * i, 400, 5 * i + 2]).collect();
        let found = place(&request, &frame, &[], &all);
        assert_eq!(found, place(&request, &frame, &[], &[]));
        assert!(found[0].is_some());
    }
}
