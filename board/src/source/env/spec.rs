//! An environment map as a source: `env:PATH[,OPTION=VALUE]...`.

use std::fmt;
use std::path::PathBuf;

/// Range of the time for which a map of a folder is shown, seconds.
const SECONDS: std::ops::RangeInclusive<f64> = 0.1..=86_400.0;

/// The simulated camera that renders a map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum View {
    /// The standard lens of 160 x 140 degrees, with a sensor of 8 bits and its noise.
    #[default]
    Lens,
    /// An ideal lens for the upper hemisphere, with a sensor of 16 bits without noise.
    Whole,
}

/// The path of a map or of a folder of maps, and the options of the source.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvSpec {
    /// Path of a map file or of a folder.
    pub path: PathBuf,
    /// The simulated camera that renders the maps.
    pub view: View,
    /// Time for which each map of a folder is shown, seconds.
    pub every_s: f64,
}

impl EnvSpec {
    /// Parses `text`, the part of a source's name behind `env:`. A comma belongs to the path unless an option follows it.
    ///
    /// # Errors
    /// The text that was found and the form that was expected.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut spec = Self { path: PathBuf::new(), view: View::default(), every_s: *SECONDS.start() };
        let mut path = text;
        while let Some((before, option)) = path.rsplit_once(',')
            && let Some((name, value)) = option.split_once('=')
            && !option.contains('/')
        {
            spec.set(name, value)?;
            path = before;
        }
        if path.is_empty() {
            return Err(
                "found no file, expected env:PATH, a map (.exr, .hdr or .pfm) or a folder of maps".into()
            );
        }
        spec.path = path.into();
        Ok(spec)
    }

    fn set(&mut self, name: &str, value: &str) -> Result<(), String> {
        match (name, value) {
            ("view", "lens") => self.view = View::Lens,
            ("view", "whole") => self.view = View::Whole,
            ("view", _) => return Err(format!("found view={value}, expected lens or whole")),
            ("every", _) => {
                let seconds = value.parse().ok().filter(|s| SECONDS.contains(s));
                let (least, most) = (SECONDS.start(), SECONDS.end());
                self.every_s = seconds
                    .ok_or_else(|| format!("found every={value}, expected {least} to {most} seconds"))?;
            }
            _ => return Err(format!("found the map option '{name}', expected view or every")),
        }
        Ok(())
    }
}

impl fmt::Display for EnvSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path.display())?;
        if self.view == View::Whole {
            write!(f, ",view=whole")?;
        }
        if self.every_s > *SECONDS.start() { write!(f, ",every={}", self.every_s) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn options_follow_the_path_and_a_path_may_hold_commas() {
        for text in ["a.exr", "a,b.hdr", "/x,y=z/a.pfm,view=whole", "maps,view=whole,every=2.5"] {
            assert_eq!(EnvSpec::parse(text).expect(text).to_string(), text);
        }
        let spec = EnvSpec::parse("a,b.hdr,every=3,view=lens").expect("a map");
        assert_eq!((spec.path.as_path(), spec.every_s), (Path::new("a,b.hdr"), 3.0));
    }

    #[test]
    fn wrong_options_are_refused_by_name() {
        let cases = ["", ",view=lens", "a,view=all", "a,every=0", "a,every=x", "a,size=3"];
        let named = ["no file", "no file", "view=all", "every=0", "every=x", "'size'"];
        for (text, named) in cases.into_iter().zip(named) {
            let error = EnvSpec::parse(text).expect_err(text);
            assert!(error.contains(named) && error.contains("expected"), "{text}: {error}");
        }
    }
}
