//! RealityCapture's and RealityScan's table of cameras, "Internal/External camera parameters".
//!
//! A CSV file with the columns `#name,x,y,alt,heading,pitch,roll,f` and, if there is a lens, `px,py,k1,k2,k3,k4,t1,t2`,
//! in any order; further columns are passed over. Angles are in degrees, the world has z up.
//!
//! * World from camera, with the camera's x right, y up and z backward, is Rz(−heading) Rx(pitch) Ry(roll), as in
//!   nerfstudio and Brush.
//! * With the longer side L of the photograph, the focal length is f L / 36 pixels (f is that of 35 mm film), and the
//!   principal point is px L, py L from the middle.
//! * k1 to k4 are Brown's radial coefficients. t1 and t2 are the tangential ones in the order of Brown's formula
//!   (t1 (r² + 2 x²) + 2 t2 x y for x), so that t1 is OpenCV's p2 and t2 is p1: AliceVision's import of RealityCapture
//!   exchanges them, too.
//!
//! Sizes are those of the photographs.

mod motion;

use super::check::{Check, inside};
use super::listing::{ListedView, Listing, check_intrinsics, check_position};
use super::photo;
use super::photo_index::{PhotoIndex, file_name, mask_in, masks_of, only_file, photos_beside, points_beside};
use super::pose::Pose;
use super::reader::{Reader, excerpt, parse_number};
use super::source::Source;
use crate::error::{Error, Result};
use crate::scene::{Camera, Lens};
use glam::{DMat3, DVec2, DVec3};
pub(super) use motion::moved;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Longest line accepted, in bytes.
const LINE_BYTES_MAX: u64 = 1 << 16;

/// Columns that must be there.
const NEEDED: [&str; 8] = ["name", "x", "y", "alt", "heading", "pitch", "roll", "f"];

/// Width of 35 mm film in millimetres.
const FILM_WIDTH: f64 = 36.0;

/// The table in a data set's folder, if there is one.
///
/// # Errors
/// Several tables.
pub fn find(folder: &Path) -> Result<Option<PathBuf>> {
    only_file(folder, "csv", |text| text.lines().take(2).any(is_header))
}

fn is_header(line: &str) -> bool {
    let line = line.trim_start_matches('\u{feff}').trim_start();
    line.starts_with("#name") || line.starts_with("\"#name\"")
}

/// Reads a table. Photographs are below `photos` if given, else in `images` beside the file or beside it themselves;
/// points are those of NAME.ply or `points.ply` beside it.
///
/// # Errors
/// Names the file and the line: missing columns, a row of another length, text in place of a number, numbers that are
/// not finite, an impossible focal length, a name that occurs twice or fits several photographs; no photograph at all.
pub fn read<'a>(source: impl Into<Source<'a>>, photos: Option<&Path>) -> Result<Listing> {
    let source = source.into();
    let path = source.name();
    let (folder, index) = photos_beside(path, photos);
    let masks = masks_of(path, &folder);
    let mut reader = Reader::open(source)?;
    let mut line = String::new();
    let columns = header(&mut reader, &mut line)?;
    let (mut listing, mut names, mut missing) = (Listing::default(), BTreeSet::new(), Vec::new());
    while reader.line(&mut line, LINE_BYTES_MAX)? {
        if line.trim().is_empty() {
            continue;
        }
        let row = CameraRow::of(&line, &columns).map_err(|what| reader.fault_in_line(what))?;
        let fault = |what: String| reader.fault_in_line(format!("{}: {what}", excerpt(row.name)));
        let photo = row.photo(&folder, &index).map_err(fault)?;
        if !names.insert(photo.clone().unwrap_or_else(|| row.name.to_owned())) {
            return Err(fault("occurs twice".to_owned()));
        }
        let Some(name) = photo else {
            missing.push(file_name(row.name).to_owned());
            continue;
        };
        let file = folder.join(&name);
        let size = photo::dimensions(&file)?;
        let (camera, lens) = row.camera(size).map_err(fault)?;
        listing.views.push(ListedView {
            mask: mask_in(&masks, &name),
            name,
            photo: file,
            camera,
            lens,
            held_out: false,
            seen: Vec::new(),
        });
    }
    warn_of_missing(path, &folder, &missing, &mut listing)?;
    listing.points = points_beside(path)?;
    Ok(listing)
}

/// Refuses a table without any photograph, and warns of those that are missing.
fn warn_of_missing(path: &Path, folder: &Path, missing: &[String], listing: &mut Listing) -> Result<()> {
    let all = listing.views.len() + missing.len();
    let Some(first) = missing.first() else {
        return match all {
            0 => Err(Error::file(path, "holds no cameras")),
            _ => Ok(()),
        };
    };
    let what = format!(
        "{} of {all} photographs are missing, the first is {} in {}",
        missing.len(),
        excerpt(first),
        folder.display()
    );
    if listing.views.is_empty() {
        return Err(Error::file(path, what));
    }
    listing
        .warnings
        .push(format!("{}: {what}; their views are left out", path.display()));
    Ok(())
}

