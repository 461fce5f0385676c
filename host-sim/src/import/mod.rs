//! `hemilux-sim import`: converts bracketed photographs with EXIF data to a recorded burst.

mod function;
mod photo;
mod profile;
mod transfer;

use crate::error::SimError;
use crate::output;
use hemilux::recorded::{self, LensFile};
use hemilux_core::MAX_EXPOSURES;
use photo::Photo;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Arguments of `import`.
#[derive(Clone, Debug)]
pub struct ImportJob {
    /// Path of the camera's lens file.
    pub lens: PathBuf,
    /// Paths of the photographs, in any order.
    pub photos: Vec<PathBuf>,
    /// Path of the folder for the burst; it is created if it does not exist.
    pub out: PathBuf,
    /// Whether the colour spaces that the photographs state are ignored.
    pub ignores_profile: bool,
}

/// Copies the photographs into the folder `job.out` and writes its `burst.toml`.
///
/// # Errors
/// [`SimError`] for photographs that state no exposure time, or that differ in camera, lens or size, or if a file cannot be read or written.
pub fn run(job: &ImportJob) -> Result<(), SimError> {
    let text = describe(&job.lens, &job.photos, job.ignores_profile)?;
    let writable = |e: std::io::Error| SimError::at(&job.out, e, "a folder that can be written");
    std::fs::create_dir_all(&job.out).map_err(writable)?;
    for photo in &job.photos {
        let to = job.out.join(photo.file_name().unwrap_or_default());
        let is_there =
            to.canonicalize().ok().is_some_and(|to| photo.canonicalize().is_ok_and(|from| from == to));
        if !is_there {
            std::fs::copy(photo, &to).map_err(writable)?;
        }
    }
    output::save(&job.out.join("burst.toml"), text.as_bytes())
}

/// Returns the paths of the photographs of a folder in name order; of a photograph as JPEG and in another format, the JPEG file alone.
///
/// # Errors
/// [`SimError`] for a folder that cannot be read.
pub fn list(folder: &Path) -> Result<Vec<PathBuf>, SimError> {
    let entries = std::fs::read_dir(folder).map_err(|e| SimError::at(folder, e, "a readable folder"))?;
    let is_photo = |path: &PathBuf| {
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        let is_hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
        let known = ["jpg", "jpeg", "png", "pgm", "ppm", "tif", "tiff", "dng", "heic", "heif"];
        !is_hidden && extension.is_some_and(|extension| known.contains(&extension.as_str()))
    };
    let mut photos: Vec<_> = entries.filter_map(|entry| Some(entry.ok()?.path())).filter(is_photo).collect();
    photos.sort();
    // Cameras write each photograph as a raw file and as a JPEG file.
    let jpegs: Vec<_> =
        photos.iter().filter(|path| is_jpeg(path)).map(|path| path.with_extension("")).collect();
    photos.retain(|path| is_jpeg(path) || !jpegs.contains(&path.with_extension("")));
    Ok(photos)
}

fn is_jpeg(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("jpg") || e.eq_ignore_ascii_case("jpeg"))
}

/// Returns the text of a `burst.toml` for photographs of a camera with the lens file `lens`; prints the photographs and their EXIF data on standard
/// error.
///
/// # Errors
/// [`SimError`] for photographs that state no exposure time, or that differ in camera, lens or size, or if a file cannot be read.
pub fn describe(lens: &Path, paths: &[PathBuf], ignores_profile: bool) -> Result<String, SimError> {
    let path = lens;
    let lens = recorded::read_lens(path)?;
    lens.notes.iter().for_each(|note| eprintln!("hemilux-sim: {}: {note}", path.display()));
    let mut photos =
        paths.iter().map(|path| Photo::read(path, ignores_profile)).collect::<Result<Vec<_>, _>>()?;
    check(&photos)?;
    paths.iter().try_for_each(|photo| check_size(photo, path, lens.size))?;
    photos.sort_by(|a, b| a.light().total_cmp(&b.light()));
    let response = response(&lens, &photos)?;
    print(&photos, &response);
    Ok(manifest(&lens, response, &photos).to_string())
}

