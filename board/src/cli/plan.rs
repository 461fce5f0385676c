//! The configuration of a run, from the options, the configuration file and the defaults.

use super::{Failure, Serve, address, origin};
use crate::config_file::{ConfigFile, ConfigFileError, Kept};
use crate::probe::settings::{SETTINGS, wish_of};
use crate::probe::{Config, Link};
use crate::recorded::{Photometric, parse_photometric, read_photometric};
use crate::server::{self, Access, LoadedToken, Token};
use crate::source::{FaultSource, FaultSpec, PhotometricSource, Source, Spec};
use std::fmt::Display;
use std::io::{self, Write};
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};

/// Default TCP port of the server, as in the thesis.
const PORT: u16 = 8080;

/// The source of bursts, the address to listen on, the access rules, and the settings.
pub(super) struct ServePlan {
    pub(super) source: Spec,
    pub(super) listen: SocketAddr,
    pub(super) token_file: Option<PathBuf>,
    pub(super) hosts: Vec<String>,
    pub(super) origins: Vec<String>,
    pub(super) proxies: Vec<IpAddr>,
    pub(super) photometric: Option<PathBuf>,
    pub(super) calibration: Option<PathBuf>,
    pub(super) light_class: Option<String>,
    pub(super) config: Config,
    pub(super) faults: Option<FaultSpec>,
    pub(super) file: Option<ConfigFile>,
    /// True if the probe is announced on the network by mDNS.
    pub(super) announce: bool,
    #[cfg(any(feature = "osc", feature = "mqtt"))]
    pub(super) peers: Peers,
}

/// The OSC and MQTT peers to which light sets are sent.
#[cfg(any(feature = "osc", feature = "mqtt"))]
#[derive(Debug)]
pub(super) struct Peers {
    #[cfg(feature = "osc")]
    pub(super) osc: Vec<crate::senders::osc::Target>,
    #[cfg(feature = "mqtt")]
    pub(super) mqtt: Option<crate::senders::mqtt::Broker>,
}

#[cfg(any(feature = "osc", feature = "mqtt"))]
impl Peers {
    /// Combines the peers in the configuration file and in the options; an error names the key of the file.
    fn of(options: &Serve, kept: &Kept) -> Result<Self, (&'static str, String)> {
        #[cfg(feature = "osc")]
        let osc = kept.osc.iter().map(|text| text.parse()).collect::<Result<Vec<_>, String>>();
        #[cfg(feature = "mqtt")]
        let mqtt = kept.mqtt.as_ref().map(|text| text.parse()).transpose();
        Ok(Self {
            #[cfg(feature = "osc")]
            osc: [osc.map_err(|e| ("osc", e))?, options.osc.clone()].concat(),
            #[cfg(feature = "mqtt")]
            mqtt: options.mqtt.clone().or(mqtt.map_err(|e| ("mqtt", e))?),
        })
    }
}

impl ServePlan {
    /// Combines the configuration file with the options, which override the file.
    pub(super) fn of(options: &Serve) -> Result<Self, Failure> {
        let opened = options.config.as_deref().map(ConfigFile::open).transpose().map_err(not_opened)?;
        let (file, kept) = opened.map_or((None, Kept::default()), |opened| (Some(opened.file), opened.kept));
        let name = options.config.as_deref().unwrap_or(Path::new("")).display();
        let wrong =
            |key: &str, why: &dyn Display| Failure::usage(format!("configuration file {name}: {key}: {why}"));
        let source = kept.source.as_deref().map(str::parse::<Spec>).transpose();
        let listen = kept.listen.as_deref().map(address).transpose();
        let origins = kept.allow_origins.iter().map(|o| origin(o)).collect::<Result<Vec<_>, _>>();
        let proxies = kept.trusted_proxies.iter().map(|text| text.parse::<IpAddr>());
        let proxies = proxies.collect::<Result<Vec<_>, _>>().map_err(|e| wrong("trusted_proxies", &e))?;
        let source = options.source.clone().or(source.map_err(|e| wrong("source", &e))?);
        let listen = options.listen.or(listen.map_err(|e| wrong("listen", &e))?);
        #[cfg(any(feature = "osc", feature = "mqtt"))]
        let peers = Peers::of(options, &kept).map_err(|(key, why)| wrong(key, &why))?;
        let plan = Self {
            source: source.unwrap_or(Spec::Scene("room")),
            listen: listen.unwrap_or((Ipv4Addr::LOCALHOST, PORT).into()),
            token_file: options.token_file.clone().or(kept.token_file).filter(|_| !options.open),
            hosts: [kept.hosts, options.hosts.clone()].concat(),
            origins: [origins.map_err(|e| wrong("allow_origins", &e))?, options.allow_origins.clone()]
                .concat(),
            proxies: [proxies, options.trusted_proxies.clone()].concat(),
            photometric: options.photometric.clone().or(kept.photometric),
            calibration: options.calibration.clone().or(kept.calibration),
            light_class: options.light_class.clone().or(kept.light_class),
            config: settings(options, kept.settings).map_err(|(key, why)| wrong(&key, &why))?,
            faults: options.faults.clone(),
            file,
            announce: kept.announce.unwrap_or(false),
            #[cfg(any(feature = "osc", feature = "mqtt"))]
            peers,
        };
        plan.config.check().map_err(|e| Failure::usage(format!("settings: found {e}")))?;
        plan.check_reach(options.open || kept.open.unwrap_or(false))?;
        Ok(plan)
    }

