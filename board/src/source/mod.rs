//! Sources of bursts: cameras, frames of other programs, built-in scenes, environment maps and recordings.

mod adapter;
#[cfg(all(feature = "v4l2", target_os = "linux"))]
pub mod camera;
#[cfg(feature = "maps")]
pub mod env;
mod faults;
mod library;
mod pace;
#[cfg(feature = "server")]
mod photometric;
#[cfg(all(feature = "v4l2", target_os = "linux"))]
pub mod pipe;
mod replay;
mod scene;
mod sensor;

pub use adapter::Adapter;
pub use faults::{Fault, FaultCounts, FaultSource, FaultSpec};
pub use library::{Choice, Library};
pub use pace::Pace;
#[cfg(feature = "server")]
pub use photometric::PhotometricSource;
pub use replay::{MAX_RECORDING_BYTES, ReplaySource};
pub use scene::SceneSource;

use crate::calibration::{Burst, Calibration};
use crate::camera_status::CameraStatus;
use crate::exposure_plan::TimeRange;
use crate::noise::Noise;
use crate::recorded::RecordedError;
use crate::scene::{self as scenes, NAMES};
use hemilux_core::Exposure;
use hemilux_core::mains::Lamps;
use std::path::{Path, PathBuf};

/// The factor from relative units to cd/m2 for radiance and to lux for irradiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lux {
    /// Illuminance per unit of relative irradiance, lux.
    pub factor: f64,
    /// Relative uncertainty of `factor`, with 95 % coverage.
    pub uncertainty: f32,
}

/// A source of bursts of exposures, such as a camera or a recording.
pub trait Source: Send {
    /// Returns the calibration of the source's camera. The value changes only during [`Source::next`], when a camera is connected after the
    /// source was opened.
    fn calibration(&self) -> &Calibration;

    /// Returns the exposures of the frames of the source's bursts, ascending.
    fn exposures(&self) -> Vec<Exposure>;

    /// Returns the photometric factor of the source; `None` if its radiance is relative.
    fn lux(&self) -> Option<Lux> {
        None
    }

    /// Returns the noise of a sample; `None` where it was not measured.
    fn noise(&self) -> Option<Noise> {
        None
    }

    /// Returns the reason why the exposures of the source cannot be changed; `None` if they can.
    fn fixed_exposures(&self) -> Option<&'static str> {
        Some("the source's exposures are fixed")
    }

    /// Returns the range of exposure times that [`Source::set_exposures`] accepts at the source's rate; `None` if the exposures cannot follow
    /// the light.
    fn exposure_range(&self) -> Option<TimeRange> {
        None
    }

    /// Returns true if the exposures follow the light unless settings fix them.
    fn follows_light(&self) -> bool {
        false
    }

    /// Returns notes about the source for its user, such as frames of a recording that are left out.
    fn notes(&self) -> &[String] {
        &[]
    }

    /// Sets the exposure times of the next bursts, seconds, ascending; `None` restores the source's own times.
    ///
    /// # Errors
    /// The reason of a refusal; the exposures are then unchanged.
    fn set_exposures(&mut self, _seconds: Option<&[f64]>) -> Result<(), String> {
        Err(format!("found exposures, expected none: {}", self.fixed_exposures().unwrap_or_default()))
    }

    /// Sets the lamps that light the scene. The longest time of the source's own exposures and of [`Source::exposure_range`] then becomes a
    /// whole number of periods of the lamps, if the exposures can be changed.
    fn set_lamps(&mut self, _lamps: Lamps) {}

    /// Whether each later call of [`Source::next`] with the burst of the call before gives one more frame, which it
    /// [renews](Burst::renew) in place, instead of a whole burst. Returns false for a source that gives whole bursts in any case.
    fn set_sliding(&mut self, _is_sliding: bool) -> bool {
        false
    }

    /// Writes the states and counters of the source's camera into `status`; returns false for a source without a camera.
    fn camera(&self, _status: &mut CameraStatus) -> bool {
        false
    }

    /// Waits for the next burst and fills `burst`, reusing its memory.
    ///
    /// The call returns within half a second, with [`SourceError::NotYet`] if there is no burst by then, so that the caller can do other
    /// work.
    ///
    /// # Errors
    /// [`SourceError`] if there is no valid burst; the next call tries again.
    fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError>;
}

