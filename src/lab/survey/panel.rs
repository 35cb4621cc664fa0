//! Quality over splats of one scene: a mark for every run, and what the runs to its needs have measured on their way.

use super::{Recipe, Run, Survey};
use crate::Result;
use crate::lab::chart::figure::{ALARM, MARGINS, axes, color, draw_glyph, failed};
use crate::lab::chart::scale::Scale;
use crate::lab::report::curve::{ends, of_law};
use plotters::coord::Shift;
use plotters::prelude::*;

/// Pixels.
const SIZE: (u32, u32) = (532, 390);

/// How far the axis of counts goes beyond them, by factor.
const ROOM: f64 = 1.25;

type Canvas<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// The sign of a recipe.
pub(super) fn series(recipe: Recipe) -> usize {
    recipe as usize
}

/// What a run measured on its way, at the level of its test views.
struct Course {
    points: Vec<[f64; 2]>,
    line: Vec<[f64; 2]>,
    knee: Option<[f64; 2]>,
}

/// The figure.
pub(super) fn svg(survey: &Survey, scene: &str) -> Result<String> {
    let mut text = String::new();
    let canvas = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
    draw(survey, scene, &canvas)?;
    canvas.present().map_err(failed)?;
    drop(canvas);
    Ok(text)
}

fn draw(survey: &Survey, scene: &str, canvas: &Canvas<'_>) -> Result<()> {
    canvas.fill(&WHITE).map_err(failed)?;
    let runs = survey.runs.iter().filter(|run| run.scene == scene);
    let mark = |run: &Run| Some((run.recipe, [run.splats.max(1) as f64, run.psnr_db?]));
    let marks: Vec<(Recipe, [f64; 2])> = runs.filter_map(mark).collect();
    let courses: Vec<Course> = survey
        .of(scene, Recipe::Parsimony)
        .filter_map(course)
        .collect();
    let measured = courses
        .iter()
        .flat_map(|course| course.points.iter().chain(&course.line));
    let all: Vec<[f64; 2]> = marks
        .iter()
        .map(|(_, at)| *at)
        .chain(measured.copied())
        .collect();
    // Room on both sides, so that counts close to each other have an axis with several marks.
    let counts = all.iter().flat_map(|at| [at[0] / ROOM, at[0] * ROOM]);
    let x = Scale::of(counts, true);
    let y = Scale::of(all.iter().map(|at| at[1]), false);
    let titles = ["splats", "PSNR of test views, dB"];
    let area = axes(canvas, MARGINS, titles, [&x, &y])?;
    let at = |[splats, psnr]: [f64; 2]| area.map_coordinate(&(x.place(splats), y.place(psnr)));
    let ink = color(series(Recipe::Parsimony));
    for course in &courses {
        let line: Vec<(i32, i32)> = course.line.iter().map(|&place| at(place)).collect();
        let line = PathElement::new(line, ink.mix(0.7).stroke_width(1));
        canvas.draw(&line).map_err(failed)?;
        for &place in &course.points {
            let dot = Circle::new(at(place), 2, ink.mix(0.7).filled());
            canvas.draw(&dot).map_err(failed)?;
        }
        if let Some(knee) = course.knee {
            let ring = Circle::new(at(knee), 8, ALARM.stroke_width(1));
            canvas.draw(&ring).map_err(failed)?;
        }
    }
    for (recipe, place) in marks {
        let (px, py) = at(place);
        draw_glyph(
            canvas,
            [px, py],
            series(recipe),
            recipe == Recipe::Parsimony,
        )?;
    }
    Ok(())
}

/// What the run measured, moved so that it goes through the run's own mark: held-out training views and test views are
/// other views, with other decibels.
fn course(run: &Run) -> Option<Course> {
    let points: Vec<[f64; 2]> = run
        .point_splats
        .iter()
        .zip(&run.point_db)
        .map(|(&splats, &psnr)| [splats, psnr])
        .collect();
    let nearest = |splats: f64| {
        let apart = |point: &[f64; 2]| (point[0] / splats).ln().abs();
        points
            .iter()
            .copied()
            .min_by(|a, b| apart(a).total_cmp(&apart(b)))
    };
    let splats = run.splats.max(1) as f64;
    let law = run.law();
    let level = match &law {
        Some(law) => law.at(splats),
        None => nearest(splats)?[1],
    };
    let rise = run.psnr_db? - level;
    let raised = |[splats, psnr]: [f64; 2]| [splats, psnr + rise];
    // What the law says of the run's own count and of the knee is worth drawing; of one far away it says nothing.
    let own = points.iter().copied().chain([[splats, level]]);
    let ends = ends(&own.collect::<Vec<_>>(), run.knee);
    let line = law.map_or(Vec::new(), |law| of_law(&law, ends));
    let is_near = |knee: &f64| (ends[0]..=ends[1]).contains(knee);
    let knee = law
        .zip(run.knee.filter(is_near))
        .map(|(law, knee)| raised([knee, law.at(knee)]));
    Some(Course {
        points: points.into_iter().map(raised).collect(),
        line: line.into_iter().map(raised).collect(),
        knee,
    })
}

#[cfg(test)]
mod tests {
    use super::super::tests::run;
    use super::*;

    #[test]
    fn what_was_measured_goes_through_the_runs_own_mark() {
        let measured = Run {
            law: vec![30.0, 1_000.0, 1.0],
            knee: Some(400.0),
            point_splats: vec![800.0, 500.0],
            point_db: vec![28.75, 28.0],
            ..run("a", Recipe::Parsimony, 0, 500, 33.0)
        };
        let found = course(&measured);
        let found = found.as_ref();
        assert_eq!(
            found.map(|c| c.points.clone()),
            Some(vec![[800.0, 33.75], [500.0, 33.0]])
        );
        let ends = found.and_then(|c| Some([*c.line.first()?, *c.line.last()?]));
        let near = |[low, high]: [[f64; 2]; 2]| {
            (low[0] - 400.0).abs() < 1e-9 && (low[1] - 32.5).abs() < 1e-9 && high[0] > 799.9
        };
        assert!(ends.is_some_and(near), "{ends:?}");
        assert_eq!(found.and_then(|c| c.knee), Some([400.0, 32.5]));
        let far = Run {
            knee: Some(1e6),
            ..measured.clone()
        };
        let far = course(&far).map(|c| (c.knee, c.line.last().map(|end| end[0].round())));
        assert_eq!(far, Some((None, Some(1_600.0))));
        // Without a law the point at the run's own count is what it went through.
        let lawless = Run {
            law: Vec::new(),
            knee: None,
            ..measured
        };
        let found = course(&lawless).map(|c| (c.points, c.line.len(), c.knee));
        assert_eq!(found, Some((vec![[800.0, 33.75], [500.0, 33.0]], 0, None)));
        assert!(course(&run("a", Recipe::Parsimony, 0, 5, 30.0)).is_none());
    }
}
