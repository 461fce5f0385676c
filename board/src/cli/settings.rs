//! One command-line option for each setting of the table, except budgets, which `--budget` sets by stage.

use crate::probe::Config;
use crate::probe::settings::{Change, Group, Kind, SETTINGS, Setting};
use crate::usage;
use clap::{Arg, ArgMatches, Args, Command, Error, FromArgMatches};
use serde_json::Value;

/// The values of settings that the command line states.
#[derive(Clone, Debug, Default)]
pub(super) struct SettingOptions {
    pub(super) change: Change,
}

fn settings() -> impl Iterator<Item = &'static Setting> {
    SETTINGS.iter().filter(|s| s.group != Group::Budgets)
}

/// Returns the command-line option of `setting`, such as `--fir-taps N` for `fir_taps`; a switch without a value is turned on.
fn option(setting: &'static Setting) -> Arg {
    let (unit, default) = (setting.unit.map_or(String::new(), |unit| format!(", {unit}")), default(setting));
    let help = format!("{} {}{unit} [default: {default}]", setting.what, sentence(&setting.expected_word()));
    let parse = move |word: &str| setting.parse(word).ok_or_else(|| refusal(setting, word));
    let arg = Arg::new(setting.name).long(setting.name.replace('_', "-")).help(help).value_parser(parse);
    match setting.kind {
        Kind::Switch => {
            arg.value_name("on|off").num_args(0..=1).require_equals(true).default_missing_value("on")
        }
        Kind::Choice(_) => arg.value_name("NAME"),
        Kind::Whole(..) | Kind::OptionalWhole(..) => arg.value_name("N"),
        Kind::Real(..) | Kind::Optional(..) => arg.value_name("X"),
        Kind::List(..) => arg.value_name("X,X,..."),
    }
}

/// Returns the error text for the value `word`: the values that `setting` accepts, and for a choice the accepted word that is most similar.
fn refusal(setting: &Setting, word: &str) -> String {
    let similar = match setting.kind {
        Kind::Choice(words) => usage::closest(word, words.iter().copied()),
        _ => None,
    };
    let similar = similar.map_or(String::new(), |word| format!("; did you mean '{word}'?"));
    format!("expected {}{similar}", setting.expected_word())
}

fn default(setting: &Setting) -> String {
    match setting.value(&Config::default()) {
        Value::String(text) => text,
        Value::Null | Value::Bool(false) => "off".into(),
        Value::Bool(true) => "on".into(),
        value => value.to_string(),
    }
}

fn sentence(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

impl Args for SettingOptions {
    fn augment_args(command: Command) -> Command {
        command.args(settings().map(option))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for SettingOptions {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        let mut options = Self::default();
        options.update_from_arg_matches(matches)?;
        Ok(options)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        for setting in settings() {
            if let Some(value) = matches.get_one::<Value>(setting.name) {
                let added = self.change.add(setting, value.clone());
                added.map_err(|expected| Error::raw(clap::error::ErrorKind::InvalidValue, expected))?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(arguments: &[&str]) -> Result<Config, Error> {
        let command = SettingOptions::augment_args(Command::new("test"));
        let matches = command.try_get_matches_from([&["test"], arguments].concat())?;
        let mut config = Config::default();
        SettingOptions::from_arg_matches(&matches)?.change.apply(&mut config);
        Ok(config)
    }

    #[test]
    fn options_set_settings_and_absent_options_leave_defaults() {
        assert_eq!(config(&[]).expect("no option"), Config::default(), "defaults");
        let set = config(&["--fir-taps", "9", "--ambient", "--order", "5", "--exposures-s", "0.001,0.02"]);
        let set = set.expect("four settings");
        assert_eq!((set.pipeline.tuning.taps, set.pipeline.ambient, set.pipeline.order), (9, true, Some(5)));
        assert_eq!(set.exposures_s, Some(vec![0.001, 0.02]));
        let off = config(&["--ambient=off", "--order", "off"]).expect("off");
        assert_eq!((off.pipeline.ambient, off.pipeline.order), (false, None));
    }

    #[test]
    fn values_out_of_range_are_refused_with_the_range() {
        for (arguments, expected) in [
            (["--fir-taps", "64"], "a whole number from 1 to 63"),
            (["--order", "3"], "a whole number from 4 to 7, or off"),
            (["--extrapolation", "some"], "one of none, average"),
        ] {
            let error = config(&arguments).expect_err("out of range").to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
