//! Drawing primitives of all figures: SVG area, axes, colours and glyphs.

use super::scale::Scale;
use crate::{Error, Result};
use plotters::coord::Shift;
use plotters::prelude::*;

/// Colours for colour-blind readers (Okabe and Ito 2008, without its yellow; three darker ones follow).
const COLORS: [RGBColor; 10] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(90, 90, 90),
    RGBColor(102, 51, 153),
    RGBColor(128, 96, 0),
    RGBColor(0, 80, 80),
];
pub(crate) const INK: RGBColor = RGBColor(40, 40, 40);
const GRID: RGBColor = RGBColor(232, 232, 232);
/// Grey of the axes and of the Pareto front.
pub(crate) const FRONT: RGBColor = RGBColor(150, 150, 150);
/// Red of broken bounds.
pub(crate) const ALARM: RGBColor = RGBColor(200, 0, 0);
pub(crate) const FONT: &str = "sans-serif";

/// Pixels above a figure, at its right, below and at its left.
pub(crate) const MARGINS: [u32; 4] = [10, 18, 46, 70];

/// Drawing area of a figure.
pub(crate) type SvgArea<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Area between two axes.
pub(crate) type PlotArea<'a> = DrawingArea<SVGBackend<'a>, Cartesian2d<Scale, Scale>>;

/// The drawing as an SVG element; its size is in pixels.
///
/// # Errors
/// Those of drawing.
pub(crate) fn svg([width, height]: [u32; 2], draw: impl FnOnce(&SvgArea<'_>) -> Result<()>) -> Result<String> {
    let mut text = String::new();
    let area = SVGBackend::with_string(&mut text, (width, height)).into_drawing_area();
    area.fill(&WHITE).map_err(failed)?;
    draw(&area)?;
    area.present().map_err(failed)?;
    drop(area);
    Ok(text)
}

/// Error of drawing; drawing to memory has none.
pub(crate) fn failed(error: impl std::fmt::Display) -> Error {
    Error::Config(format!("the figure cannot be drawn: {error}"))
}

/// A series' colour.
pub(crate) fn color(series: usize) -> RGBColor {
    COLORS[series % COLORS.len()]
}

/// Draws a polyline between points in pixels.
pub(crate) fn line(area: &SvgArea<'_>, points: Vec<(i32, i32)>, style: ShapeStyle) -> Result<()> {
    area.draw(&PathElement::new(points, style)).map_err(failed)
}

/// Draws a red cross at a broken bound.
pub(crate) fn alarm(area: &SvgArea<'_>, (x, y): (i32, i32), radius: i32) -> Result<()> {
    for rise in [-radius, radius] {
        let ends = vec![(x - radius, y - rise), (x + radius, y + rise)];
        line(area, ends, ALARM.stroke_width(3))?;
    }
    Ok(())
}

/// Draws a series' glyph; shapes differ as well as colours.
pub(crate) fn draw_glyph(area: &SvgArea<'_>, (x, y): (i32, i32), series: usize, is_filled: bool) -> Result<()> {
    let color = color(series);
    let inside = if is_filled { color } else { WHITE };
    let polygon = |corners: &[(i32, i32)]| -> Result<()> {
        let corners: Vec<(i32, i32)> = corners.iter().map(|(dx, dy)| (x + dx, y + dy)).collect();
        let fill = Polygon::new(corners.clone(), inside.filled());
        area.draw(&fill).map_err(failed)?;
        let closed = corners.iter().chain(corners.first()).copied();
        line(area, closed.collect(), color.stroke_width(2))
    };
    // Colours repeat after ten, with the next shape.
    match (series + series / COLORS.len()) % 5 {
        0 => {
            for style in [inside.filled(), color.stroke_width(2)] {
                area.draw(&Circle::new((x, y), 5, style)).map_err(failed)?;
            }
            Ok(())
        }
        1 => polygon(&[(-4, -4), (4, -4), (4, 4), (-4, 4)]),
        2 => polygon(&[(0, -6), (5, 4), (-5, 4)]),
        3 => polygon(&[(0, -6), (6, 0), (0, 6), (-6, 0)]),
        _ => polygon(&[(0, 6), (5, -4), (-5, -4)]),
    }
}

/// A series' glyph alone, for legends.
pub(crate) fn glyph(series: usize) -> Result<String> {
    svg([18, 18], |area| draw_glyph(area, (9, 9), series, true))
}

/// Draws the axes with their titles; returns the area between them.
pub(crate) fn axes<'a>(
    area: &SvgArea<'a>,
    [margin, right, below, left]: [u32; 4],
    [title_x, title_y]: [&str; 2],
    [x, y]: [&Scale; 2],
) -> Result<PlotArea<'a>> {
    let mut chart = ChartBuilder::on(area)
        .margin(margin)
        .margin_right(right)
        .x_label_area_size(below)
        .y_label_area_size(left)
        .build_cartesian_2d(x.clone(), y.clone())
        .map_err(failed)?;
    chart
        .configure_mesh()
        .x_desc(title_x)
        .y_desc(title_y)
        .x_labels(x.ticks.len())
        .y_labels(y.ticks.len())
        .bold_line_style(GRID)
        .light_line_style(TRANSPARENT)
        .axis_style(FRONT)
        .label_style((FONT, 12).into_font().color(&INK))
        .axis_desc_style((FONT, 13).into_font().color(&INK))
        .draw()
        .map_err(failed)?;
    Ok(chart.plotting_area().clone())
}
