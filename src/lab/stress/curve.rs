//! A sweep as a figure: what was measured and what was allowed, over the parameter.

use super::outcome::{Point, Sweep};
use crate::Result;
use crate::lab::chart::figure::{ALARM, axes, color, failed};
use crate::lab::chart::scale::Scale;
use plotters::coord::Shift;
use plotters::prelude::*;

/// Pixels.
const SIZE: (u32, u32) = (532, 300);

type Canvas<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// The figure.
pub(super) fn svg(sweep: &Sweep) -> Result<String> {
    let mut text = String::new();
    let canvas = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
    draw(sweep, &canvas)?;
    canvas.present().map_err(failed)?;
    drop(canvas);
    Ok(text)
}

fn draw(sweep: &Sweep, canvas: &Canvas<'_>) -> Result<()> {
    canvas.fill(&WHITE).map_err(failed)?;
    let points = &sweep.points;
    let x = Scale::of(points.iter().map(|p| p.x), sweep.is_log);
    let y = Scale::of(points.iter().flat_map(|p| [p.measured, p.bound]), true);
    let titles = [sweep.parameter, sweep.quantity];
    let area = axes(canvas, [8, 16, 44, 66], titles, [&x, &y])?;
    let at =
        |x_value: f64, y_value: f64| area.map_coordinate(&(x.place(x_value), y.place(y_value)));
    let line = |of: fn(&Point) -> f64, style: ShapeStyle| {
        let places = points.iter().filter(|p| !of(p).is_nan());
        let places: Vec<(i32, i32)> = places.map(|p| at(p.x, of(p))).collect();
        canvas
            .draw(&PathElement::new(places, style))
            .map_err(failed)
    };
    line(|p| p.bound, color(1).stroke_width(2))?;
    line(|p| p.measured, color(0).mix(0.5).stroke_width(1))?;
    for point in points {
        // What is no number stands at the top.
        let shown = if point.measured.is_nan() {
            f64::INFINITY
        } else {
            point.measured
        };
        let (x, y) = at(point.x, shown);
        match point.holds() {
            // Many points are a line.
            true if points.len() > 60 => {}
            true => {
                let disc = Circle::new((x, y), 3, color(0).filled());
                canvas.draw(&disc).map_err(failed)?;
            }
            false => {
                for rise in [-6, 6] {
                    let ends = vec![(x - 6, y - rise), (x + 6, y + rise)];
                    let stroke = PathElement::new(ends, ALARM.stroke_width(3));
                    canvas.draw(&stroke).map_err(failed)?;
                }
            }
        }
    }
    Ok(())
}
