//! Scatter plots: points with their error bars between two axes, and the Pareto front.

use super::labels::{self, LabelRequest, PixelRect};
use super::plot::{self, ALARM, FONT, FRONT, INK, MARGINS, SvgArea, axes, color, failed, line};
use super::scale::Scale;
use crate::Result;
use plotters::prelude::*;

/// A point of a scatter plot.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Marker {
    /// Index of its series.
    pub(crate) series: usize,
    /// Label; empty for none.
    pub(crate) text: String,
    pub(crate) x: f64,
    pub(crate) y: f64,
    /// Ends of the horizontal bar.
    pub(crate) x_bar: Option<[f64; 2]>,
    /// Ends of the vertical bar.
    pub(crate) y_bar: Option<[f64; 2]>,
    pub(crate) is_default: bool,
    pub(crate) is_broken: bool,
    /// Drawn hollow.
    pub(crate) is_hollow: bool,
}

/// Points between two axes.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct ScatterPlot {
    /// Width and height, pixels.
    pub(crate) size: [u32; 2],
    /// Quantities of the axes with their units.
    pub(crate) titles: [&'static str; 2],
    pub(crate) are_log: [bool; 2],
    pub(crate) markers: Vec<Marker>,
    /// Indices of the markers of the Pareto front, by x; empty for none.
    pub(crate) front: Vec<usize>,
    /// Named horizontal lines.
    pub(crate) levels: Vec<(&'static str, f64)>,
    /// Joins the markers of each series by a solid line.
    pub(crate) are_courses: bool,
    pub(crate) caption: &'static str,
}

impl ScatterPlot {
    /// The plot as an SVG element.
    pub(crate) fn svg(&self) -> Result<String> {
        plot::svg(self.size, |area| self.draw(area))
    }

    fn draw(&self, svg: &SvgArea<'_>) -> Result<()> {
        // Horizontal bars may leave the figure, and so may all bars of courses: a single outlier must not compress the
        // rest.
        let xs = self.markers.iter().map(|m| m.x);
        let heights = |m: &Marker| match (self.are_courses, m.y_bar) {
            (false, Some([low, high])) => [low, m.y, high],
            _ => [m.y; 3],
        };
        let ys = self.markers.iter().flat_map(heights);
        let ys = ys.chain(self.levels.iter().map(|(_, y)| *y));
        let (x, y) = (Scale::of(xs, self.are_log[0]), Scale::of(ys, self.are_log[1]));
        let area = axes(svg, MARGINS, self.titles, [&x, &y])?;
        let at = |mark_x: f64, mark_y: f64| area.map_coordinate(&(x.place(mark_x), y.place(mark_y)));
        let (columns, rows) = area.get_pixel_range();
        let frame = [columns.start, rows.start, columns.end, rows.end];
        for (name, level) in &self.levels {
            let (_, y) = at(0.0, *level);
            let place = level_name(name, y, &self.signs(&at), &frame);
            draw_level(svg, name, place, y, &frame)?;
        }
        self.draw_lines(svg, &at, &frame)?;
        self.draw_markers(svg, &at)?;
        self.draw_names(svg, &at, &frame)
    }

    /// Obstacles of labels: glyphs, and the bars of bounds.
    fn signs(&self, at: &dyn Fn(f64, f64) -> (i32, i32)) -> Vec<PixelRect> {
        let mut signs = Vec::new();
        for mark in &self.markers {
            let (x, y) = at(mark.x, mark.y);
            let radius = if mark.is_default { 9 } else { 6 };
            signs.push([x - radius, y - radius, x + radius, y + radius]);
            if let Some([low, high]) = mark.y_bar {
                let ((_, a), (_, b)) = (at(mark.x, low), at(mark.x, high));
                signs.push([x - 1, a.min(b), x + 2, a.max(b)]);
            }
        }
        signs
    }

    /// Draws the front as steps, the lines of series, and error bars.
    fn draw_lines(&self, svg: &SvgArea<'_>, at: &dyn Fn(f64, f64) -> (i32, i32), frame: &PixelRect) -> Result<()> {
        let mut steps: Vec<(i32, i32)> = Vec::new();
        for &index in &self.front {
            let (x, y) = at(self.markers[index].x, self.markers[index].y);
            // Steps enclose the points dominated by the front.
            steps.extend(steps.last().map(|&(_, before)| (x, before)));
            steps.push((x, y));
        }
        if let Some(&(_, y)) = steps.last() {
            steps.push((frame[2], y));
            line(svg, steps, FRONT.stroke_width(2))?;
        }
        let count = self.markers.iter().map(|m| m.series + 1).max().unwrap_or(0);
        for series in 0..count {
            let markers = self.markers.iter().filter(|m| m.series == series);
            let points = markers.map(|m| at(m.x, m.y)).collect();
            let style = match self.are_courses {
                true => color(series).stroke_width(2),
                false => color(series).mix(0.35).stroke_width(1),
            };
            line(svg, points, style)?;
        }
        for mark in &self.markers {
            let style = match mark.is_broken {
                true => ALARM.stroke_width(2),
                false => color(mark.series).mix(0.55).stroke_width(1),
            };
            if let Some([low, high]) = mark.y_bar {
                let ((x, a), (_, b)) = (at(mark.x, low), at(mark.x, high));
                line(svg, vec![(x, a), (x, b)], style)?;
                line(svg, vec![(x - 3, a), (x + 4, a)], style)?;
                line(svg, vec![(x - 3, b), (x + 4, b)], style)?;
            }
            if let Some([low, high]) = mark.x_bar {
                line(svg, vec![at(low, mark.y), at(high, mark.y)], style)?;
            }
        }
        Ok(())
    }

    fn draw_markers(&self, svg: &SvgArea<'_>, at: &dyn Fn(f64, f64) -> (i32, i32)) -> Result<()> {
        for (index, mark) in self.markers.iter().enumerate() {
            let place = at(mark.x, mark.y);
            let is_filled = !mark.is_hollow && (self.front.is_empty() || self.front.contains(&index));
            plot::draw_glyph(svg, place, mark.series, is_filled)?;
            if mark.is_default {
                let ring = Circle::new(place, 9, INK.stroke_width(2));
                svg.draw(&ring).map_err(failed)?;
            }
            if mark.is_broken {
                plot::alarm(svg, place, 8)?;
            }
        }
        Ok(())
    }

    fn draw_names(&self, svg: &SvgArea<'_>, at: &dyn Fn(f64, f64) -> (i32, i32), frame: &PixelRect) -> Result<()> {
        let named = self.markers.iter().enumerate();
        let named: Vec<(usize, &Marker)> = named.filter(|(_, m)| !m.text.is_empty()).collect();
        let request = |(index, mark): &(usize, &Marker)| {
            let rank = match () {
                () if mark.is_broken => 0,
                () if mark.is_default => 1,
                () if self.front.contains(index) => 2,
                () => 3,
            };
            (at(mark.x, mark.y).into(), mark.text.clone(), rank)
        };
        let requests: Vec<LabelRequest> = named.iter().map(request).collect();
        let signs = self.signs(at);
        let mut obstacles = signs.clone();
        for (name, level) in &self.levels {
            obstacles.push(level_name(name, at(0.0, *level).1, &signs, frame));
        }
        // Labels without any other place may cross long horizontal bars.
        let bar = |mark: &Marker| {
            let [low, high] = mark.x_bar?;
            let ((left, y), (right, _)) = (at(low, mark.y), at(high, mark.y));
            Some([left, y - 1, right, y + 2])
        };
        let bars: Vec<PixelRect> = self.markers.iter().filter_map(bar).collect();
        let placed = labels::place(&requests, frame, &obstacles, &bars);
        for ((_, mark), area) in named.iter().zip(&placed) {
            let Some([left, top, ..]) = area else {
                continue;
            };
            let ink = if mark.is_broken { ALARM } else { color(mark.series) };
            let style = (FONT, 11).into_font().color(&ink);
            let text = Text::new(mark.text.clone(), (*left + 1, *top + 1), style);
            svg.draw(&text).map_err(failed)?;
        }
        Ok(())
    }
}

/// Place of a level's name: above or below the line, as far right as no glyph overlaps.
fn level_name(name: &str, y: i32, signs: &[PixelRect], frame: &PixelRect) -> PixelRect {
    let width = labels::width(name);
    let tops = [y - labels::HEIGHT - 1, y + 2];
    let at = |left: i32, top: i32| [left, top, left + width, top + labels::HEIGHT];
    let rightmost = frame[2] - width;
    let places = (frame[0]..=rightmost).rev().step_by(4);
    let mut places = places.flat_map(|left| tops.map(|top| at(left, top)));
    let is_free = |area: &PixelRect| !signs.iter().any(|sign| labels::overlap(sign, area));
    places.find(is_free).unwrap_or(at(rightmost, tops[0]))
}

/// Draws a dashed horizontal line and its name.
fn draw_level(svg: &SvgArea<'_>, name: &str, place: PixelRect, y: i32, frame: &PixelRect) -> Result<()> {
    for left in (frame[0]..frame[2]).step_by(10) {
        let dash = vec![(left, y), ((left + 6).min(frame[2]), y)];
        line(svg, dash, INK.stroke_width(1))?;
    }
    let style = (FONT, 11).into_font().color(&INK);
    let text = Text::new(name.to_owned(), (place[0], place[1]), style);
    svg.draw(&text).map_err(failed)
}
