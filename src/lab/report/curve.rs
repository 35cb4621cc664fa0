//! Quality of held-out views over splats: what was measured, the law through it, its knee.

use super::needs::Needs;
use crate::Result;
use crate::lab::chart::figure::{ALARM, FRONT, MARGINS, axes, color, failed};
use crate::lab::chart::scale::Scale;
use crate::simplify::{Decision, Law};
use plotters::coord::Shift;
use plotters::prelude::*;

/// Pixels.
const SIZE: (u32, u32) = (1080, 420);

/// Pieces that a law is drawn in.
const PIECES: u32 = 80;

type Canvas<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// The figure.
pub(super) fn svg(needs: &Needs) -> Result<String> {
    let mut text = String::new();
    let canvas = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
    draw(needs, &canvas)?;
    canvas.present().map_err(failed)?;
    drop(canvas);
    Ok(text)
}

fn draw(needs: &Needs, canvas: &Canvas<'_>) -> Result<()> {
    canvas.fill(&WHITE).map_err(failed)?;
    let place = |step: &Decision| [step.splats.max(1) as f64, step.psnr_db];
    let growing = needs.steps.iter().filter(|step| step.without.is_none());
    let course: Vec<[f64; 2]> = growing.map(place).collect();
    let all = || course.iter().chain(&needs.points);
    let x = Scale::of(all().map(|point| point[0]), true);
    let y = Scale::of(all().map(|point| point[1]), false);
    let titles = ["splats", "PSNR of held-out training views, dB"];
    let area = axes(canvas, MARGINS, titles, [&x, &y])?;
    let at = |[splats, psnr]: [f64; 2]| area.map_coordinate(&(x.place(splats), y.place(psnr)));
    let line = |points: Vec<[f64; 2]>, style: ShapeStyle| {
        let points: Vec<(i32, i32)> = points.into_iter().map(at).collect();
        let line = PathElement::new(points, style);
        canvas.draw(&line).map_err(failed)
    };
    line(course.clone(), FRONT.stroke_width(1))?;
    if let Some(law) = &needs.law {
        let ends = ends(&needs.points, needs.knee);
        line(of_law(law, ends), color(1).stroke_width(2))?;
    }
    for (series, points) in [(0, &course), (1, &needs.points)] {
        for &point in points {
            let mark = Circle::new(at(point), 4, color(series).filled());
            canvas.draw(&mark).map_err(failed)?;
        }
    }
    if let Some((knee, law)) = needs.knee.zip(needs.law) {
        let mark = Circle::new(at([knee, law.at(knee)]), 8, ALARM.stroke_width(2));
        canvas.draw(&mark).map_err(failed)?;
    }
    Ok(())
}

/// From where to where a law is drawn: over what was measured, and to the knee if that is not far.
pub(in crate::lab) fn ends(points: &[[f64; 2]], knee: Option<f64>) -> [f64; 2] {
    let counts = points.iter().map(|point| point[0]);
    let (least, most) = counts.fold((f64::MAX, 1.0_f64), |(a, b), n| (n.min(a), n.max(b)));
    let least = least.min(most);
    let knee = knee.unwrap_or(least).clamp(least / 2.0, 2.0 * most);
    [least.min(knee), most.max(knee)]
}

/// A law as a line between two counts.
pub(in crate::lab) fn of_law(law: &Law, [low, high]: [f64; 2]) -> Vec<[f64; 2]> {
    let count = |i: u32| low * (high / low).powf(f64::from(i) / f64::from(PIECES));
    let point = |splats: f64| [splats, law.at(splats)];
    (0..=PIECES).map(|i| point(count(i))).collect()
}
