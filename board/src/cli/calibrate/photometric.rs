//! `hemilux calibrate photometric`: measures the factor from relative radiance to candela per square metre.

use super::{Failure, say};
use crate::calibrate::{
    FactorReading, Kept, KeptReadings, Method, Unseen, Verdict, keep_reading, kept_factor, measure,
};
use crate::recorded::{ANY_CLASS, radiometry};
use crate::source::{self, Spec};
use clap::{Args, ValueEnum};
use glam::DVec2;
use std::fmt::Write;
use std::path::PathBuf;

/// Usual error limit of a luxmeter, percent.
const METER_PERCENT: f64 = 5.0;

#[derive(Debug, Args)]
pub(super) struct PhotometricOptions {
    /// The source, with the lens file that the probe will use.
    #[arg(long, value_parser = str::parse::<Spec>)]
    source: Spec,
    /// Direct: reading of a luxmeter next to the probe and level with it, lux.
    #[arg(long, value_name = "LUX", value_parser = positive, conflicts_with = "patch", required_unless_present = "patch")]
    lux: Option<f64>,
    /// Direct: assumed radiance of the part of the hemisphere outside of the lens's field of view.
    #[arg(long, value_enum, default_value = "rim")]
    unseen: Lies,
    /// Indirect: outline of a matt patch in the image, pixels, at least three corners in order.
    #[arg(long, value_name = "X,Y/X,Y/...", value_parser = outline, requires = "reflectance", requires = "illuminance")]
    patch: Option<Outline>,
    /// Indirect: reflectance of the patch, such as 0.18.
    #[arg(long, value_name = "SHARE", value_parser = share, requires = "patch")]
    reflectance: Option<f64>,
    /// Indirect: reading of a luxmeter that lies on the patch, lux.
    #[arg(long, value_name = "LUX", value_parser = positive, requires = "patch")]
    illuminance: Option<f64>,
    /// Class of the light source: readings of one class are combined; `serve --light-class` selects a class.
    #[arg(long, value_name = "NAME", default_value = ANY_CLASS, value_parser = class)]
    class: String,
    /// Number of bursts that are averaged.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u16).range(1..=1000))]
    bursts: u16,
    /// Error limit of the luxmeter, percent of its reading.
    #[arg(long, value_name = "PERCENT", default_value_t = METER_PERCENT, value_parser = positive)]
    meter_percent: f64,
    /// Error limit of the reflectance, percent of its value.
    #[arg(long, value_name = "PERCENT", default_value_t = 3.0, value_parser = positive)]
    reflectance_percent: f64,
    /// The calibration file, such as the lens file; its other tables are kept.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Compare the reading with the calibration in the file, which is not changed: a difference below 10 % is good, one above 25 % is a
    /// failure.
    #[arg(long)]
    check: bool,
    /// Drop the earlier readings of the class, and all readings of another camera.
    #[arg(long, conflicts_with = "check")]
    fresh: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Lies {
    /// At each azimuth, the radiance at the rim of the field of view.
    Rim,
    /// The mean radiance of the field of view.
    Average,
    /// No light from outside of the field of view.
    Dark,
}

/// Corners of a patch of known reflectance in the image, pixels.
#[derive(Clone, Debug)]
struct Outline(Vec<DVec2>);

fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|v: &f64| v.is_finite())
}

fn positive(text: &str) -> Result<f64, String> {
    number(text).filter(|v| *v > 0.0).ok_or_else(|| "expected a positive number".into())
}

fn share(text: &str) -> Result<f64, String> {
    number(text).filter(|v| *v > 0.0 && *v <= 1.0).ok_or_else(|| "expected a share above 0, at most 1".into())
}

fn class(text: &str) -> Result<String, String> {
    let fits = !text.is_empty() && text.len() <= 32;
    let plain = text.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-');
    if fits && plain { Ok(text.into()) } else { Err("expected a name such as daylight, led or warm".into()) }
}

