//! Compiled shaders of a package: the folder `spirv` holds the files that the build script would generate, and a
//! checksum of the sources that they are of. `scripts/package` makes it.

use std::path::{Path, PathBuf};

/// File with the checksum of the sources.
const SOURCES: &str = "sources";

fn fault(path: &Path) -> impl FnOnce(std::io::Error) -> Vec<String> {
    move |error| vec![format!("{}: {error}", path.display())]
}

/// Files of a folder, sorted by name; folders are skipped.
fn files(folder: &Path) -> Result<Vec<PathBuf>, Vec<String>> {
    let entries = std::fs::read_dir(folder).map_err(fault(folder))?;
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.map_err(fault(folder))?.path();
        if path.is_file() {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// FNV-1a over the names and contents of all shaders.
fn checksum(glsl: &Path) -> Result<String, Vec<String>> {
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for folder in [glsl.to_owned(), glsl.join("shared")] {
        for path in files(&folder)? {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let text = std::fs::read_to_string(&path).map_err(fault(&path))?;
            // Line ends may have been changed on the way.
            for byte in name.bytes().chain(text.bytes().filter(|&byte| byte != b'\r')) {
                hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
            }
        }
    }
    Ok(format!("{hash:016x}\n"))
}

/// Writes the checksum of the sources beside the files generated from them.
///
/// # Errors
/// Those of files, one line each.
#[cfg_attr(
    not(feature = "compile"),
    allow(dead_code, reason = "for builds that compile shaders")
)]
pub(crate) fn sign(glsl: &Path, out: &Path) -> Result<(), Vec<String>> {
    let path = out.join(SOURCES);
    std::fs::write(&path, checksum(glsl)?).map_err(fault(&path))
}

/// Copies the files of a package to `out`.
///
/// # Errors
/// Those of files; a folder that is absent or of other sources.
#[cfg_attr(
    feature = "compile",
    allow(dead_code, reason = "for builds with a package's shaders")
)]
pub(crate) fn take(glsl: &Path, spirv: &Path, out: &Path) -> Result<(), Vec<String>> {
    let signed = match std::fs::read_to_string(spirv.join(SOURCES)) {
        Ok(signed) => signed,
        Err(_) => {
            let what = "no compiled shaders: packages have them in `spirv`; a checkout is built with the feature \
                        `compile`, which needs a C++ compiler, CMake and Python";
            return Err(vec![what.to_owned()]);
        }
    };
    if signed != checksum(glsl)? {
        return Err(vec![format!(
            "{} is of other shaders than those of glsl: run scripts/package",
            spirv.display()
        )]);
    }
    for path in files(spirv)? {
        let to = out.join(path.file_name().unwrap_or_default());
        std::fs::copy(&path, &to).map_err(fault(&path))?;
    }
    Ok(())
}
