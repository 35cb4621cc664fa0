//! Checks of names in files that name others.

use std::path::{Component, Path, PathBuf};

/// Result of a check without the file's name, which the caller adds.
pub(super) type Check<T> = Result<T, String>;

/// `folder`/`name`; refuses a `name` that is absolute or leaves the folder.
pub(super) fn inside(folder: &Path, name: &str) -> Check<PathBuf> {
    let mut parts = Path::new(name).components();
    let tame = parts.all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    // Names are printed, and name the results: control characters are refused.
    if name.is_empty() || name.contains(char::is_control) || !tame {
        return Err(format!(
            "the file name {} is refused: it must be relative and stay inside {}",
            super::reader::excerpt(name),
            folder.display()
        ));
    }
    Ok(folder.join(name))
}
