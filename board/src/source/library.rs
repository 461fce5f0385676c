//! The sources to which clients with the token may switch.

use super::Spec;
use crate::scene::NAMES;
use std::path::{Path, PathBuf};

/// Largest number of entries of a library folder that are read.
const MOST: usize = 500;

/// Extensions of the files that are environment maps.
const MAPS: [&str; 4] = ["exr", "hdr", "pic", "pfm"];

/// The source at the start, the built-in scenes, and the contents of the library folders.
#[derive(Clone, Debug, Default)]
pub struct Library {
    own: Option<Spec>,
    folders: Vec<PathBuf>,
}

/// A source of the library and its name for clients.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// The name of the source for clients; it contains no folder of the machine.
    pub name: String,
    /// The source as the option `--source` describes it.
    pub spec: Spec,
}

impl Library {
    /// Creates the library of `own`, the source with which the probe starts, and of the maps, folders of maps and recordings in `folders`.
    #[must_use]
    pub fn new(own: Spec, folders: Vec<PathBuf>) -> Self {
        Self { own: Some(own), folders }
    }

    /// Returns all sources that exist now, each name once.
    #[must_use]
    pub fn choices(&self) -> Vec<Choice> {
        let scenes = NAMES.into_iter().map(Spec::Scene);
        let own = self.own.clone().into_iter();
        let named = own.chain(scenes).map(|spec| Choice { name: spec.public_name(), spec });
        let mut choices: Vec<Choice> = named.chain(self.folders.iter().flat_map(|f| listed(f))).collect();
        let names: Vec<String> = choices.iter().map(|c| c.name.clone()).collect();
        let mut at = 0;
        choices.retain(|choice| {
            at += 1;
            !names[..at - 1].contains(&choice.name)
        });
        choices
    }

    /// Returns the source of the library called `name`.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<Choice> {
        self.choices().into_iter().find(|choice| choice.name == name)
    }
}

/// Returns the sources in `folder`, sorted by name.
fn listed(folder: &Path) -> Vec<Choice> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().take(MOST);
    let mut paths: Vec<PathBuf> = entries.filter_map(|e| e.ok().map(|e| e.path())).collect();
    paths.sort();
    paths.iter().flat_map(|path| sources(path)).collect()
}

/// Returns the sources at `path`: a recording, or a map once for each view.
fn sources(path: &Path) -> Vec<Choice> {
    let as_is = |kind: &str, options: &str| {
        let spec: Spec = format!("{kind}:{}{options}", path.to_str()?).parse().ok()?;
        Some(Choice { name: format!("{}{options}", spec.public_name()), spec })
    };
    if is_recording(path) || has(path, is_recording) {
        as_is("replay", "").into_iter().collect()
    } else if is_map(path) || has(path, is_map) {
        [as_is("env", ""), as_is("env", ",view=whole")].into_iter().flatten().collect()
    } else {
        Vec::new()
    }
}

fn is_recording(path: &Path) -> bool {
    path.join("burst.toml").is_file()
}

fn is_map(path: &Path) -> bool {
    let is_known = |end: &std::ffi::OsStr| MAPS.iter().any(|known| end.eq_ignore_ascii_case(known));
    path.extension().is_some_and(is_known) && path.is_file()
}

/// Returns true if `wanted` accepts one of the first [`MOST`] entries of `folder`.
fn has(folder: &Path, wanted: fn(&Path) -> bool) -> bool {
    let entries = folder.is_dir().then(|| std::fs::read_dir(folder).ok()).flatten().into_iter().flatten();
    entries.take(MOST).filter_map(Result::ok).any(|entry| wanted(&entry.path()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn touch(path: PathBuf) {
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        std::fs::write(path, "").expect("a file");
    }

    #[test]
    fn folders_are_listed_by_their_contents_and_other_files_are_not() {
        let root = tempfile::tempdir().expect("a folder");
        for file in
            ["hall.exr", "notes.txt", "walk/0000/burst.toml", "still/burst.toml", "day/a.hdr", "odd/x.txt"]
        {
            touch(root.path().join(file));
        }
        let library = Library::new(Spec::Scene("lamps"), vec![root.path().into()]);
        let names: Vec<_> = library.choices().into_iter().map(|c| c.name).collect();
        let expected = [
            "scene:lamps",
            "scene:room",
            "scene:sky",
            "scene:overcast",
            "env:day",
            "env:day,view=whole",
            "env:hall.exr",
            "env:hall.exr,view=whole",
            "replay:still",
            "replay:walk",
        ];
        assert_eq!(names, expected);
        let found = library.find("replay:walk").expect("a recording").spec;
        assert_eq!(found, Spec::Replay(root.path().join("walk")));
        for other in ["replay:../walk", "env:/etc/hall.exr", "scene:garden", ""] {
            assert_eq!(library.find(other), None, "{other}");
        }
    }
}
