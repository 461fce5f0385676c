//! Shared parts of the command lines of `hemilux` and `hemilux-sim`: errors on one line, completions for shells, and man pages.

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Command, CommandFactory};
pub use clap_complete::Shell;
use std::io;
use std::path::{Path, PathBuf};

/// The text that a program prints for a command line that names no command or is wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Explained {
    /// Text of the help or of the version, which is printed to stdout.
    Help(String),
    /// An error message of one line, for stderr.
    Refused(String),
}

/// Converts `error` to text for users of the program `P`: a refusal is one line with the most similar known word.
#[must_use]
pub fn explain<P: CommandFactory>(error: &clap::Error) -> Explained {
    let command = P::command();
    let program = command.get_name();
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
    let similar = similar(error).map(str::to_owned).or_else(|| similar_option(error, &command));
    let similar = similar.map_or(String::new(), |word| format!("; did you mean '{word}'?"));
    Explained::Refused(format!("{message}{similar} (see {program} --help)"))
}

/// Returns the known word that clap found most similar to the wrong one.
fn similar(error: &clap::Error) -> Option<&str> {
    let kinds = [ContextKind::SuggestedArg, ContextKind::SuggestedSubcommand, ContextKind::SuggestedValue];
    kinds.iter().find_map(|kind| match error.get(*kind)? {
        ContextValue::String(word) => Some(word.as_str()),
        ContextValue::Strings(words) => words.last().map(String::as_str),
        _ => None,
    })
}

/// Returns the option of the refused command that is most similar to the wrong one. The measure of the library clap finds no short word
/// with two letters exchanged.
fn similar_option(error: &clap::Error, program: &Command) -> Option<String> {
    let Some(ContextValue::String(found)) = error.get(ContextKind::InvalidArg) else { return None };
    let Some(ContextValue::StyledStr(usage)) = error.get(ContextKind::Usage) else { return None };
    let usage = usage.to_string();
    let words = usage.split_whitespace().skip_while(|word| *word != program.get_name()).skip(1);
    let mut command = program;
    for word in words {
        let Some(inner) = command.find_subcommand(word) else { break };
        command = inner;
    }
    let options = command.get_arguments().filter(|option| !option.is_hide_set());
    let similar = closest(found.strip_prefix("--")?, options.filter_map(clap::Arg::get_long))?;
    Some(format!("--{similar}"))
}

/// Returns that of the `known` words which is most similar to `word`, if at most a third of the letters of `word` are wrong, missing, or
/// exchanged with a neighbour.
#[must_use]
pub fn closest<'a>(word: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let most = (word.chars().count() / 3).max(1);
    let measured = known.into_iter().map(|other| (strsim::osa_distance(word, other), other));
    measured
        .filter(|(distance, _)| *distance <= most)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, word)| word)
}

/// Returns the completions of the program `P` for `shell`.
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
/// The path that could not be written, and the error of the operating system.
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
        /// Plants a tree.
        Plant {
            /// Kind of the tree.
            #[arg(long, value_enum)]
            kind: Option<Kind>,
            /// Age of the tree, years.
            #[arg(long)]
            age: Option<u32>,
        },
    }

    #[derive(Clone, Copy, Debug, ValueEnum)]
    enum Kind {
        Maple,
    }

    fn refused(arguments: &[&str]) -> String {
        let error = Grove::try_parse_from(arguments).map(|grove| format!("{grove:?}")).expect_err("refused");
        match explain::<Grove>(&error) {
            Explained::Refused(line) => line,
            Explained::Help(text) => panic!("{text}"),
        }
    }

    #[test]
    fn a_misspelt_word_is_refused_on_one_line_with_the_most_similar_word() {
        for (arguments, similar) in [
            (&["grove", "plnt"][..], "'plant'"),
            (&["grove", "plant", "--kin", "maple"], "'--kind'"),
            (&["grove", "plant", "--knid", "maple"], "'--kind'"),
            (&["grove", "plant", "--ag", "3"], "'--age'"),
            (&["grove", "plant", "--aeg", "3"], "'--age'"),
            (&["grove", "plant", "--kind", "mapel"], "'maple'"),
        ] {
            let line = refused(arguments);
            assert!(line.contains(&format!("did you mean {similar}?")), "{line}");
            assert!(line.ends_with("(see grove --help)") && !line.contains('\n'), "{line}");
        }
        assert_eq!(refused(&["grove"]), "found no command, expected one (see grove --help)");
    }

    #[test]
    fn closest_returns_likely_misspellings_alone() {
        let known = ["adaptive", "q2tree", "pharr"];
        assert_eq!(closest("adaptve", known), Some("adaptive"));
        assert_eq!(closest("hparr", known), Some("pharr"), "swapped");
        assert_eq!(closest("zzz", known), None);
    }

    #[test]
    fn each_command_has_a_page_that_names_its_options() {
        let folder = tempfile::tempdir().expect("a folder");
        let written = man_pages::<Grove>(folder.path()).expect("pages");
        assert_eq!(written.len(), 2, "{written:?}");
        let page = std::fs::read_to_string(folder.path().join("grove-plant.1")).expect("a page");
        assert!(page.contains("\\-\\-kind") && page.contains("Plants a tree"), "{page}");
        let (path, _) = man_pages::<Grove>(Path::new("/nonexistent")).expect_err("no folder");
        assert!(path.starts_with("/nonexistent"), "{path:?}");
    }

    #[test]
    fn completions_name_commands_and_options() {
        let script = String::from_utf8(completions::<Grove>(Shell::Bash)).expect("text");
        assert!(script.contains("plant") && script.contains("--kind"), "{script}");
    }
}
