//! Figures: points with their error bars between two axes, and the front that nothing beats.

use super::labels::{self, Area, Wish};
use super::scale::Scale;
use crate::{Error, Result};
use plotters::coord::Shift;
use plotters::prelude::*;

/// What an axis shows.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axis {
    /// With the unit.
    pub(super) title: &'static str,
    pub(super) is_log: bool,
}

/// A point.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Mark {
    /// Which series, from 0.
    pub(super) series: usize,
    /// What stands beside it.
    pub(super) text: String,
    pub(super) x: f64,
    pub(super) y: f64,
    /// Ends of the horizontal bar.
    pub(super) x_bar: Option<[f64; 2]>,
    /// Ends of the vertical bar.
    pub(super) y_bar: Option<[f64; 2]>,
    pub(super) is_default: bool,
    pub(super) is_broken: bool,
}

/// See the module.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Figure {
    /// Pixels.
    pub(super) size: [u32; 2],
    pub(super) x: Axis,
    pub(super) y: Axis,
    pub(super) marks: Vec<Mark>,
    /// Marks of the front, by x; empty where none is meant.
    pub(super) front: Vec<usize>,
    /// Heights that are marked all across, by name.
    pub(super) levels: Vec<(&'static str, f64)>,
    /// Whether the marks of a series are joined in their order by a line that is more than a hint.
    pub(super) are_courses: bool,
}

/// Colours that stay apart for colour-blind eyes (Okabe and Ito 2008, without its yellow; three darker ones
/// follow).
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
pub(in crate::lab) const INK: RGBColor = RGBColor(40, 40, 40);
pub(in crate::lab) const GRID: RGBColor = RGBColor(232, 232, 232);
pub(in crate::lab) const FRONT: RGBColor = RGBColor(150, 150, 150);
pub(in crate::lab) const ALARM: RGBColor = RGBColor(200, 0, 0);
pub(in crate::lab) const FONT: &str = "sans-serif";

type Canvas<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// What drawing says when it fails: it writes to memory, so it does not.
pub(in crate::lab) fn failed(error: impl std::fmt::Display) -> Error {
    Error::Config(format!("the figure cannot be drawn: {error}"))
}

/// A series' colour.
pub(in crate::lab) fn color(series: usize) -> RGBColor {
    COLORS[series % COLORS.len()]
}

impl Figure {
    /// The picture.
    pub(super) fn svg(&self) -> Result<String> {
        let mut text = String::new();
        let size = (self.size[0], self.size[1]);
        let canvas = SVGBackend::with_string(&mut text, size).into_drawing_area();
        self.draw(&canvas)?;
        canvas.present().map_err(failed)?;
        drop(canvas);
        Ok(text)
    }

    fn draw(&self, canvas: &Canvas<'_>) -> Result<()> {
        canvas.fill(&WHITE).map_err(failed)?;
        // Horizontal bars may leave the picture, and all of courses: one disturbed measurement must not squeeze the others.
        let xs = self.marks.iter().map(|m| m.x);
        let heights = |m: &Mark| match (self.are_courses, m.y_bar) {
            (false, Some([low, high])) => [low, m.y, high],
            _ => [m.y; 3],
        };
        let ys = self.marks.iter().flat_map(heights);
        let ys = ys.chain(self.levels.iter().map(|(_, y)| *y));
        let (x, y) = (Scale::of(xs, self.x.is_log), Scale::of(ys, self.y.is_log));
        let titles = [self.x.title, self.y.title];
        let area = axes(canvas, MARGINS, titles, [&x, &y])?;
        let at = |mark_x: f64, mark_y: f64| -> [i32; 2] {
            let (px, py) = area.map_coordinate(&(x.place(mark_x), y.place(mark_y)));
            [px, py]
        };
        let (columns, rows) = area.get_pixel_range();
        let frame = [columns.start, rows.start, columns.end, rows.end];
        for (name, level) in &self.levels {
            let y = at(0.0, *level)[1];
            let place = level_name(name, y, &self.signs(&at), &frame);
            draw_level(canvas, name, place, y, &frame)?;
        }
        self.draw_lines(canvas, &at, &frame)?;
        self.draw_marks(canvas, &at)?;
        self.draw_names(canvas, &at, &frame)
    }

    /// What names must not cover: signs, and the bars of bounds.
    fn signs(&self, at: &dyn Fn(f64, f64) -> [i32; 2]) -> Vec<Area> {
        let mut signs = Vec::new();
        for mark in &self.marks {
            let [x, y] = at(mark.x, mark.y);
            let radius = if mark.is_default { 9 } else { 6 };
            signs.push([x - radius, y - radius, x + radius, y + radius]);
            if let Some([low, high]) = mark.y_bar {
                let ([_, a], [_, b]) = (at(mark.x, low), at(mark.x, high));
                signs.push([x - 1, a.min(b), x + 2, a.max(b)]);
            }
        }
        signs
    }