/// Refuses photographs that cannot belong to one burst: too many, of different camera settings, or with equal file names.
fn check(photos: &[Photo]) -> Result<(), SimError> {
    if !(1..=MAX_EXPOSURES).contains(&photos.len()) {
        return Err(SimError::Usage(format!(
            "PHOTO: found {} photographs, expected 1 to {MAX_EXPOSURES}",
            photos.len()
        )));
    }
    let first = &photos[0];
    for (index, photo) in photos.iter().enumerate() {
        for (found, expected) in photo.same.iter().zip(&first.same) {
            if found.value != expected.value {
                let text = format!("{} {}", found.name, found.shown());
                let wanted = format!("{} as {}", expected.shown(), first.file());
                return Err(SimError::at(&photo.path, text, &wanted));
            }
        }
        if photos[..index].iter().any(|other| other.file() == photo.file()) {
            return Err(SimError::at(
                &photo.path,
                "a second photograph with this file name",
                "different file names",
            ));
        }
    }
    Ok(())
}

/// Refuses a photograph whose columns and rows differ from `expected`, the size in the lens file `lens`.
fn check_size(photo: &Path, lens: &Path, expected: [u32; 2]) -> Result<(), SimError> {
    let [width, height] = recorded::image_size(photo)?;
    if [width, height] == expected {
        return Ok(());
    }
    let found = format!("{width} x {height} pixels");
    Err(SimError::at(
        photo,
        found,
        &format!("{} x {}, the size of {}", expected[0], expected[1], lens.display()),
    ))
}

/// Returns the `[response]` table of the lens file, or without one a table with the transfer function that the photographs state.
fn response(lens: &LensFile, photos: &[Photo]) -> Result<Table, SimError> {
    if let Some(table) = &lens.response_table {
        return Ok(table.clone());
    }
    let first = photos[0].transfer;
    if let Some(other) = photos.iter().find(|p| p.transfer != first) {
        let found = format!("the transfer function {}", other.transfer.name());
        return Err(SimError::at(&other.path, found, &format!("{} as {}", first.name(), photos[0].file())));
    }
    Ok(Table::from_iter([("model".to_string(), Value::from(first.name()))]))
}

/// Prints the photographs and their EXIF data on standard error.
fn print(photos: &[Photo], response: &Table) {
    eprintln!("hemilux-sim: {} photographs, response {}", photos.len(), response["model"]);
    eprintln!("    {:<24}{:>12}{:>8}{:>8}{:>12}  camera", "file", "exposure s", "ISO", "f/", "light");
    let shown = |v: Option<f64>| v.map_or_else(|| "-".into(), |v| format!("{v}"));
    for p in photos {
        let camera = p.same.first().map(photo::CommonField::shown).unwrap_or_default();
        let light = p.light() / photos[0].light();
        eprintln!(
            "    {:<24}{:>12.6}{:>8}{:>8}{:>12.3}  {camera}",
            p.file(),
            p.seconds,
            shown(p.iso),
            shown(p.aperture),
            light
        );
    }
}

fn manifest(lens: &LensFile, response: Table, photos: &[Photo]) -> Table {
    let base = &photos[0];
    let frames = photos.iter().map(|photo| {
        Value::Table(Table::from_iter([
            ("file".to_string(), Value::from(photo.file())),
            ("exposure_s".to_string(), Value::from(photo.seconds)),
            ("gain".to_string(), Value::from(photo.gain() / base.gain())),
            ("known".to_string(), Value::from("reported")),
        ]))
    });
    let mut table = Table::from_iter([
        ("version".to_string(), Value::from(1)),
        ("lens".to_string(), Value::Table(lens.lens_table.clone())),
        ("response".to_string(), Value::Table(response)),
        ("frame".to_string(), Value::from(frames.collect::<Vec<_>>())),
    ]);
    if let Some(levels) = lens.levels {
        let sensor = [("black", levels.black), ("white", levels.white)];
        table.insert(
            "sensor".into(),
            Value::Table(sensor.into_iter().map(|(k, v)| (k.into(), v.into())).collect()),
        );
    }
    table
}
