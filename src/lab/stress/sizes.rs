//! Pictures of all shapes: one pixel, one row, one column, up to longer than the largest displays.

use super::outcome::{CheckGroup, Sweep, SweepPoint};
use super::{OF_RANGE, StressRun, subject, thumbnail};
use crate::scene::Camera;
use crate::{Error, Result};
use glam::DVec2;

const SIZES: [[u32; 2]; 16] = [
    [1, 1],
    [2, 1],
    [1, 3],
    [7, 5],
    [1, 17],
    [17, 1],
    [8, 16],
    [33, 47],
    [129, 97],
    [257, 5],
    [640, 480],
    [4096, 1],
    [1, 4096],
    [1920, 1080],
    [1, 16_385],
    [16_385, 1],
];

/// Side of the largest square picture of a quick run, pixels.
const QUICK: u32 = 700;

pub(super) fn run(lab: &mut StressRun<'_>) -> Result<()> {
    let (mut points, mut thumbnails) = (Vec::new(), Vec::new());
    for [width, height] in SIZES {
        // Limited by area, because the longest pictures are the purpose and have few pixels.
        if lab.plan.is_quick && width * height > QUICK * QUICK {
            continue;
        }
        let camera = shaped(lab.subject.camera(), width, height);
        let name = format!("{width} × {height}");
        let (image, [measured, bound]) = match lab.look(lab.subject, &camera) {
            // Out of memory is a correct answer of a small device.
            Err(error @ Error::OutOfMemory { .. }) => {
                lab.found.facts.push((name, format!("left out: {error}")));
                continue;
            }
            looked => looked?,
        };
        let all = (width * height) as usize;
        let what = match lab.plan.pixels < all {
            true => format!("{} of its pixels", lab.plan.pixels),
            false => "all its pixels".into(),
        };
        lab.at_most(&name, what, [measured, bound], OF_RANGE);
        points.push(SweepPoint {
            x: f64::from(width.max(height)),
            measured,
            bound,
        });
        if width.min(height) > 4 && width.max(height) < 700 {
            thumbnails.push(thumbnail(name, &image));
        }
    }
    points.sort_by(|a, b| a.x.total_cmp(&b.x));
    // Of pictures with one length, the one closest to its bound.
    points.dedup_by(|b, a| {
        let is_one = a.x == b.x;
        if is_one && b.share().total_cmp(&a.share()).is_gt() {
            *a = *b;
        }
        is_one
    });
    lab.found.sweeps.push(Sweep {
        group: CheckGroup::Sizes,
        title: "Error over size",
        parameter: "longer side, px",
        is_log: true,
        quantity: "error, of 1",
        caption: "The longer side shows as much of the scene as the first view's does, so that all of its splats grow with it.",
        points,
        thumbnails,
    });
    Ok(())
}

/// A camera of another shape; its longer side covers as much of the scene as that of the first.
fn shaped(camera: &Camera, width: u32, height: u32) -> Camera {
    let factor = f64::from(width.max(height)) / f64::from(camera.width.max(camera.height));
    subject::exact(&Camera {
        width,
        height,
        focal: camera.focal * factor,
        center: 0.5 * DVec2::new(f64::from(width), f64::from(height)),
        ..*camera
    })
}
