//! The configuration file: options and settings in TOML. Options of the command line override it.

use crate::probe::Config;
use crate::probe::settings::{SETTINGS, Setting};
use crate::replacement;
use rustix::fs::OFlags;
use serde::Deserialize;
use std::fs;
use std::io::{Read, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use toml_edit::{DocumentMut, Item};

/// Largest size of a configuration file, bytes.
const MOST_BYTES: u64 = 64 << 10;

/// A configuration file to which settings can be saved.
#[derive(Clone, Debug)]
pub struct ConfigFile {
    path: PathBuf,
    /// Locked while the configuration file is written.
    writing: Arc<Mutex<()>>,
}

/// The contents of the file; every key is optional.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct Kept {
    /// Value of the option `--source`.
    pub source: Option<String>,
    /// Value of the option `--listen`.
    pub listen: Option<String>,
    /// Value of the option `--open`.
    pub open: Option<bool>,
    /// Value of the option `--token-file`, relative to the folder of the configuration file.
    pub token_file: Option<PathBuf>,
    /// Value of the option `--photometric`, relative to the folder of the configuration file.
    pub photometric: Option<PathBuf>,
    /// Value of the option `--calibration`, relative to the folder of the configuration file.
    pub calibration: Option<PathBuf>,
    /// Value of the option `--light-class`.
    pub light_class: Option<String>,
    /// Values of the option `--host`.
    #[serde(default)]
    pub hosts: Vec<String>,
    /// Values of the option `--allow-origin`.
    #[serde(default)]
    pub allow_origins: Vec<String>,
    /// Values of the option `--trusted-proxy`.
    #[serde(default)]
    pub trusted_proxies: Vec<String>,
    /// Value of the option `--announce`.
    pub announce: Option<bool>,
    /// Values of the option `--osc`.
    #[serde(default)]
    pub osc: Vec<String>,
    /// Value of the option `--mqtt`.
    pub mqtt: Option<String>,
    /// The settings of `/v1/config` in the file, by name.
    #[serde(flatten)]
    pub settings: toml::Table,
}

/// Reasons for which the configuration file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ConfigFileError {
    /// The configuration file cannot be read.
    #[error("configuration file {0}: found {1}, expected a file that can be read (it may be empty)")]
    Read(PathBuf, std::io::Error),
    /// The file is longer than the largest accepted size.
    #[error("configuration file {0}: found more than {MOST_BYTES} bytes, expected less")]
    TooLong(PathBuf),
    /// The file has unknown keys or values, or is not TOML.
    #[error("configuration file {0}: {1}")]
    Content(PathBuf, String),
    /// The configuration file cannot be written.
    #[error("configuration file {0}: found {1}, expected it to be writable")]
    Write(PathBuf, std::io::Error),
}

/// A configuration file and its contents.
#[derive(Debug)]
pub struct OpenedConfig {
    /// Handle by which settings are saved to the file.
    pub file: ConfigFile,
    /// Contents of the file, with its comments.
    pub kept: Kept,
}

impl ConfigFile {
    /// Reads the configuration file at `path`.
    ///
    /// # Errors
    /// [`ConfigFileError`] where the file cannot be read or has unknown keys or values.
    pub fn open(path: &Path) -> Result<OpenedConfig, ConfigFileError> {
        let text = read(path)?;
        let content = |why: String| ConfigFileError::Content(path.into(), why);
        let mut kept: Kept = toml::from_str(&text).map_err(|e| {
            let line =
                |span: std::ops::Range<usize>| text[..span.start.min(text.len())].matches('\n').count() + 1;
            let place = e.span().map_or(String::new(), |span| format!("line {}: ", line(span)));
            content(format!("{place}found {}", e.message().replace('\n', " ")))
        })?;
        if let Some(unknown) = kept.settings.keys().find(|key| Setting::named(key).is_none()) {
            let names = Setting::names();
            let others = "source, listen, open, token_file, photometric, calibration, light_class, hosts, allow_origins, trusted_proxies, announce, \
                          osc, mqtt";
            return Err(content(format!("found '{unknown}', expected one of {others}, {names}")));
        }
        let folder = path.parent().unwrap_or(Path::new(""));
        kept.token_file = kept.token_file.map(|file| folder.join(file));
        kept.photometric = kept.photometric.map(|file| folder.join(file));
        kept.calibration = kept.calibration.map(|file| folder.join(file));
        Ok(OpenedConfig { file: Self { path: path.into(), writing: Arc::default() }, kept })
    }

