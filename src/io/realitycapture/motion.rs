//! The table with other poses.

use super::{CameraRow, TableColumns, is_header};
use glam::{DMat3, DQuat, DVec3};

/// The table with the cameras of some labels moved, by a turn of the world about the camera and a shift of its centre,
/// and all else as it was. `None` if it is no table.
pub(in super::super) fn moved(text: &str, motion: &dyn Fn(&str) -> Option<(DQuat, DVec3)>) -> Option<String> {
    let (mut columns, mut result) = (None, String::new());
    for line in text.split_inclusive('\n') {
        let row = line.trim_end_matches(['\n', '\r']);
        match &columns {
            None if is_header(row) => columns = Some(TableColumns::of(row).ok()?),
            Some(columns) if !row.trim().is_empty() => {
                let camera = CameraRow::of(row, columns).ok()?;
                if let Some(motion) = motion(camera.name) {
                    result += &moved_row(row, &camera, columns, motion)?;
                    result += &line[row.len()..];
                    continue;
                }
            }
            _ => {}
        }
        result += line;
    }
    columns.map(|_| result)
}

fn moved_row(line: &str, row: &CameraRow<'_>, columns: &TableColumns, (turn, shift): (DQuat, DVec3)) -> Option<String> {
    let pose = row.pose().ok()?;
    let world_from_view = (pose.rotation * DMat3::from_quat(turn)).transpose();
    let [heading, pitch, roll] = angles(world_from_view);
    let [x, y, alt] = (pose.position + shift).to_array();
    let mut fields: Vec<String> = line.split(',').map(str::to_owned).collect();
    for (column, value) in [
        ("x", x),
        ("y", y),
        ("alt", alt),
        ("heading", heading),
        ("pitch", pitch),
        ("roll", roll),
    ] {
        fields[*columns.places.get(column)?] = value.to_string();
    }
    Some(fields.join(","))
}

/// Heading, pitch and roll in degrees of a pose with the camera's axes x right, y down and z forward.
fn angles(world_from_view: DMat3) -> [f64; 3] {
    let DMat3 { x_axis, y_axis, z_axis } = world_from_view;
    let (x, y, z) = (x_axis, -y_axis, -z_axis);
    let pitch = y.z.atan2(y.x.hypot(y.y));
    // Upright cameras leave only the sum of the other turns: it is the heading then.
    let [heading, roll] = match y.x.hypot(y.y) < 1e-12 {
        true => [-x.y.atan2(x.x), 0.0],
        false => [y.x.atan2(y.y), (-x.z).atan2(z.z)],
    };
    [heading, pitch, roll].map(f64::to_degrees)
}

#[cfg(test)]
mod tests {
    use super::super::turn;
    use super::*;

    #[test]
    fn angles_are_those_of_the_turn() {
        for given in [
            [10.0, 85.0, -22.0],
            [-170.0, -30.0, 100.0],
            [60.0, 90.0, 0.0],
            [60.0, 90.0, 35.0],
            [60.0, -90.0, 35.0],
            [0.0, 89.9999999, 1.0],
        ] {
            let DMat3 { x_axis, y_axis, z_axis } = turn(given);
            let found = turn(angles(DMat3::from_cols(x_axis, -y_axis, -z_axis)));
            assert!(found.abs_diff_eq(turn(given), 1e-9), "{given:?}: {found}");
        }
    }
}
