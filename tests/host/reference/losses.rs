//! The loss: gradient, masks, photographs.

use crate::common::scenes;
use crate::reference::{assert_close, central_difference};
use ashfall::reference::{Dual, Real, loss};
use ashfall::scene::AlphaMode;

#[test]
fn the_losss_gradient_is_its_derivative() {
    for (width, height) in [(1, 1), (5, 5), (11, 11), (17, 13)] {
        let photo = scenes::photo_values(&scenes::photo(1, width, height));
        let image = scenes::photo_values(&scenes::photo(2, width, height));
        let mask: Vec<f64> = (0..image.len()).map(|i| [1.0, 0.5, 0.0][i % 3]).collect();
        for mask in [None, Some(mask.as_slice())] {
            let target = loss::Target {
                mask,
                ..loss::Target::new(width as usize, &photo)
            };
            let gradient = loss::gradient(&image, &target);
            let values: Vec<f64> = image.iter().flatten().copied().collect();
            for chosen in (0..values.len()).step_by(values.len() / 12 + 1) {
                let loss_at = |x: f64| {
                    let mut moved = image.clone();
                    moved[chosen / 3][chosen % 3] = x;
                    loss::loss(&moved, &target)
                };
                let mut lifted: Vec<[Dual<1>; 3]> = image.iter().map(|rgb| rgb.map(Dual::of)).collect();
                lifted[chosen / 3][chosen % 3] = Dual::variable(values[chosen], Some(0));
                let dual = loss::loss(&lifted, &target);
                let found = gradient[chosen / 3][chosen % 3];
                assert_close(dual.v, loss_at(values[chosen]), 1e-14, 1.0);
                assert_close(found, dual.d[0], 1e-12, 1e-3 / values.len() as f64);
                let difference = central_difference(loss_at, values[chosen], 1e-4);
                assert_close(found, difference, 1e-8, 1.0 / values.len() as f64);
            }
        }
    }
}

#[test]
fn a_mask_of_zeros_is_no_loss_at_all() {
    let photo = scenes::photo_values(&scenes::photo(1, 12, 9));
    let image = scenes::photo_values(&scenes::photo(2, 12, 9));
    let nothing = vec![0.0; image.len()];
    let target = loss::Target {
        mask: Some(&nothing),
        ..loss::Target::new(12, &photo)
    };
    assert_close(loss::loss(&image, &target), 0.0, 1e-15, 1.0);
    assert!(loss::gradient(&image, &target).iter().flatten().all(|&d| d == 0.0));
}

#[test]
fn what_is_masked_out_does_not_matter() {
    let photo = scenes::photo_values(&scenes::photo(1, 14, 12));
    let image = scenes::photo_values(&scenes::photo(2, 14, 12));
    let mask: Vec<f64> = (0..image.len()).map(|i| f64::from(u8::from(i % 14 < 8))).collect();
    let masked = |image: &[[f64; 3]]| {
        let target = loss::Target {
            mask: Some(&mask),
            ..loss::Target::new(14, &photo)
        };
        loss::loss(image, &target)
    };
    let mut other = image.clone();
    let cropped =
        |image: &[[f64; 3]]| -> Vec<[f64; 3]> { image.chunks(14).flat_map(|row| row[..8].to_vec()).collect() };
    other
        .iter_mut()
        .zip(&mask)
        .filter(|(_, w)| **w == 0.0)
        .for_each(|(rgb, _)| *rgb = [9.0; 3]);
    assert_eq!(masked(&image), masked(&other));
    // Masked-out pixels have the same effect as those outside the image.
    let crop = loss::loss(&cropped(&image), &loss::Target::new(8, &cropped(&photo)));
    assert_close(masked(&image), crop, 1e-13, 1.0);
}