    /// Writes to the file the settings of `config` that differ from the defaults, and removes the other settings, except those with
    /// comments; all other keys stay unchanged. A setting that is off and has no value in TOML is removed with its comments. The replacement
    /// of the file is atomic.
    ///
    /// # Errors
    /// [`ConfigFileError`] where the file cannot be read or written.
    pub fn save(&self, config: &Config) -> Result<(), ConfigFileError> {
        let _alone = self.writing.lock().unwrap_or_else(PoisonError::into_inner);
        let text = read(&self.path)?;
        let mut document: DocumentMut =
            text.parse().map_err(|e| ConfigFileError::Content(self.path.clone(), format!("found {e}")))?;
        let usual = Config::default();
        for setting in SETTINGS {
            let value = setting.value(config);
            let is_kept = value != setting.value(&usual) || has_comments(&document, setting.name);
            match item(&value).filter(|_| is_kept) {
                Some(value) => put(&mut document, setting.name, value),
                None => drop(document.remove(setting.name)),
            }
        }
        self.replace(document.to_string().as_bytes())
            .map_err(|e| ConfigFileError::Write(self.path.clone(), e))
    }

    /// Writes a new file in the same folder and renames it, so that readers get either the old or the new content.
    fn replace(&self, bytes: &[u8]) -> std::io::Result<()> {
        // If the path is a link, the file at the end of the link is replaced.
        let path = fs::canonicalize(&self.path)?;
        let about = fs::metadata(&path)?;
        let (owner, user) = (about.uid(), rustix::process::geteuid().as_raw());
        if owner != user {
            return Err(std::io::Error::other(format!("user {owner} as its owner, not {user}")));
        }
        let folder = path.parent().unwrap_or(Path::new("/"));
        let mut file = replacement::create(folder)?;
        file.as_file().set_permissions(about.permissions())?;
        file.write_all(bytes).and_then(|()| file.as_file().sync_all())?;
        file.persist(&path).map_err(|e| e.error)?;
        Ok(())
    }
}

fn read(path: &Path) -> Result<String, ConfigFileError> {
    let failed = |e| ConfigFileError::Read(path.into(), e);
    // Opening a FIFO would block until another process opens it for writing.
    let opened =
        fs::OpenOptions::new().read(true).custom_flags(OFlags::NONBLOCK.bits().cast_signed()).open(path);
    let file = opened.map_err(failed)?;
    if !file.metadata().map_err(failed)?.is_file() {
        return Err(failed(std::io::Error::other("a FIFO, a device or a folder")));
    }
    let mut text = String::new();
    let length = file.take(MOST_BYTES + 1).read_to_string(&mut text).map_err(failed)?;
    if length as u64 > MOST_BYTES { Err(ConfigFileError::TooLong(path.into())) } else { Ok(text) }
}

/// Sets the value of the key `name` in the document; the comments above and behind the old value stay.
fn put(document: &mut DocumentMut, name: &str, item: Item) {
    let old = document.get(name).and_then(Item::as_value).map(|value| value.decor().clone());
    document[name] = item;
    if let (Some(decor), Some(value)) = (old, document[name].as_value_mut()) {
        *value.decor_mut() = decor;
    }
}

/// Returns true if a comment stands above the key `name` or behind its value.
fn has_comments(document: &DocumentMut, name: &str) -> bool {
    let Some((key, item)) = document.get_key_value(name) else { return false };
    let above = key.leaf_decor().prefix();
    let behind = item.as_value().and_then(|value| value.decor().suffix());
    [above, behind].into_iter().flatten().any(|text| text.as_str().is_some_and(|text| text.contains('#')))
}

