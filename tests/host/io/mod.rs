//! Readers and writers. Fixtures are generated here; comparisons with the shared data read `$ASHFALL_DATA`, and pass
//! without it only if the variable is unset.

mod atomic;
mod camera_lists;
mod camera_lists_faults;
mod camera_paths;
mod checkpoint;
mod colmap;
mod compressed_ply;
mod fixtures;
mod gltf;
mod gltf_faults;
mod gltf_nodes;
mod hostile;
mod images;
mod ksplat;
mod lenses;
mod meshes;
mod obj;
mod photo;
mod ply;
mod resample;
mod sog;
mod sog_faults;
mod splat32;
mod splats;
mod spz;
mod spz_faults;
mod transforms;
mod transforms_faults;

use std::path::{Path, PathBuf};

/// A path in the shared data; `None`, with a printed notice, if there is no data.
fn shared(path: &str) -> Option<PathBuf> {
    let Some(data) = std::env::var_os("ASHFALL_DATA") else {
        println!("ASHFALL_DATA is not set: the comparison with {path} is left out");
        return None;
    };
    let path = Path::new(&data).join(path);
    assert!(path.exists(), "{} is not there", path.display());
    Some(path)
}

/// The message of an error that must name `path`.
fn error_at<T>(result: ashfall::Result<T>, path: &Path) -> String {
    match result {
        Ok(_) => panic!("{} was accepted", path.display()),
        Err(error) => {
            let text = error.to_string();
            assert!(text.contains(&*path.to_string_lossy()), "no file in: {text}");
            text
        }
    }
}

/// Names of the files in a folder.
fn files_in(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let name = |entry: std::io::Result<std::fs::DirEntry>| entry.unwrap().file_name();
    entries.map(|e| name(e).into_string().unwrap()).collect()
}

/// Reads every proper prefix of a file's contents through `read`, at a path of the same name; calls `each` with the
/// length and the result.
fn for_every_prefix<T>(
    contents: &[u8],
    path: &Path,
    read: impl Fn(&Path) -> ashfall::Result<T>,
    mut each: impl FnMut(usize, ashfall::Result<T>),
) {
    for length in 0..contents.len() {
        std::fs::write(path, &contents[..length]).unwrap();
        each(length, read(path));
    }
}
