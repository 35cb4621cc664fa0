//! Pareto front.

/// Indices of the Pareto-optimal points (both coordinates low), by their first coordinate. Equal points are all kept;
/// points that are not finite are left out.
pub fn front(points: &[[f64; 2]]) -> Vec<usize> {
    let finite = |point: &[f64; 2]| point.iter().all(|x| x.is_finite());
    let mut order: Vec<usize> = (0..points.len()).filter(|&i| finite(&points[i])).collect();
    let compare = |a: &usize, b: &usize| {
        let ([ax, ay], [bx, by]) = (points[*a], points[*b]);
        ax.total_cmp(&bx).then(ay.total_cmp(&by))
    };
    order.sort_by(compare);
    let mut front: Vec<usize> = Vec::new();
    for index in order {
        // All earlier points are at most as far right, so it must be lower than the lowest of them.
        let beaten = front
            .last()
            .is_some_and(|&last| points[last][1] <= points[index][1] && points[last] != points[index]);
        if !beaten {
            front.push(index);
        }
    }
    front
}

#[cfg(test)]
mod tests {
    use super::front;
    use proptest::prelude::*;

    #[test]
    fn points_of_the_front_are_not_beaten() {
        let points = [
            [3.0, 1.0],
            [1.0, 5.0],
            [2.0, 2.0],
            [2.0, 3.0],
            [4.0, 1.0],
            [2.0, 2.0],
            [0.0, f64::NAN],
        ];
        assert_eq!(front(&points), [1, 2, 5, 0]);
        assert_eq!(front(&[]), Vec::<usize>::new());
        assert_eq!(front(&[[f64::INFINITY, 0.0]]), Vec::<usize>::new());
    }

    proptest! {
        #[test]
        fn it_is_the_definition(points in prop::collection::vec((0_u8..12, 0_u8..12), 0..30)) {
            let points: Vec<[f64; 2]> = points.iter().map(|&(x, y)| [x.into(), y.into()]).collect();
            let beats = |a: &[f64; 2], b: &[f64; 2]| a[0] <= b[0] && a[1] <= b[1] && a != b;
            let free = |i: &usize| !points.iter().any(|other| beats(other, &points[*i]));
            let wanted: Vec<usize> = (0..points.len()).filter(free).collect();
            let mut found = front(&points);
            prop_assert!(found.is_sorted_by(|&a, &b| points[a][0] <= points[b][0]));
            found.sort_unstable();
            prop_assert_eq!(found, wanted);
        }
    }
}