    /// The front as steps, series as hints of lines or as courses, and error bars.
    fn draw_lines(
        &self,
        canvas: &Canvas<'_>,
        at: &dyn Fn(f64, f64) -> [i32; 2],
        frame: &Area,
    ) -> Result<()> {
        let line = |points: Vec<[i32; 2]>, style: ShapeStyle| {
            let points: Vec<(i32, i32)> = points.into_iter().map(|[x, y]| (x, y)).collect();
            canvas
                .draw(&PathElement::new(points, style))
                .map_err(failed)
        };
        let mut steps: Vec<[i32; 2]> = Vec::new();
        for &index in &self.front {
            let [x, y] = at(self.marks[index].x, self.marks[index].y);
            // What is not on the front lies behind the corner.
            steps.extend(steps.last().map(|&[_, before]| [x, before]));
            steps.push([x, y]);
        }
        if let Some(&[_, y]) = steps.last() {
            steps.push([frame[2], y]);
            line(steps, FRONT.stroke_width(2))?;
        }
        let count = self.marks.iter().map(|m| m.series + 1).max().unwrap_or(0);
        for series in 0..count {
            let marks = self.marks.iter().filter(|m| m.series == series);
            let points: Vec<[i32; 2]> = marks.map(|m| at(m.x, m.y)).collect();
            let style = match self.are_courses {
                true => color(series).stroke_width(2),
                false => color(series).mix(0.35).stroke_width(1),
            };
            line(points, style)?;
        }
        for mark in &self.marks {
            let style = match mark.is_broken {
                true => ALARM.stroke_width(2),
                false => color(mark.series).mix(0.55).stroke_width(1),
            };
            if let Some([low, high]) = mark.y_bar {
                let ([x, a], [_, b]) = (at(mark.x, low), at(mark.x, high));
                line(vec![[x, a], [x, b]], style)?;
                line(vec![[x - 3, a], [x + 4, a]], style)?;
                line(vec![[x - 3, b], [x + 4, b]], style)?;
            }
            if let Some([low, high]) = mark.x_bar {
                let ([a, y], [b, _]) = (at(low, mark.y), at(high, mark.y));
                line(vec![[a, y], [b, y]], style)?;
            }
        }
        Ok(())
    }

    fn draw_marks(&self, canvas: &Canvas<'_>, at: &dyn Fn(f64, f64) -> [i32; 2]) -> Result<()> {
        for (index, mark) in self.marks.iter().enumerate() {
            let place = at(mark.x, mark.y);
            let is_filled = self.front.is_empty() || self.front.contains(&index);
            draw_glyph(canvas, place, mark.series, is_filled)?;
            let [x, y] = place;
            if mark.is_default {
                let ring = Circle::new((x, y), 9, INK.stroke_width(2));
                canvas.draw(&ring).map_err(failed)?;
            }
            if mark.is_broken {
                for rise in [-8, 8] {
                    let ends = vec![(x - 8, y - rise), (x + 8, y + rise)];
                    let stroke = PathElement::new(ends, ALARM.stroke_width(3));
                    canvas.draw(&stroke).map_err(failed)?;
                }
            }
        }
        Ok(())
    }

    fn draw_names(
        &self,
        canvas: &Canvas<'_>,
        at: &dyn Fn(f64, f64) -> [i32; 2],
        frame: &Area,
    ) -> Result<()> {
        let named: Vec<(usize, &Mark)> = self
            .marks
            .iter()
            .enumerate()
            .filter(|(_, m)| !m.text.is_empty())
            .collect();
        let wishes: Vec<Wish> = named
            .iter()
            .map(|(index, mark)| Wish {
                at: at(mark.x, mark.y),
                text: mark.text.clone(),
                rank: match () {
                    () if mark.is_broken => 0,
                    () if mark.is_default => 1,
                    () if self.front.contains(index) => 2,
                    () => 3,
                },
            })
            .collect();
        let signs = self.signs(at);
        let mut obstacles = signs.clone();
        for (name, level) in &self.levels {
            obstacles.push(level_name(name, at(0.0, *level)[1], &signs, frame));
        }
        // A disturbed machine draws these across half the figure: names had better lie beside them.
        let bar = |mark: &Mark| {
            let [low, high] = mark.x_bar?;
            let ([left, y], [right, _]) = (at(low, mark.y), at(high, mark.y));
            Some([left, y - 1, right, y + 2])
        };
        let bars: Vec<Area> = self.marks.iter().filter_map(bar).collect();
        let placed = labels::place(&wishes, frame, &obstacles, &bars);
        for ((_, mark), area) in named.iter().zip(&placed) {
            let Some([left, top, ..]) = area else {
                continue;
            };
            let ink = if mark.is_broken {
                ALARM
            } else {
                color(mark.series)
            };
            let style = (FONT, 11).into_font().color(&ink);
            let text = Text::new(mark.text.clone(), (*left + 1, *top + 1), style);
            canvas.draw(&text).map_err(failed)?;
        }
        Ok(())
    }
}

