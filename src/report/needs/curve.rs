//! Quality of held-out views over splats: what was measured, the law through it, its knee.

use super::{NeedStep, Needs};
use crate::Result;
use crate::report::chart::figure::{ALARM, FRONT, MARGINS, axes, color, failed};
use crate::report::chart::scale::Scale;
use plotters::coord::Shift;
use plotters::prelude::*;

/// Pixels.
const SIZE: (u32, u32) = (1080, 420);

/// Pieces that the law is drawn in.
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
    let steps = &needs.steps;
    let splats = steps.iter().map(|s| s.splats.max(1) as f64);
    let splats = splats.chain(needs.points.iter().map(|p| p[0]));
    let x = Scale::of(splats, true);
    let scores = steps.iter().map(|s| s.psnr_db);
    let y = Scale::of(scores.chain(needs.points.iter().map(|p| p[1])), false);
    let titles = ["splats", "PSNR of held-out training views, dB"];
    let area = axes(canvas, MARGINS, titles, [&x, &y])?;
    let at = |splats: f64, psnr: f64| area.map_coordinate(&(x.place(splats), y.place(psnr)));
    let place = |step: &NeedStep| at(step.splats.max(1) as f64, step.psnr_db);
    if let Some(law) = &needs.law {
        let counts = needs.points.iter().map(|p| p[0]);
        let (least, most) = counts.fold((f64::MAX, 1.0), |(a, b), n| (n.min(a), n.max(b)));
        let ends = [
            least,
            needs.knee.unwrap_or(least).clamp(least / 2.0, 2.0 * most),
        ];
        let (low, high) = (ends[0].min(ends[1]), most.max(ends[1]));
        let piece = |i: u32| low * (high / low).powf(f64::from(i) / f64::from(PIECES));
        let line: Vec<_> = (0..=PIECES)
            .map(|i| at(piece(i), law.at(piece(i))))
            .collect();
        let line = PathElement::new(line, color(1).stroke_width(2));
        canvas.draw(&line).map_err(failed)?;
    }
    let growing = steps.iter().filter(|step| step.without.is_none());
    let course: Vec<_> = growing.map(place).collect();
    canvas
        .draw(&PathElement::new(course.clone(), FRONT.stroke_width(1)))
        .map_err(failed)?;
    let measured = needs.points.iter().map(|p| at(p[0], p[1]));
    let marks = course.into_iter().map(|place| (place, 0));
    for (place, series) in marks.chain(measured.map(|place| (place, 1))) {
        let mark = Circle::new(place, 4, color(series).filled());
        canvas.draw(&mark).map_err(failed)?;
    }
    if let (Some(knee), Some(law)) = (needs.knee, &needs.law) {
        let style = ALARM.stroke_width(2);
        let mark = Circle::new(at(knee, law.at(knee)), 8, style);
        canvas.draw(&mark).map_err(failed)?;
    }
    Ok(())
}
