//! `hemilux record`: writes the raw frames of a camera as recorded bursts.

use super::{Failure, devices, say};
use crate::recorded::{Shown, lens_table};
use crate::source::Source;
use crate::source::SourceError;
use crate::source::camera::{CameraSource, CameraSpec, RawBurst};
use crate::v4l2::formats;
use crate::v4l2::frame::Counters;
use crate::v4l2::real::RealKernel;
use clap::Args;
use hemilux_core::format::{Matrix, Yuv};
use std::fmt::Display;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use toml::{Table, Value};

/// Longest time without a burst: a camera that is connected again delivers bursts within this time.
const PATIENCE: Duration = Duration::from_secs(30);

#[derive(Clone, Debug, Args)]
pub(super) struct Record {
    /// The camera: v4l2:PATH with its options.
    #[arg(long, value_name = "SOURCE", default_value = "v4l2:/dev/video0", value_parser = devices::camera)]
    source: CameraSpec,
    /// Number of bursts to record.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    bursts: u32,
    /// Folder to write to; it must be empty or not exist.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

pub(super) fn run(options: &Record) -> Result<(), Failure> {
    let out = &options.out;
    fs::create_dir_all(out).map_err(|e| unwritable(out, &e))?;
    let mut entries = fs::read_dir(out).map_err(|e| unwritable(out, &e))?;
    if entries.next().is_some() {
        return Err(Failure::usage(format!(
            "--out {}: found files, expected an empty folder or none",
            out.display()
        )));
    }
    let source = CameraSource::open(Box::new(RealKernel), &options.source).map_err(Failure::new)?;
    let told = record(source, options.bursts as usize, out);
    say(&told.map_err(|f| Failure { line: format!("{}: {}", options.source, f.line), ..f })?)
}

/// Writes `bursts` bursts of `source` below `out`; returns a summary for the user.
fn record(mut source: CameraSource, bursts: usize, out: &Path) -> Result<String, Failure> {
    let head = head(&source);
    let mut list = Vec::new();
    let mut last = Instant::now();
    while list.len() < bursts {
        match source.next_raw() {
            Ok(burst) => {
                last = Instant::now();
                let folder = format!("{:06}", list.len() + 1);
                write_burst(&out.join(&folder), &head, burst)?;
                list.push((burst.timestamp_ns(), folder));
            }
            Err(SourceError::NotYet | SourceError::Broken(_)) if last.elapsed() < PATIENCE => {}
            Err(SourceError::Gone(_)) if last.elapsed() < PATIENCE => {
                std::thread::sleep(Duration::from_millis(250));
            }
            Err(error) => {
                // An incomplete recording can be replayed too.
                write_list(out, &list)?;
                let (seconds, count) = (PATIENCE.as_secs(), list.len());
                let kept = format!("{count} bursts are in {}", out.display());
                return Err(Failure::new(format!("{error}, and no burst for {seconds} s; {kept}")));
            }
        }
    }
    write_list(out, &list)?;
    let (Counters { lost, broken, mismatches, .. }, reopened) = source.counters();
    Ok(format!(
        "hemilux: {} bursts in {} ({lost} frames lost, {} broken, {mismatches} mismatches, camera reopened {reopened} times)\n",
        list.len(),
        out.display(),
        broken.total(),
    ))
}

fn unwritable(path: &Path, error: &dyn Display) -> Failure {
    Failure::new(format!("--out {}: found {error}, expected a folder that can be written", path.display()))
}

fn table(pairs: impl IntoIterator<Item = (&'static str, Value)>) -> Value {
    Value::Table(pairs.into_iter().map(|(name, value)| (name.into(), value)).collect())
}

/// Returns the tables of `burst.toml` that all bursts have in common: lens, response, levels and format.
fn head(source: &CameraSource) -> Table {
    let (c, p) = (source.calibration(), &source.terms().picture);
    let mut head = Table::new();
    head.insert("version".into(), Value::Integer(1));
    head.insert("lens".into(), Value::Table(lens(source)));
    let told = source.lens().and_then(|l| l.response_table.clone());
    let usual = if p.is_raw() { "linear" } else { "srgb" };
    head.insert("response".into(), told.map_or_else(|| table([("model", usual.into())]), Value::Table));
    head.insert("sensor".into(), table([("black", c.levels.black.into()), ("white", c.levels.white.into())]));
    let line = i64::try_from(p.layout.bytes_per_line()).unwrap_or(i64::MAX);
    let mut format = vec![
        ("width", Value::Integer(p.width().into())),
        ("height", Value::Integer(p.height().into())),
        ("fourcc", formats::name(p.fourcc).into()),
        ("bytes_per_line", Value::Integer(line)),
    ];
    if p.layout.bin() > 1 {
        format.push(("bin", Value::Integer(p.layout.bin().into())));
    }
    if c.compressed {
        format.push(("compressed", true.into()));
    }
    if let Some(Yuv { limited, matrix }) = p.yuv() {
        format.push(("range", if limited { "limited" } else { "full" }.into()));
        format.push(("matrix", if matrix == Matrix::Bt709 { "bt709" } else { "bt601" }.into()));
    }
    head.insert("format".into(), table(format));
    head
}

/// Returns the `[lens]` table of the recorded frames: that of the lens file, with size, crop and binning of the camera's mode and of the decoder.
fn lens(source: &CameraSource) -> Table {
    let (c, terms) = (source.calibration(), source.terms());
    let p = &terms.picture;
    let mut lens = source.lens().map_or_else(Table::new, |file| file.lens_table.clone());
    if source.lens().is_none_or(|file| file.lens != c.lens) {
        lens.extend(lens_table(&c.lens, [p.width(), p.height()]));
    }
    let shrink = p.jpeg.map_or(1, |jpeg| jpeg.shrink);
    if let Some(Shown { crop, binning }) = terms.view.map(|view| view.shown()) {
        lens.insert("size".into(), [p.width(), p.height()].map(i64::from).to_vec().into());
        lens.insert("crop".into(), crop.map(i64::from).to_vec().into());
        lens.insert("binning".into(), binning.map(|b| i64::from(b * shrink)).to_vec().into());
    } else if shrink > 1 {
        lens.remove("crop");
        lens.remove("binning");
    }
    lens
}

/// Writes the frames and the manifest of one burst.
fn write_burst(folder: &Path, head: &Table, burst: &RawBurst) -> Result<(), Failure> {
    fs::create_dir(folder).map_err(|e| unwritable(folder, &e))?;
    let mut frames = Vec::new();
    for (i, (frame, seconds)) in burst.frames.iter().zip(&burst.terms.seconds).enumerate() {
        let file = format!("{i}.raw");
        fs::write(folder.join(&file), &frame.bytes).map_err(|e| unwritable(&folder.join(&file), &e))?;
        let integer = |v: u64| Value::Integer(i64::try_from(v).unwrap_or(i64::MAX));
        frames.push(table([
            ("file", file.into()),
            ("exposure_s", (*seconds).into()),
            ("sequence", integer(frame.taken.sequence.into())),
            ("timestamp_ns", integer(frame.taken.timestamp_ns)),
            ("known", frame.taken.known.name().into()),
        ]));
    }
    let mut manifest = head.clone();
    manifest.insert("frame".into(), Value::Array(frames));
    write_toml(&folder.join("burst.toml"), &manifest)
}

fn write_list(out: &Path, list: &[(u64, String)]) -> Result<(), Failure> {
    let entry = |(ns, folder): &(u64, String)| {
        let ns = Value::Integer(i64::try_from(*ns).unwrap_or(i64::MAX));
        table([("folder", folder.as_str().into()), ("timestamp_ns", ns)])
    };
    let mut all = Table::new();
    all.insert("version".into(), Value::Integer(1));
    all.insert("burst".into(), Value::Array(list.iter().map(entry).collect()));
    write_toml(&out.join("sequence.toml"), &all)
}

/// Writes a file and renames it, so that a recording that is killed has whole files with these names alone. A burst whose `burst.toml` is written
/// last is read if it is whole.
fn write_toml(path: &Path, table: &Table) -> Result<(), Failure> {
    let text = toml::to_string(table).map_err(|e| unwritable(path, &e))?;
    let part = path.with_extension("part");
    fs::write(&part, text).and_then(|()| fs::rename(&part, path)).map_err(|e| unwritable(path, &e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::{Burst, Calibration};
    use crate::pipeline::{Pipeline, Settings};
    use crate::recorded::{read_burst, read_sequence};
    use crate::source::{Pace, ReplaySource};
    use crate::v4l2::fake::{FakeKernel, Fault, Script};
    use hemilux_core::format::{Format, Pattern};
    use hemilux_core::light::Light;

    /// Returns the scripted camera, whose codes are linear in all formats.
    fn source(script: &Script) -> CameraSource {
        let (width, height) = script.size;
        let lens = tempfile::NamedTempFile::new().expect("a file");
        let text = format!(
            "[lens]\nmodel = \"equidistant\"\nsize = [{width}, {height}]\ncentre = [31.5, 23.5]\nfocal = [15.0, 15.0]\n\
             max_angle_deg = 85.0\n[response]\nmodel = \"linear\"\n"
        );
        fs::write(lens.path(), text).expect("written");
        let options = format!("/dev/video0,exposures=0.001/0.006/0.036,lens={}", lens.path().display());
        let spec = CameraSpec::parse(&options).expect("options");
        CameraSource::open(Box::new(FakeKernel::new(script.clone())), &spec).expect("a camera")
    }

    /// Returns the lights and the scalar flux of the light set of one burst.
    fn lights(calibration: &Calibration, burst: &Burst) -> (Vec<Light>, [f32; 3]) {
        let exposures: Vec<_> = burst.frames.iter().map(|f| f.exposure).collect();
        let pipeline = Pipeline::try_new(*calibration, &exposures, Settings::default());
        let mut pipeline = pipeline.expect("a pipeline");
        let processed = pipeline.process(burst).expect("lights");
        (processed.decomposition.lights.to_vec(), processed.scalar_flux)
    }

    fn next(source: &mut dyn Source) -> Burst {
        let mut burst = Burst::default();
        while source.next(&mut burst).is_err() {}
        burst
    }

    /// The scene is static: each burst of the recording has the same light.
    #[test]
    fn a_recording_has_the_lights_of_the_camera() {
        let yuv = Yuv { limited: true, matrix: Matrix::Bt601 };
        let cases = [
            ("YUYV", (64, 47), Format::Yuyv(yuv)),
            ("NV12", (64, 48), Format::Nv12(yuv)),
            ("pBAA", (66, 48), Format::Raw10(Pattern::Bggr)),
            ("GB10", (64, 48), Format::Bayer16(Pattern::Gbrg, 10)),
            ("RG16", (64, 48), Format::Bayer16(Pattern::Rggb, 16)),
            ("GREY", (65, 47), Format::Grey),
        ];
        for (name, size, format) in cases {
            let script = Script { formats: vec![name], size, ..Script::default() };
            let folder = tempfile::tempdir().expect("a folder");
            let told = record(source(&script), 3, folder.path()).expect("recorded");
            assert!(told.contains("3 bursts") && told.contains("0 broken"), "{told}");

            let mut live = source(&script);
            let burst = next(&mut live);
            let calibration = *live.calibration();
            drop(live);
            let (expected, flux) = lights(&calibration, &burst);
            assert!(!expected.is_empty() && flux.iter().all(|v| *v > 0.0), "{name}: {flux:?}");
            let mut replay = ReplaySource::open(folder.path(), Pace::Free).expect("a recording");
            assert_eq!((replay.len(), replay.calibration()), (3, &calibration), "{name}");
            assert_eq!(
                (replay.calibration().layout.format(), replay.calibration().layout.bytes_per_line()),
                (format, format.line_bytes(size.0) + 16),
                "as it came"
            );
            for _ in 0..3 {
                let again = next(&mut replay);
                assert_eq!(again.frames, burst.frames, "{name}: byte for byte");
                assert_eq!(lights(replay.calibration(), &again), (expected.clone(), flux), "{name}");
            }
            let first = &read_sequence(folder.path()).expect("a sequence")[0];
            let read = read_burst(&first.folder).expect("a burst").burst;
            assert!(first.timestamp_ns > 0 && read.timestamp_ns == first.timestamp_ns, "{name}: its time");
        }
    }

    /// Frames of 1280 x 720 are decoded at half the size, and raw frames of 1640 x 1232 are binned: the recording is read in the same way.
    #[test]
    fn a_recording_states_binning_and_compression() {
        for (name, size, bin, compressed) in
            [("MJPG", (1280, 720), 1, true), ("pBAA", (1640, 1232), 2, false)]
        {
            let script = Script { formats: vec![name], size, ..Script::default() };
            let folder = tempfile::tempdir().expect("a folder");
            record(source(&script), 1, folder.path()).expect("recorded");
            let live = *source(&script).calibration();
            let replay = ReplaySource::open(folder.path(), Pace::Free).expect("a recording");
            let read = replay.calibration();
            assert_eq!((read.layout.bin(), read.compressed), (bin, compressed), "{name}");
            let (a, b) = (read.lens.intrinsics(), live.lens.intrinsics());
            assert_eq!(
                (a.centre_px, a.focal_px, read.layout),
                (b.centre_px, b.focal_px, live.layout),
                "{name}"
            );
        }
    }

    /// Records until the process is killed, where the environment variable names a folder.
    #[test]
    #[ignore = "run in a process of its own by a_killed_recording_is_read_up_to_its_last_whole_burst"]
    fn record_until_killed() {
        let Some(out) = std::env::var_os("HEMILUX_RECORD_TO") else { return };
        let _ = record(source(&Script::default()), 100_000, Path::new(&out));
    }

    #[test]
    fn a_killed_recording_is_read_up_to_its_last_whole_burst() {
        let kills = std::env::var("HEMILUX_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(20u64);
        let (mut read, mut refused) = (0, 0);
        for kill in 0..kills {
            let folder = tempfile::tempdir().expect("a folder");
            let mut child = std::process::Command::new(std::env::current_exe().expect("this program"))
                .args(["--exact", "--ignored", "cli::record::tests::record_until_killed"])
                .env("HEMILUX_RECORD_TO", folder.path())
                .stdout(std::process::Stdio::null())
                .spawn()
                .expect("it runs");
            while fs::read_dir(folder.path()).expect("a folder").next().is_none() {
                std::thread::sleep(Duration::from_millis(1));
            }
            std::thread::sleep(Duration::from_micros(kill * 7_919 % 60_000));
            child.kill().expect("SIGKILL");
            child.wait().expect("its end");
            let begun = fs::read_dir(folder.path()).expect("a folder").count();
            match ReplaySource::open(folder.path(), Pace::Free) {
                Ok(mut replay) => {
                    let whole = replay.len();
                    assert!(whole == begun || whole + 1 == begun, "kill {kill}: {whole} of {begun} bursts");
                    let mut burst = Burst::default();
                    for _ in 0..whole {
                        replay.next(&mut burst).unwrap_or_else(|e| panic!("kill {kill}: {e}"));
                        assert_eq!(burst.frames.len(), 3, "kill {kill}");
                    }
                    read += whole;
                }
                Err(error) => {
                    let line = error.to_string();
                    assert!(begun == 1 && !line.contains('\n'), "kill {kill}: {begun} bursts, {line}");
                    refused += 1;
                }
            }
        }
        println!("{kills} kills: {read} whole bursts read, {refused} recordings without one refused");
        assert!(read > 0, "no kill came after the first burst");
    }

    #[test]
    fn a_recording_on_a_full_disk_ends_with_one_line_that_names_the_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let list = folder.path().join("sequence.toml");
        // Writes to this device fail as on a full disk.
        std::os::unix::fs::symlink("/dev/full", list.with_extension("part")).expect("a link");
        let failure = record(source(&Script::default()), 2, folder.path()).expect_err("no space");
        let named = format!("--out {}: found No space left on device", list.display());
        assert!(failure.line.starts_with(&named) && !failure.line.contains('\n'), "{}", failure.line);
    }

    #[test]
    fn a_recording_continues_after_a_disconnection() {
        let faults = vec![(400, Fault::Disconnect(Duration::from_millis(3500)))];
        let script = Script { faults, loss: 0.05, ..Script::default() };
        let folder = tempfile::tempdir().expect("a folder");
        let told = record(source(&script), 150, folder.path()).expect("recorded");
        assert!(told.contains("150 bursts") && told.contains("reopened 1 times"), "{told}");
        let replay = ReplaySource::open(folder.path(), Pace::Free).expect("a recording");
        assert_eq!(replay.len(), 150, "all of them");
    }
}
