//! Curve of a sweep: measurements and bounds over the parameter.

use super::outcome::{Sweep, SweepPoint};
use crate::Result;
use crate::lab::page::plot::{self, axes, color, failed};
use crate::lab::page::scale::Scale;
use plotters::prelude::*;

/// Width and height, pixels.
const SIZE: [u32; 2] = [532, 300];

/// The curve as an SVG element.
pub(super) fn svg(sweep: &Sweep) -> Result<String> {
    let points = &sweep.points;
    let x = Scale::of(points.iter().map(|p| p.x), sweep.is_log);
    let y = Scale::of(points.iter().flat_map(|p| [p.measured, p.bound]), true);
    let titles = [sweep.parameter, sweep.quantity];
    plot::svg(SIZE, |svg| {
        let area = axes(svg, [8, 16, 44, 66], titles, [&x, &y])?;
        let at = |x_value: f64, y_value: f64| area.map_coordinate(&(x.place(x_value), y.place(y_value)));
        let line = |of: fn(&SweepPoint) -> f64, style: ShapeStyle| {
            let places = points.iter().filter(|p| !of(p).is_nan());
            let places: Vec<(i32, i32)> = places.map(|p| at(p.x, of(p))).collect();
            plot::line(svg, places, style)
        };
        line(|p| p.bound, color(1).stroke_width(2))?;
        line(|p| p.measured, color(0).mix(0.5).stroke_width(1))?;
        for point in points {
            // NaN is drawn at the top.
            let shown = match point.measured.is_nan() {
                true => f64::INFINITY,
                false => point.measured,
            };
            let place = at(point.x, shown);
            // Many points are drawn as a line.
            if !point.holds() {
                plot::alarm(svg, place, 6)?;
            } else if points.len() <= 60 {
                let disc = Circle::new(place, 3, color(0).filled());
                svg.draw(&disc).map_err(failed)?;
            }
        }
        Ok(())
    })
}