/// Columns by name, and their number.
struct TableColumns {
    places: BTreeMap<String, usize>,
    count: usize,
}

/// Reads up to the line of column names.
fn header(reader: &mut Reader<'_>, line: &mut String) -> Result<TableColumns> {
    loop {
        if !reader.line(line, LINE_BYTES_MAX)? {
            let what = "has no line of column names that begins with #name";
            return Err(Error::file(reader.path(), what));
        }
        if is_header(line) {
            break;
        }
        // A count of cameras may stand before.
        if !line.trim().is_empty() && !line.starts_with('#') {
            return Err(reader.fault_in_line("comes before the line of column names that begins with #name"));
        }
    }
    TableColumns::of(line).map_err(|what| reader.fault_in_line(what))
}

impl TableColumns {
    fn of(line: &str) -> Check<TableColumns> {
        let names: Vec<String> = fields(line.trim_start_matches('\u{feff}'))
            .map(|name| name.trim_start_matches('#').to_lowercase())
            .collect();
        let count = names.len();
        let places: BTreeMap<String, usize> = names.into_iter().zip(0..).collect();
        if places.len() < count {
            return Err("a column occurs twice".to_owned());
        }
        let missing: Vec<&str> = NEEDED.into_iter().filter(|name| !places.contains_key(*name)).collect();
        match missing.is_empty() {
            true => Ok(TableColumns { places, count }),
            false => Err(format!("the columns {} are missing", missing.join(", "))),
        }
    }
}

fn fields(line: &str) -> impl Iterator<Item = &str> {
    line.split(',').map(|field| field.trim().trim_matches('"'))
}

/// A camera of the table.
struct CameraRow<'a> {
    name: &'a str,
    /// Angles in degrees.
    angles: [f64; 3],
    position: DVec3,
    focal: f64,
    /// Offset of the principal point from the middle, in longer sides.
    offset: DVec2,
    radial: [f64; 4],
    /// t1, t2.
    tangential: [f64; 2],
}

impl<'a> CameraRow<'a> {
    fn of(line: &'a str, columns: &TableColumns) -> Check<CameraRow<'a>> {
        let fields: Vec<&str> = fields(line).collect();
        if fields.len() != columns.count {
            return Err(format!(
                "the row has {} fields, {} columns are named",
                fields.len(),
                columns.count
            ));
        }
        let field = |name: &str| columns.places.get(name).map(|&place| fields[place]);
        let name = field("name").unwrap_or_default();
        let number = |column: &str| {
            let Some(text) = field(column) else {
                return Ok(0.0);
            };
            let value = parse_number(text).filter(|value| value.is_finite());
            value.ok_or_else(|| format!("{}: {column} is {}, not a finite number", excerpt(name), excerpt(text)))
        };
        Ok(CameraRow {
            name,
            angles: [number("heading")?, number("pitch")?, number("roll")?],
            position: DVec3::new(number("x")?, number("y")?, number("alt")?),
            focal: number("f")?,
            offset: DVec2::new(number("px")?, number("py")?),
            radial: [number("k1")?, number("k2")?, number("k3")?, number("k4")?],
            tangential: [number("t1")?, number("t2")?],
        })
    }

    /// Name of the photograph, if it is there.
    fn photo(&self, folder: &Path, index: &PhotoIndex) -> Check<Option<String>> {
        // Control characters and empty names are refused.
        inside(folder, file_name(self.name))?;
        Ok(index.find(self.name)?.map(str::to_owned))
    }

    fn pose(&self) -> Check<Pose> {
        check_position(self.position)?;
        Pose::of_opengl(turn(self.angles), self.position, "the angles")
    }

    fn camera(&self, (width, height): (u32, u32)) -> Check<(Camera, Option<Lens>)> {
        let size = DVec2::new(width.into(), height.into());
        let longer = size.max_element();
        let focal = DVec2::splat(self.focal * longer / FILM_WIDTH);
        let center = 0.5 * size + self.offset * longer;
        check_intrinsics(focal.to_array(), center.to_array())?;
        let pose = self.pose()?;
        let camera = Camera {
            width,
            height,
            focal,
            center,
            rotation: pose.rotation,
            position: pose.position,
        };
        let [t1, t2] = self.tangential;
        let lens = Lens::Polynomial {
            is_angular: false,
            radial: self.radial,
            tangential: [t2, t1],
            shear: 0.0,
        };
        Ok((camera, Some(lens.simplified()).filter(|lens| !lens.is_none())))
    }
}

/// World from camera of heading, pitch and roll in degrees.
fn turn(angles: [f64; 3]) -> DMat3 {
    let [heading, pitch, roll] = angles.map(f64::to_radians);
    DMat3::from_rotation_z(-heading) * DMat3::from_rotation_x(pitch) * DMat3::from_rotation_y(roll)
}