/// Reasons why a source returns no burst.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SourceError {
    /// The next burst is not due yet, which is not a fault.
    #[error("no burst is due")]
    NotYet,
    /// The burst cannot be used; the next one may be valid.
    #[error("{0}")]
    Broken(String),
    /// The source is gone; it may return.
    #[error("{0}")]
    Gone(String),
}

/// A source with its options, as the option `--source` describes it.
#[derive(Clone, Debug, PartialEq)]
pub enum Spec {
    /// A built-in scene of this name.
    Scene(&'static str),
    /// A recorded burst, or a sequence of bursts, in this folder.
    Replay(PathBuf),
    /// An environment map or a folder of them.
    #[cfg(feature = "maps")]
    Env(env::EnvSpec),
    /// A camera through Video4Linux.
    #[cfg(all(feature = "v4l2", target_os = "linux"))]
    Camera(camera::CameraSpec),
    /// A pipe with frames of another program.
    #[cfg(all(feature = "v4l2", target_os = "linux"))]
    Pipe(pipe::PipeSpec),
}

/// Reasons why a source cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The kind of the source is unknown.
    #[error("found '{0}', expected v4l2:PATH, pipe:PATH, scene:NAME, env:PATH or replay:DIR")]
    Unknown(String),
    /// This build of the program does not support cameras.
    #[error("found '{0}', but this build has no V4L2 support: expected scene:NAME or replay:DIR")]
    NoV4l2(String),
    /// The options of an environment map are invalid.
    #[error("env: {0}")]
    MapOptions(String),
    /// The environment map cannot be read.
    #[cfg(feature = "maps")]
    #[error(transparent)]
    Map(#[from] crate::maps::MapError),
    /// The options of a pipe are invalid.
    #[error("{0}")]
    PipeOptions(String),
    /// The options of a camera are invalid.
    #[error("v4l2: {0}")]
    CameraOptions(String),
    /// The camera cannot be used.
    #[cfg(all(feature = "v4l2", target_os = "linux"))]
    #[error(transparent)]
    Camera(#[from] camera::OpenCameraError),
    /// There is no built-in scene of this name.
    #[error("found scene '{0}', expected one of {list}", list = NAMES.join(", "))]
    NoScene(String),
    /// The recording cannot be read.
    #[error(transparent)]
    Recorded(#[from] RecordedError),
}

impl std::str::FromStr for Spec {
    type Err = OpenError;

    fn from_str(text: &str) -> Result<Self, OpenError> {
        match text.split_once(':') {
            Some(("scene", name)) => {
                let known = NAMES.into_iter().find(|n| *n == name);
                known.map(Self::Scene).ok_or_else(|| OpenError::NoScene(name.into()))
            }
            Some(("replay", folder)) if !folder.is_empty() => Ok(Self::Replay(Path::new(folder).into())),
            #[cfg(feature = "maps")]
            Some(("env", name)) => env::EnvSpec::parse(name).map(Self::Env).map_err(OpenError::MapOptions),
            #[cfg(all(feature = "v4l2", target_os = "linux"))]
            Some(("v4l2", name)) => {
                camera::CameraSpec::parse(name).map(Self::Camera).map_err(OpenError::CameraOptions)
            }
            #[cfg(all(feature = "v4l2", target_os = "linux"))]
            Some(("pipe", name)) => {
                pipe::PipeSpec::parse(name).map(Self::Pipe).map_err(OpenError::PipeOptions)
            }
            #[cfg(not(all(feature = "v4l2", target_os = "linux")))]
            Some(("v4l2" | "pipe", _)) => Err(OpenError::NoV4l2(text.into())),
            _ => Err(OpenError::Unknown(text.into())),
        }
    }
}

impl Spec {
    /// Returns the path of the lens file in the options of the source, if they have one.
    #[must_use]
    pub fn lens(&self) -> Option<PathBuf> {
        match self {
            Self::Scene(_) | Self::Replay(_) => None,
            #[cfg(feature = "maps")]
            Self::Env(_) => None,
            #[cfg(all(feature = "v4l2", target_os = "linux"))]
            Self::Camera(spec) => spec.lens(),
            #[cfg(all(feature = "v4l2", target_os = "linux"))]
            Self::Pipe(spec) => spec.lens(),
        }
    }
}

impl std::fmt::Display for Spec {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Scene(name) => write!(f, "scene:{name}"),
            Self::Replay(folder) => write!(f, "replay:{}", folder.display()),
            #[cfg(feature = "maps")]
            Self::Env(spec) => write!(f, "env:{spec}"),
            #[cfg(all(feature = "v4l2", target_os = "linux"))]
            Self::Camera(spec) => write!(f, "v4l2:{spec}"),
            #[cfg(all(feature = "v4l2", target_os = "linux"))]
            Self::Pipe(spec) => write!(f, "pipe:{spec}"),
        }
    }
}

impl Spec {
    /// Returns the name of the source for clients: for files and folders, the last component of the path, without options.
    #[must_use]
    pub fn public_name(&self) -> String {
        let last = |path: &Path| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        match self {
            Self::Scene(name) => format!("scene:{name}"),
            Self::Replay(folder) => format!("replay:{}", last(folder)),
            #[cfg(feature = "maps")]
            Self::Env(spec) => format!("env:{}", last(&spec.path)),
            #[cfg(all(feature = "v4l2", target_os = "linux"))]
            Self::Camera(spec) => format!("v4l2:{}", spec.path().display()),
            #[cfg(all(feature = "v4l2", target_os = "linux"))]
            Self::Pipe(spec) => format!("pipe:{}", last(&spec.path)),
        }
    }
}

/// Opens a source at its default pace.
///
/// # Errors
/// [`OpenError`] where the source cannot be opened.
pub fn open(spec: &Spec) -> Result<Box<dyn Source>, OpenError> {
    match spec {
        Spec::Scene(name) => {
            let scene = scenes::by_name(name).ok_or_else(|| OpenError::NoScene((*name).into()))?;
            Ok(Box::new(SceneSource::new(scene, Pace::TEN_A_SECOND)))
        }
        Spec::Replay(folder) => Ok(Box::new(ReplaySource::open(folder, Pace::TEN_A_SECOND)?)),
        #[cfg(feature = "maps")]
        Spec::Env(spec) => Ok(Box::new(env::EnvSource::open(spec, Pace::TEN_A_SECOND)?)),
        #[cfg(all(feature = "v4l2", target_os = "linux"))]
        Spec::Camera(spec) => {
            Ok(Box::new(camera::CameraSource::open(Box::new(crate::v4l2::real::RealKernel), spec)?))
        }
        #[cfg(all(feature = "v4l2", target_os = "linux"))]
        Spec::Pipe(spec) => Ok(Box::new(pipe::PipeSource::open(spec)?)),
    }
}

/// Opens a source like [`open`], but waits for an absent camera in the background.
///
/// # Errors
/// [`OpenError`] where the source cannot be opened.
pub fn open_or_wait(spec: &Spec) -> Result<Box<dyn Source>, OpenError> {
    match spec {
        #[cfg(all(feature = "v4l2", target_os = "linux"))]
        Spec::Camera(spec) => {
            Ok(Box::new(camera::CameraSource::open_or_wait(Box::new(crate::v4l2::real::RealKernel), spec)?))
        }
        other => open(other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_sources_are_parsed_and_formatted_back() {
        for text in [
            "scene:room",
            "scene:overcast",
            "replay:/tmp/a:b",
            "replay:.",
            "v4l2:/dev/video0,rate=25",
            "pipe:/run/f,lens=l.toml",
            "env:maps/a,b.exr",
            "env:maps,view=whole,every=2",
        ] {
            assert_eq!(text.parse::<Spec>().expect("a source").to_string(), text, "{text}");
        }
    }

    #[test]
    fn other_names_are_refused_on_one_line_with_the_accepted_ones() {
        for text in
            ["", "room", "scene", "scene:", "scene:Room", "replay:", "v4l2:", "pipe:", "env:", "http://x"]
        {
            let error = text.parse::<Spec>().expect_err(text).to_string();
            let tells = ["scene:NAME", "overcast", "v4l2:PATH", "pipe:PATH", "env:PATH"]
                .iter()
                .any(|t| error.contains(t));
            assert!(tells && !error.contains('\n'), "{text}: {error}");
        }
    }

    #[test]
    fn the_public_name_contains_no_folder() {
        let cases = [
            ("scene:sky", "scene:sky"),
            ("replay:/home/ada/office", "replay:office"),
            ("replay:.", "replay:."),
            ("env:/home/ada/hall.exr,view=whole", "env:hall.exr"),
            ("v4l2:/dev/video0,lens=/home/ada/l.toml", "v4l2:/dev/video0"),
            ("pipe:/run/frames,lens=/home/ada/l.toml", "pipe:frames"),
        ];
        for (text, expected) in cases {
            assert_eq!(text.parse::<Spec>().expect(text).public_name(), expected, "{text}");
        }
    }
}
