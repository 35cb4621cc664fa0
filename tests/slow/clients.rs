//! Round trips through splat-transform and gsply, independent readers and writers; `make clients` installs and runs
//! them.

use ashfall::io::splats;
use ashfall::scene::{Axes, Splats};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Formats that both clients read.
const ENDS: [&str; 3] = ["spz", "sog", "compressed.ply"];

/// Splats of degree 3 within the range of every format.
fn scene() -> Splats {
    let count = 600;
    let wave = |i: usize| (i as f32 * 1.37).sin();
    Splats {
        mean: (0..count)
            .map(|i| [3.0 * wave(i), wave(i * 7), 2.0 * wave(i * 3 + 1)])
            .collect(),
        quaternion: (0..count)
            .map(|i| [wave(i), wave(i + 5), wave(i * 2 + 3), 1.1])
            .collect(),
        log_scale: (0..count)
            .map(|i| [wave(i) - 4.0, wave(i + 2) - 3.0, wave(i + 4) - 5.0])
            .collect(),
        opacity_logit: (0..count).map(|i| 3.0 * wave(i * 5)).collect(),
        sh: (0..48 * count).map(|i| 0.4 * wave(i * 11)).collect(),
        sh_degree: 3,
        ..Splats::default()
    }
}

/// Program that converts scene files.
struct Client {
    /// Ends of the names of files that it writes.
    written: &'static [&'static str],
    command: fn() -> Command,
}

const SPLAT_TRANSFORM: Client = Client {
    written: &ENDS,
    command: || {
        let mut command = Command::new(installed("SPLAT_TRANSFORM"));
        command.args(["-w", "-g", "cpu"]);
        command
    },
};

/// gsply writes no SOG.
const GSPLY: Client = Client {
    written: &["spz", "compressed.ply"],
    command: || {
        let mut command = Command::new(installed("GSPLY_PYTHON"));
        command.args(["-c", GSPLY_CONVERSION]);
        command
    },
};

/// Converts the file of the first argument to that of the second.
const GSPLY_CONVERSION: &str = "
import sys, gsply
from gsply.sog_reader import sogread
source, target = sys.argv[1:]
read = {'spz': gsply.read_spz, 'sog': sogread}.get(source.rsplit('.')[-1], gsply.plyread)
write = gsply.write_spz if target.endswith('.spz') else gsply.plywrite
write(target, read(source))
";

/// Program of a client.
fn installed(variable: &str) -> OsString {
    std::env::var_os(variable).unwrap_or_else(|| panic!("{variable} is set by `make clients`"))
}

impl Client {
    fn convert(&self, from: &Path, to: &Path) {
        let output = (self.command)().args([from, to]).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }

    /// Asserts that files of this engine and of the client decode to the same splats in both.
    fn agrees(&self) {
        let folder = tempfile::tempdir().unwrap();
        let source = folder.path().join("source.ply");
        splats::write(&source, &scene()).unwrap();
        for end in ENDS {
            let ours = folder.path().join(format!("ours.{end}"));
            splats::write(&ours, &scene()).unwrap();
            assert_agreement(self, &ours, end);
        }
        for end in self.written {
            let theirs = folder.path().join(format!("theirs.{end}"));
            self.convert(&source, &theirs);
            assert_agreement(self, &theirs, end);
        }
    }
}

/// Asserts that both programs decode a file to the same splats, in its order, to the rounding of floats.
fn assert_agreement(client: &Client, file: &Path, end: &str) {
    let decoded = PathBuf::from(format!("{}.decoded.ply", file.display()));
    client.convert(file, &decoded);
    let ours = splats::read(file).unwrap();
    let mut theirs = splats::read(&decoded).unwrap().splats;
    // Both clients pass over the axes that SPZ 4 states.
    theirs.change_axes(ours.stored.axes, Axes::RDF);
    let ours = ours.splats;
    assert_eq!((ours.len(), ours.sh_degree), (theirs.len(), theirs.sh_degree), "{end}");
    let sigmoid = |logits: &[f32]| -> Vec<f32> { logits.iter().map(|l| 1.0 / (1.0 + (-l).exp())).collect() };
    let pairs = [
        (
            "means",
            ours.mean.as_flattened().to_vec(),
            theirs.mean.as_flattened().to_vec(),
            2e-5,
        ),
        ("scales", ours.log_scale.concat(), theirs.log_scale.concat(), 2e-5),
        // The middle of an interval stands for its end.
        (
            "opacities",
            sigmoid(&ours.opacity_logit),
            sigmoid(&theirs.opacity_logit),
            0.3 / 255.0,
        ),
        ("harmonics", ours.sh.clone(), theirs.sh.clone(), 2e-5),
    ];
    for (name, a, b, bound) in pairs {
        let worst = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst <= bound, "{end}: {name} differ by {worst}");
    }
    for (a, b) in ours.quaternion.iter().zip(&theirs.quaternion) {
        let length = |q: &[f32; 4]| q.iter().map(|v| v * v).sum::<f32>().sqrt();
        let cosine = a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>().abs() / (length(a) * length(b));
        assert!(cosine > 1.0 - 1e-5, "{end}: {a:?}, {b:?}");
    }
}

#[test]
#[ignore = "installs splat-transform from npm: `make clients`"]
fn splat_transform_agrees() {
    SPLAT_TRANSFORM.agrees();
}

#[test]
#[ignore = "installs gsply from PyPI: `make clients`"]
fn gsply_agrees() {
    GSPLY.agrees();
}
