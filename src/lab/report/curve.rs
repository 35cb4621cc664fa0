//! Curve of quality over splats: decisions of the run, the law through them, and its knee.

use super::needs::Needs;
use crate::Result;
use crate::lab::page::plot::{self, ALARM, FRONT, MARGINS, axes, color, failed};
use crate::lab::page::scale::Scale;
use crate::simplify::Decision;
use plotters::prelude::*;

/// Width and height, pixels.
const SIZE: [u32; 2] = [1080, 420];

/// Segments of a law's line.
const SEGMENTS: u32 = 80;

/// The curve as an SVG element.
pub(super) fn svg(needs: &Needs) -> Result<String> {
    let place = |step: &Decision| [step.splats.max(1) as f64, step.psnr_db];
    let growing = needs.steps.iter().filter(|step| step.without.is_none());
    let growth: Vec<[f64; 2]> = growing.map(place).collect();
    let all = || growth.iter().chain(&needs.points);
    let x = Scale::of(all().map(|point| point[0]), true);
    let y = Scale::of(all().map(|point| point[1]), false);
    let titles = ["splats", "PSNR of held-out training views, dB"];
    plot::svg(SIZE, |svg| {
        let area = axes(svg, MARGINS, titles, [&x, &y])?;
        let at = |[splats, psnr]: [f64; 2]| area.map_coordinate(&(x.place(splats), y.place(psnr)));
        let line =
            |points: Vec<[f64; 2]>, style: ShapeStyle| plot::line(svg, points.into_iter().map(at).collect(), style);
        line(growth.clone(), FRONT.stroke_width(1))?;
        if let Some(law) = &needs.law {
            let [low, high] = ends(&needs.points, needs.knee);
            let count = |i: u32| low * (high / low).powf(f64::from(i) / f64::from(SEGMENTS));
            let counts = (0..=SEGMENTS).map(count);
            line(
                counts.map(|splats| [splats, law.at(splats)]).collect(),
                color(1).stroke_width(2),
            )?;
        }
        for (series, points) in [(0, &growth), (1, &needs.points)] {
            for &point in points {
                let mark = Circle::new(at(point), 4, color(series).filled());
                svg.draw(&mark).map_err(failed)?;
            }
        }
        if let Some((knee, law)) = needs.knee.zip(needs.law) {
            let mark = Circle::new(at([knee, law.at(knee)]), 8, ALARM.stroke_width(2));
            svg.draw(&mark).map_err(failed)?;
        }
        Ok(())
    })
}

/// Ends of a law's line: the measured counts, and the knee up to a factor of two beyond them.
fn ends(points: &[[f64; 2]], knee: Option<f64>) -> [f64; 2] {
    let counts = points.iter().map(|point| point[0]);
    let (least, most) = counts.fold((f64::MAX, 1.0_f64), |(a, b), n| (n.min(a), n.max(b)));
    let least = least.min(most);
    let knee = knee.unwrap_or(least).clamp(least / 2.0, 2.0 * most);
    [least.min(knee), most.max(knee)]
}