/// Where the name of a height stands: above or below it, as far to the right as no sign is in its way.
fn level_name(name: &str, y: i32, signs: &[Area], frame: &Area) -> Area {
    let width = labels::width(name);
    let tops = [y - labels::HEIGHT - 1, y + 2];
    let at = |left: i32, top: i32| [left, top, left + width, top + labels::HEIGHT];
    let rightmost = frame[2] - width;
    let places = (frame[0]..=rightmost).rev().step_by(4);
    let mut places = places.flat_map(|left| tops.map(|top| at(left, top)));
    let is_free = |area: &Area| !signs.iter().any(|sign| labels::overlap(sign, area));
    places.find(is_free).unwrap_or(at(rightmost, tops[0]))
}

/// A dashed line at a height, and its name.
fn draw_level(canvas: &Canvas<'_>, name: &str, place: Area, y: i32, frame: &Area) -> Result<()> {
    for left in (frame[0]..frame[2]).step_by(10) {
        let dash = vec![(left, y), ((left + 6).min(frame[2]), y)];
        let dash = PathElement::new(dash, INK.stroke_width(1));
        canvas.draw(&dash).map_err(failed)?;
    }
    let style = (FONT, 11).into_font().color(&INK);
    let text = Text::new(name.to_owned(), (place[0], place[1]), style);
    canvas.draw(&text).map_err(failed)
}

/// A series' sign: shapes differ as well as colours.
pub(in crate::lab) fn draw_glyph(
    canvas: &Canvas<'_>,
    [x, y]: [i32; 2],
    series: usize,
    is_filled: bool,
) -> Result<()> {
    let (color, radius) = (color(series), 5);
    let polygon = |corners: &[(i32, i32)]| -> Result<()> {
        let corners: Vec<(i32, i32)> = corners.iter().map(|(dx, dy)| (x + dx, y + dy)).collect();
        let inside = if is_filled { color } else { WHITE };
        let fill = Polygon::new(corners.clone(), inside.filled());
        canvas.draw(&fill).map_err(failed)?;
        let closed = corners.iter().chain(corners.first()).copied();
        let outline = PathElement::new(closed.collect::<Vec<_>>(), color.stroke_width(2));
        canvas.draw(&outline).map_err(failed)
    };
    // Colours repeat after ten, where shapes have moved on by one.
    match (series + series / COLORS.len()) % 5 {
        0 => {
            let inside = if is_filled { color } else { WHITE };
            let disc = Circle::new((x, y), radius, inside.filled());
            canvas.draw(&disc).map_err(failed)?;
            let rim = Circle::new((x, y), radius, color.stroke_width(2));
            canvas.draw(&rim).map_err(failed)
        }
        1 => polygon(&[(-4, -4), (4, -4), (4, 4), (-4, 4)]),
        2 => polygon(&[(0, -6), (5, 4), (-5, 4)]),
        3 => polygon(&[(0, -6), (6, 0), (0, 6), (-6, 0)]),
        _ => polygon(&[(0, 6), (5, -4), (-5, -4)]),
    }
}

/// A series' sign alone, for legends.
pub(in crate::lab) fn glyph(series: usize) -> Result<String> {
    let mut text = String::new();
    let canvas = SVGBackend::with_string(&mut text, (18, 18)).into_drawing_area();
    draw_glyph(&canvas, [9, 9], series, true)?;
    canvas.present().map_err(failed)?;
    drop(canvas);
    Ok(text)
}

/// Pixels around a figure, at its right, for what stands under it and for what stands at its left.
pub(in crate::lab) const MARGINS: [u32; 4] = [10, 18, 46, 70];

/// Draws the axes with their titles; returns where things are drawn between them.
pub(in crate::lab) fn axes<'a>(
    canvas: &DrawingArea<SVGBackend<'a>, Shift>,
    [margin, right, below, left]: [u32; 4],
    [title_x, title_y]: [&str; 2],
    [x, y]: [&Scale; 2],
) -> Result<DrawingArea<SVGBackend<'a>, Cartesian2d<Scale, Scale>>> {
    let mut chart = ChartBuilder::on(canvas)
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
