//! What the command lines of all programs share: refusals on one line, completions for shells, and man pages.

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Command, CommandFactory};
pub use clap_complete::Shell;
use std::io;
use std::path::{Path, PathBuf};

/// What a command line that names no command to run comes to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Explained {
    /// Help or a version, for stdout.
    Help(String),
    /// A refusal of one line.
    Refused(String),
}

/// The text of `error` for users of `program`: a refusal is one line with the most similar known word.
#[must_use]
pub fn explain(error: &clap::Error, program: &str) -> Explained {
    if matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) {
        return Explained::Help(error.render().to_string());
    }
    if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        return Explained::Refused(format!("found no command, expected one (see {program} --help)"));
    }
    let text = error.to_string();
    let lines = text.lines().map(str::trim);
    let lines = lines.take_while(|line| !line.is_empty() && !line.starts_with("Usage:"));
    let message = lines.collect::<Vec<_>>().join(" ");
    let message = message.strip_prefix("error: ").unwrap_or(&message);
    let similar = similar(error).map_or(String::new(), |word| format!("; did you mean '{word}'?"));
    Explained::Refused(format!("{message}{similar} (see {program} --help)"))
}

/// The known word that clap found most similar to the wrong one.
fn similar(error: &clap::Error) -> Option<&str> {
    let kinds = [ContextKind::SuggestedArg, ContextKind::SuggestedSubcommand, ContextKind::SuggestedValue];
    kinds.iter().find_map(|kind| match error.get(*kind)? {
        ContextValue::String(word) => Some(word.as_str()),
        ContextValue::Strings(words) => words.last().map(String::as_str),
        _ => None,
    })
}

/// Least similarity of two words, 0 to 1, that counts as a misspelling.
const SIMILAR: f64 = 0.7;

/// The most similar one of the `known` words.
#[must_use]
pub fn closest<'a>(word: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let scored = known.into_iter().map(|other| (strsim::jaro(word, other), other));
    let best = scored.max_by(|a, b| a.0.total_cmp(&b.0));
    best.filter(|(score, _)| *score > SIMILAR).map(|(_, word)| word)
}

/// The completions of the program `P` for `shell`.
#[must_use]
pub fn completions<P: CommandFactory>(shell: Shell) -> Vec<u8> {
    let mut command = P::command();
    let name = command.get_name().to_owned();
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut command, name, &mut script);
    script
}

/// Writes the man pages of the program `P` and of each of its commands to `folder` and returns their paths.
///
/// # Errors
/// The path that cannot be written and the error of the operating system.
pub fn man_pages<P: CommandFactory>(folder: &Path) -> Result<Vec<PathBuf>, (PathBuf, io::Error)> {
    let command = P::command().disable_help_subcommand(true);
    let name = command.get_name().to_owned();
    let mut written = Vec::new();
    write_page(command, &name, folder, &mut written)?;
    Ok(written)
}

fn write_page(
    mut command: Command,
    name: &str,
    folder: &Path,
    written: &mut Vec<PathBuf>,
) -> Result<(), (PathBuf, io::Error)> {
    command.build();
    for inner in command.get_subcommands().filter(|c| !c.is_hide_set() && c.get_name() != "help") {
        write_page(inner.clone(), &format!("{name}-{}", inner.get_name()), folder, written)?;
    }
    let path = folder.join(format!("{name}.1"));
    let mut page = Vec::new();
    let man = clap_mangen::Man::new(command.display_name(name.to_owned()).name(name.to_owned()));
    let made = man.render(&mut page).and_then(|()| std::fs::write(&path, page));
    made.map_err(|e| (path.clone(), e))?;
    written.push(path);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::{Parser, Subcommand, ValueEnum};

    /// Trees.
    #[derive(Debug, Parser)]
    #[command(name = "grove")]
    struct Grove {
        #[command(subcommand)]
        command: Tree,
    }

    #[derive(Debug, Subcommand)]
    enum Tree {
        /// Plants one.
        Plant {
            /// Its kind.
            #[arg(long, value_enum)]
            kind: Option<Kind>,
        },
    }

    #[derive(Clone, Copy, Debug, ValueEnum)]
    enum Kind {
        Maple,
    }

    fn refused(arguments: &[&str]) -> String {
        let error = Grove::try_parse_from(arguments).map(|grove| format!("{grove:?}")).expect_err("refused");
        match explain(&error, "grove") {
            Explained::Refused(line) => line,
            Explained::Help(text) => panic!("{text}"),
        }
    }

    #[test]
    fn a_misspelt_word_is_refused_on_one_line_with_the_right_one() {
        for (arguments, similar) in [
            (&["grove", "plnt"][..], "'plant'"),
            (&["grove", "plant", "--kin", "maple"], "'--kind'"),
            (&["grove", "plant", "--kind", "mapel"], "'maple'"),
        ] {
            let line = refused(arguments);
            assert!(line.contains(&format!("did you mean {similar}?")), "{line}");
            assert!(line.ends_with("(see grove --help)") && !line.contains('\n'), "{line}");
        }
        assert_eq!(refused(&["grove"]), "found no command, expected one (see grove --help)");
    }

    #[test]
    fn the_closest_word_is_a_likely_misspelling_and_nothing_else() {
        let known = ["adaptive", "q2tree", "pharr"];
        assert_eq!(closest("adaptve", known), Some("adaptive"));
        assert_eq!(closest("zzz", known), None);
    }

    #[test]
    fn each_command_has_a_page_that_names_its_options() {
        let folder = tempfile::tempdir().expect("a folder");
        let written = man_pages::<Grove>(folder.path()).expect("pages");
        assert_eq!(written.len(), 2, "{written:?}");
        let page = std::fs::read_to_string(folder.path().join("grove-plant.1")).expect("a page");
        assert!(page.contains("\\-\\-kind") && page.contains("Plants one"), "{page}");
        let (path, _) = man_pages::<Grove>(Path::new("/nonexistent")).expect_err("no folder");
        assert!(path.starts_with("/nonexistent"), "{path:?}");
    }

    #[test]
    fn completions_name_commands_and_options() {
        let script = String::from_utf8(completions::<Grove>(Shell::Bash)).expect("text");
        assert!(script.contains("plant") && script.contains("--kind"), "{script}");
    }
}