#[test]
fn alpha_is_a_mask_or_a_mixture() {
    let rgba = [[255, 0, 51, 255], [255, 0, 51, 0], [0, 255, 0, 51]];
    let background = [0.5, 0.25, 1.0];
    let (colors, mask) = loss::values(&rgba, AlphaMode::Composite, background);
    assert_eq!((colors[0], colors[1], mask), ([1.0, 0.0, 0.2], background, None));
    assert_close(colors[2][1], 0.2 + 0.8 * 0.25, 1e-15, 1.0);
    let (colors, mask) = loss::values(&rgba, AlphaMode::Mask, background);
    assert_eq!((colors[1], mask), ([1.0, 0.0, 0.2], Some(vec![1.0, 0.0, 0.2])));
}

#[test]
fn an_exposures_gradient_goes_through_the_loss() {
    let photo = scenes::photo_values(&scenes::photo(1, 13, 11));
    let image = scenes::photo_values(&scenes::photo(2, 13, 11));
    let exposure = loss::Exposure {
        gain: [1.335, 0.75, 1.02],
    };
    let target = loss::Target::new(13, &photo);
    let exposed = exposure.image(&image, &photo);
    let upstream = loss::gradient(&exposed, &target);
    for chosen in (0..3 * image.len()).step_by(31) {
        let (pixel, channel) = (chosen / 3, chosen % 3);
        let x = image[pixel][channel];
        let slope = exposure
            .of(channel, Dual::<1>::variable(x, Some(0)), photo[pixel][channel])
            .d[0];
        let loss_at = |x: f64| {
            let mut moved = image.clone();
            moved[pixel][channel] = x;
            loss::loss(&exposure.image(&moved, &photo), &target)
        };
        let difference = central_difference(loss_at, x, 1e-5);
        assert_close(
            slope * upstream[pixel][channel],
            difference,
            1e-6,
            1.0 / (3 * image.len()) as f64,
        );
    }
}

#[test]
fn an_exposure_is_that_of_linear_light() {
    let linear = |v: f64| {
        if v <= 0.04045 {
            v / 12.92
        } else {
            ((v + 0.055) / 1.055).powf(2.4)
        }
    };
    let stored = |l: f64| {
        if l <= 0.0031308 {
            12.92 * l
        } else {
            1.055 * l.powf(1.0 / 2.4) - 0.055
        }
    };
    for stops in [-1.0, -0.3, 0.0, 0.4, 1.0_f64] {
        let gain = [2_f64.powf(stops / 2.4); 3];
        let exposure = loss::Exposure { gain };
        for i in 0..=1000 {
            let value = f64::from(i) / 1000.0;
            // A photograph in the middle clips nothing.
            let found = exposure.of(1, value, 0.5);
            let exact = stored(linear(value) * stops.exp2());
            let near_the_toe = value.min(exact) < 0.05;
            assert!(
                (found - exact).abs() < if near_the_toe { 0.003 } else { 1e-12 },
                "{stops}: {found} {exact}"
            );
        }
        // Clipped values ask for no more, and for nothing beyond.
        assert_eq!(exposure.of(0, 2.0, 1.0), 1.0);
        assert_eq!(exposure.of(0, Dual::<1>::variable(2.0, Some(0)), 1.0).d, [0.0]);
        assert!(exposure.of(0, 0.1, 1.0) < 0.3, "what is below a clipped value counts");
    }
}

#[test]
fn least_squares_find_the_gains() {
    let image = scenes::photo_values(&scenes::photo(2, 30, 20));
    let truth = loss::Exposure { gain: [1.1, 0.8, 0.95] };
    let photo = truth.image(&image, &vec![[0.5; 3]; image.len()]);
    let start = loss::Exposure { gain: [1.0; 3] };
    let [products, squares] = start.sums(&image, &photo, |pixel| if pixel % 5 == 0 { 0.0 } else { 1.0 });
    assert!(products[3] > 300.0);
    for channel in 0..3 {
        let gain = products[channel] / squares[channel];
        assert!(
            (gain / truth.gain[channel] - 1.0).abs() < 2e-3,
            "{gain}, {:?}",
            truth.gain
        );
    }
}