fn outline(text: &str) -> Result<Outline, String> {
    let point = |text: &str| {
        let (x, y) = text.split_once(',')?;
        Some(DVec2::new(number(x)?, number(y)?))
    };
    let points = text.split('/').map(point).collect::<Option<Vec<_>>>().filter(|points| points.len() >= 3);
    points.map(Outline).ok_or_else(|| "expected at least three corners X,Y joined by '/'".into())
}

impl PhotometricOptions {
    fn method(&self) -> Result<Method, Failure> {
        let unseen = match self.unseen {
            Lies::Rim => Unseen::Rim,
            Lies::Average => Unseen::Average,
            Lies::Dark => Unseen::Dark,
        };
        match (self.lux, &self.patch, self.reflectance, self.illuminance) {
            (Some(lux), ..) => Ok(Method::Direct { lux, unseen }),
            (None, Some(Outline(outline)), Some(reflectance), Some(lux)) => {
                Ok(Method::Indirect { outline: outline.clone(), reflectance, lux })
            }
            _ => Err(Failure::usage(
                "found no reading, expected --lux, or --patch with --reflectance and --illuminance",
            )),
        }
    }

    /// Returns the relative standard deviation that is common to all readings with the same luxmeter and patch: half of the error limit.
    fn shared(&self) -> f64 {
        let patch = if self.patch.is_some() { self.reflectance_percent } else { 0.0 };
        self.meter_percent.hypot(patch) / 200.0
    }
}

pub(super) fn run(options: &PhotometricOptions) -> Result<(), Failure> {
    let method = options.method()?;
    let mut source = source::open(&options.source).map_err(Failure::new)?;
    let bursts = usize::from(options.bursts);
    let reading = measure(&mut *source, &method, bursts, options.shared()).map_err(Failure::new)?;
    if options.check {
        return compare(options, &reading);
    }
    let camera = radiometry(source.calibration());
    let kept = Kept { reading: &reading, class: &options.class, camera: &camera };
    let KeptReadings { factor, count } =
        keep_reading(&options.out, &kept, options.fresh).map_err(Failure::new)?;
    let mut text = told(&method, &reading);
    let _ = writeln!(
        text,
        "{count} reading(s) of the class {}: an irradiance of 1 is {:.6} lux within {:.1} %\nwrote {}",
        options.class,
        factor.factor,
        100.0 * factor.uncertainty,
        options.out.display()
    );
    say(&text)
}

fn told(method: &Method, reading: &FactorReading) -> String {
    let within = 200.0 * reading.own.hypot(reading.shared);
    let mut text = format!("this reading: {:.6} lux within {within:.1} %\n", reading.factor);
    if let Method::Direct { unseen, .. } = method {
        let holds = match unseen {
            Unseen::Rim => "as bright as the rim of the view",
            Unseen::Average => "as bright as the mean of the view",
            Unseen::Dark => "dark",
        };
        let _ = writeln!(
            text,
            "{:.1} % of the irradiance of a level surface comes from outside of the lens's field and is assumed to be {holds}",
            100.0 * reading.unseen
        );
    }
    text
}

fn compare(options: &PhotometricOptions, reading: &FactorReading) -> Result<(), Failure> {
    let kept = kept_factor(&options.out, &options.class).map_err(Failure::new)?;
    let path = options.out.display();
    let Some(kept) = kept else {
        return Err(Failure::new(format!(
            "{path}: found no readings of the class {:?}, expected a calibration to compare with",
            options.class
        )));
    };
    // `kept` is the photometric factor that the probe uses, `reading` the one by the luxmeter.
    let off = kept.factor / reading.factor - 1.0;
    let verdict = Verdict::of(off);
    let line = format!("the probe differs by {:+.1} % from the reading: {}", 100.0 * off, verdict.name());
    match verdict {
        Verdict::Reject => Err(Failure::new(format!(
            "{path}: found that {line}, expected within 25 %: calibrate again with --fresh, or use another --class for this kind of light"
        ))),
        _ => say(&format!("{line} (below 10 % is good, above 25 % a reject)\n")),
    }
}
