//! Atomic replacement of files: a new file is written in the same folder and then renamed, so that readers get whole files.

use std::fs;
use std::io;
use std::path::Path;
use std::time::Duration;
use tempfile::NamedTempFile;

const PREFIX: &str = ".hemilux-unfinished-";

/// Age from which a temporary file counts as left over by a killed program.
const ABANDONED: Duration = Duration::from_secs(60);

/// Creates a file with a unique name in `folder`; removes the files that killed programs left there.
///
/// # Errors
/// The error of the file system where the file cannot be created.
pub(crate) fn create(folder: &Path) -> io::Result<NamedTempFile> {
    remove_abandoned(folder);
    tempfile::Builder::new().prefix(PREFIX).tempfile_in(folder)
}

/// Removes the temporary files in `folder` that killed programs left. Errors are ignored: a file that stays does no harm.
fn remove_abandoned(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let is_ours = entry.file_name().to_string_lossy().starts_with(PREFIX);
        let age = || entry.metadata().ok().filter(fs::Metadata::is_file)?.modified().ok()?.elapsed().ok();
        if is_ours && age().is_some_and(|age| age > ABANDONED) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::SystemTime;

    #[test]
    fn abandoned_files_are_removed_and_all_others_kept() {
        let folder = tempfile::tempdir().expect("a folder");
        let old = SystemTime::now() - 2 * ABANDONED;
        for (name, is_old) in [
            (".hemilux-unfinished-a1", true),
            (".hemilux-unfinished-b2", false),
            ("hemilux.toml", true),
            (".hemilux-notes", true),
        ] {
            let file = fs::File::create(folder.path().join(name)).expect("a file");
            if is_old {
                file.set_modified(old).expect("a time");
            }
        }
        fs::create_dir(folder.path().join(".hemilux-unfinished-folder")).expect("a folder");
        let made = create(folder.path()).expect("a file");
        let is_there = |name: &str| folder.path().join(name).exists();
        assert!(made.path().exists() && !is_there(".hemilux-unfinished-a1"));
        assert!(is_there(".hemilux-unfinished-b2") && is_there("hemilux.toml") && is_there(".hemilux-notes"));
    }
}