    /// Adds the faults of the option `--faults` to the source.
    pub(super) fn damaged(&self, source: Box<dyn Source>) -> Box<dyn Source> {
        match &self.faults {
            Some(spec) => Box::new(FaultSource::new(source, spec.clone())),
            None => source,
        }
    }

    /// Applies the photometric calibration to the source, if there is one.
    pub(super) fn in_lux(&self, source: Box<dyn Source>) -> Result<Box<dyn Source>, Failure> {
        let Some(photometric) = self.photometric_calibration()? else { return Ok(source) };
        let source = PhotometricSource::new(source, photometric);
        if !source.applies() {
            let _ = writeln!(
                io::stderr(),
                "hemilux: photometric calibration: found another response, level or vignetting than the source's, lights are relative: \
                 calibrate photometric again"
            );
        }
        Ok(Box::new(source))
    }

    /// Returns the lens file to which calibrations made on the page are written.
    pub(super) fn calibration_file(&self) -> Option<PathBuf> {
        self.calibration.clone().or_else(|| self.source.lens())
    }

    /// Reads the photometric calibration of the option `--photometric`, or of the source's lens file.
    fn photometric_calibration(&self) -> Result<Option<Photometric>, Failure> {
        let class = self.light_class.as_deref();
        if let Some(path) = &self.photometric {
            return read_photometric(path, class).map(Some).map_err(Failure::new);
        }
        let lens = self.source.lens().map(|path| (std::fs::read_to_string(&path), path));
        match lens {
            Some((Ok(text), path)) if text.contains("[photometric]") => {
                parse_photometric(&path, &text, class).map_err(Failure::new)
            }
            _ if class.is_some() => Err(Failure::usage(
                "--light-class: found no photometric calibration, expected --photometric FILE",
            )),
            _ => Ok(None),
        }
    }

    /// Refuses an address that other machines reach, unless there is a token or `--open`.
    fn check_reach(&self, is_open: bool) -> Result<(), Failure> {
        if self.faults.is_some() && !server::is_loopback(self.listen.ip()) {
            return Err(Failure::usage(format!(
                "--faults with --listen {}: found an address beyond this machine, expected a loopback address",
                self.listen
            )));
        }
        if is_open || self.token_file.is_some() || server::is_loopback(self.listen.ip()) {
            return Ok(());
        }
        Err(Failure::usage(format!(
            "--listen {}: found an address beyond this machine, expected a loopback address, or --token-file FILE as well to let those \
             with the token change settings and see pictures, or --open to let everyone",
            self.listen
        )))
    }

    /// Returns the access rules. A missing token file is created; stderr names the file and never contains the token.
    pub(super) fn access(&self) -> Result<Access, Failure> {
        let Some(file) = &self.token_file else { return Ok(Access::Open) };
        let LoadedToken { token, is_new } = Token::load_or_make(file).map_err(Failure::new)?;
        if is_new {
            let _ = writeln!(io::stderr(), "hemilux: made a token in {}", file.display());
        }
        Access::with_token(token).map_err(Failure::new)
    }
}

/// Returns the failure of a configuration file that could not be opened: contents that are refused are wrong usage.
fn not_opened(error: ConfigFileError) -> Failure {
    match error {
        ConfigFileError::Content(..) | ConfigFileError::TooLong(..) => Failure::usage(error),
        ConfigFileError::Read(..) | ConfigFileError::Write(..) => Failure::new(error),
    }
}

/// Reads the configuration file again; its settings, overridden by those of the options, take effect with the next frame. Other keys of the file
/// take effect only when the probe is started again.
pub(super) fn reload(options: &Serve, link: &Link) -> Result<(), Failure> {
    if options.config.is_none() {
        return Err(Failure::new(
            "found no configuration file, expected the probe to be started with --config FILE",
        ));
    }
    let plan = ServePlan::of(options)?;
    let values = SETTINGS.iter().map(|s| (s.name.to_owned(), s.value(&plan.config))).collect();
    let change = wish_of(&values);
    let change = change.map_err(|errors| {
        let (key, why) = errors.into_iter().next().unwrap_or_default();
        Failure::new(format!("{key}: {why}"))
    })?;
    link.settings().change(&change).map_err(Failure::new)?;
    Ok(())
}

/// Combines the values of the settings: defaults, then those in the configuration file, then those in the options. An error names the
/// setting.
fn settings(options: &Serve, kept: toml::Table) -> Result<Config, (String, String)> {
    let mut config = Config::default();
    let json = serde_json::to_value(kept).map_err(|e| ("settings".to_owned(), e.to_string()))?;
    let object = json.as_object().cloned().unwrap_or_default();
    let change = wish_of(&object).map_err(|errors| errors.into_iter().next().unwrap_or_default())?;
    change.apply(&mut config);
    options.settings.change.apply(&mut config);
    for (stage, ms) in options.budget.iter().flatten().enumerate() {
        ms.iter().for_each(|ms| config.budgets.set_ms(stage, *ms));
    }
    config.slowdown = options.slowdown.unwrap_or(1.0);
    Ok(config)
}