fn item(value: &serde_json::Value) -> Option<Item> {
    match value {
        serde_json::Value::Bool(v) => Some(toml_edit::value(*v)),
        serde_json::Value::String(v) => Some(toml_edit::value(v.as_str())),
        serde_json::Value::Number(v) => {
            v.as_i64().map(toml_edit::value).or_else(|| v.as_f64().map(toml_edit::value))
        }
        serde_json::Value::Array(list) => {
            let list: Option<toml_edit::Array> = list.iter().map(serde_json::Value::as_f64).collect();
            list.map(toml_edit::value)
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::probe::settings::wish_of;

    #[test]
    fn save_writes_settings_and_keeps_other_keys_and_comments() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("hemilux.toml");
        let text = "# The probe in the hall.\nlisten = \"127.0.0.1:0\" # any port\nlights = 12\ntoken_file = \"secret\"\n";
        fs::write(&path, text).expect("a file");
        let OpenedConfig { file, kept } = ConfigFile::open(&path).expect("a configuration");
        assert_eq!(kept.settings["lights"].as_integer(), Some(12), "read");
        assert_eq!(kept.token_file, Some(folder.path().join("secret")), "beside the file");
        let mut config = Config { gui: true, ..Config::default() };
        config.pipeline.lights = 99;
        config.exposures_s = Some(vec![0.001, 0.25]);
        config.budgets.set_ms(1, 12.5);
        file.save(&config).expect("written");
        let written = fs::read_to_string(&path).expect("a file");
        assert!(
            written
                .starts_with("# The probe in the hall.\nlisten = \"127.0.0.1:0\" # any port\nlights = 99\n"),
            "{written}"
        );
        let again = ConfigFile::open(&path).expect("a configuration").kept;
        assert_eq!((again.settings["gui"].as_bool(), again.listen), (Some(true), kept.listen), "{written}");
        assert_eq!(again.settings["budget_front_ms"].as_float(), Some(12.5), "{written}");
        let json = serde_json::to_value(again.settings).expect("JSON");
        let change = wish_of(json.as_object().expect("settings")).expect("what was written is read");
        let mut read = Config::default();
        change.apply(&mut read);
        assert_eq!(read, config, "{written}");
        assert_eq!(folder.path().read_dir().expect("a folder").count(), 1, "nothing is left beside it");
        let changed = ["lights", "gui", "exposures_s", "budget_front_ms", "listen", "token_file"];
        assert_eq!(written.matches(" = ").count(), changed.len(), "defaults are left out: {written}");
        file.save(&Config::default()).expect("written");
        let written = fs::read_to_string(&path).expect("a file");
        assert_eq!(
            written.matches(" = ").count(),
            2,
            "values that are defaults again are removed: {written}"
        );
    }

    #[test]
    fn comments_above_and_behind_a_setting_stay() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("hemilux.toml");
        fs::write(&path, "# Few: the phone is slow.\nlights = 12 # at most 20\ntolerance = 0.1\n")
            .expect("a file");
        let file = ConfigFile::open(&path).expect("a configuration").file;
        let mut config = Config::default();
        config.pipeline.lights = 99;
        file.save(&config).expect("written");
        let written = fs::read_to_string(&path).expect("a file");
        assert_eq!(written, "# Few: the phone is slow.\nlights = 99 # at most 20\n");
        file.save(&Config::default()).expect("written");
        let written = fs::read_to_string(&path).expect("a file");
        let usual = Config::default().pipeline.lights;
        assert_eq!(written, format!("# Few: the phone is slow.\nlights = {usual} # at most 20\n"));
    }

    #[test]
    fn errors_name_the_file_and_the_wrong_key_or_value() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("hemilux.toml");
        let cases =
            [("lights = \n", "line 1"), ("colour = 3\n", "'colour'"), ("open = \"yes\"\n", "boolean")];
        for (text, named) in cases {
            fs::write(&path, text).expect("a file");
            let line = ConfigFile::open(&path).map(|_| ()).expect_err(text).to_string();
            assert!(
                line.contains("hemilux.toml") && line.contains(named) && !line.contains('\n'),
                "{text}: {line}"
            );
        }
        let fifo = folder.path().join("fifo");
        assert!(
            std::process::Command::new("mkfifo").arg(&fifo).status().expect("mkfifo").success(),
            "a FIFO"
        );
        for path in [fifo.as_path(), Path::new("/dev/zero"), folder.path()] {
            let error = ConfigFile::open(path).map(|_| ()).expect_err("no file").to_string();
            assert!(error.contains("found a FIFO, a device or a folder"), "{error}");
        }
        let error =
            ConfigFile::open(&folder.path().join("none.toml")).map(|_| ()).expect_err("no file").to_string();
        assert!(error.contains("none.toml"), "{error}");
    }
}
