//! Pipes as sources: files, FIFOs and sockets, with valid and invalid contents.

use super::*;
use hemilux_core::format::{Format, Pattern};
use rustix::fs::{CWD, FileType, Mode, mknodat};
use std::io::Write;
use std::os::unix::net::UnixListener;
use std::process::Command;

/// Returns a frame of 4 x 2 grey pixels of `code`, with the header fields at their offsets in `board/FORMATS.md`.
fn frame(sequence: u64, seconds: f64, code: u8) -> Vec<u8> {
    let mut bytes = b"HLXF\x01\x00\x48\x00GREY".to_vec();
    [4u32, 2, 4, 8].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    [0u16, 2].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    [sequence, 0].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    [seconds, 1.0, 0.0].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    bytes.extend([code; 8]);
    bytes
}

fn source(path: &Path) -> PipeSource {
    PipeSource::open(&PipeSpec { path: path.into(), lens: None }).expect("a source")
}

/// Returns exposure times in seconds and first codes of the frames of the next burst, or after ten seconds the newest error.
fn next(source: &mut PipeSource) -> Result<Vec<(f64, u8)>, String> {
    let (mut burst, began, mut why) = (Burst::default(), Instant::now(), String::new());
    while began.elapsed() < Duration::from_secs(10) {
        match source.next(&mut burst) {
            Ok(()) => {
                let told = burst.frames.iter().map(|f| match &f.pixels {
                    Pixels::U8(bytes) => (f.exposure.seconds, bytes.first().copied().unwrap_or(0)),
                    Pixels::U16(_) => (f.exposure.seconds, 0),
                });
                return Ok(told.collect());
            }
            Err(SourceError::NotYet) => {}
            Err(e) => why = e.to_string(),
        }
    }
    Err(why)
}

fn refusal(bytes: &[u8]) -> String {
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), bytes).expect("written");
    let (mut source, mut burst) = (source(file.path()), Burst::default());
    loop {
        match source.next(&mut burst) {
            Err(SourceError::NotYet) => {}
            Err(e) => return e.to_string(),
            Ok(()) => return "a burst".into(),
        }
    }
}

#[test]
fn a_file_is_repeated_as_bursts_of_its_exposures() {
    let file = tempfile::NamedTempFile::new().expect("a file");
    let frames = [(0, 0.02, 80), (1, 0.01, 40), (2, 0.0201, 81), (3, 0.04, 160), (4, 0.01, 41)];
    let bytes: Vec<u8> = frames.into_iter().flat_map(|(n, s, code)| frame(n, s, code)).collect();
    std::fs::write(file.path(), bytes).expect("written");
    let mut source = source(file.path());
    for _ in 0..2 {
        assert_eq!(next(&mut source), Ok(vec![(0.01, 40), (0.02, 80)]), "ascending");
        assert_eq!(next(&mut source), Ok(vec![(0.0201, 81), (0.04, 160)]), "other exposures");
    }
    let layout = source.calibration().layout;
    assert_eq!((layout.format(), layout.width(), layout.height()), (Format::Grey, 4, 2), "of the frames");
}

#[test]
fn a_fifo_continues_with_the_next_writer_after_a_truncated_frame() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("frames");
    mknodat(CWD, &path, FileType::Fifo, Mode::RWXU, 0).expect("a FIFO");
    let mut source = source(&path);
    let mut burst = Burst::default();
    let none = source.next(&mut burst).expect_err("no writer").to_string();
    assert!(none.contains("found no frames, expected a program that writes"), "{none}");
    for round in 0..3u8 {
        let path = path.clone();
        let writer = std::thread::spawn(move || {
            let mut pipe = std::fs::OpenOptions::new().write(true).open(path).expect("open");
            let all = [frame(0, 0.01, round), frame(1, 0.02, round), frame(2, 0.01, 99)].concat();
            let cut = &all[..all.len() - 5];
            for piece in cut.chunks(7) {
                pipe.write_all(piece).expect("written");
            }
        });
        assert_eq!(next(&mut source), Ok(vec![(0.01, round), (0.02, round)]), "writer {round}");
        writer.join().expect("a writer");
        let cut = std::iter::repeat_with(|| source.next(&mut burst)).find_map(|r| match r {
            Err(SourceError::Gone(line)) => Some(line),
            _ => None,
        });
        assert!(cut.is_some_and(|line| line.contains("an end within a frame")), "told");
    }
}

#[test]
fn a_unix_socket_is_connected_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("socket");
    let listener = UnixListener::bind(&path).expect("a socket");
    let writer = std::thread::spawn(move || {
        for round in 0..2 {
            let (mut stream, _) = listener.accept().expect("a reader");
            stream.write_all(&[frame(0, 0.01, round), frame(1, 0.02, round)].concat()).expect("written");
        }
    });
    let mut source = source(&path);
    for round in 0..2 {
        assert_eq!(next(&mut source), Ok(vec![(0.01, round), (0.02, round)]), "connection {round}");
    }
    writer.join().expect("a writer");
}

#[test]
fn invalid_headers_are_refused_on_one_line_that_names_the_field() {
    let changed = |at: usize, with: &[u8]| {
        let mut bytes = frame(0, 0.01, 1);
        bytes[at..at + with.len()].copy_from_slice(with);
        bytes
    };
    let cases: [(Vec<u8>, &str); 10] = [
        (changed(0, b"JUNK"), "HLXF"),
        (changed(4, &[2]), "version 1"),
        (changed(8, b"XXXX"), "XXXX"),
        (changed(12, &u32::MAX.to_le_bytes()), "at most 16384"),
        (changed(20, &u32::MAX.to_le_bytes()), "bytes per line"),
        (changed(24, &7u32.to_le_bytes()), "a frame of 7 bytes"),
        (changed(24, &u32::MAX.to_le_bytes()), "8 to 67108864"),
        (changed(30, &0u16.to_le_bytes()), "0 exposures"),
        (changed(48, &f64::NAN.to_le_bytes()), "an exposure of NaN s"),
        (changed(64, &300f64.to_le_bytes()), "a black level of 300"),
    ];
    for (bytes, named) in cases {
        let line = refusal(&bytes);
        assert!(line.contains(named) && line.contains("expected") && !line.contains('\n'), "{named}: {line}");
    }
    assert!(refusal(&[]).contains("found no frames"), "an empty file");
    let single = refusal(&frame(0, 0.01, 1));
    assert!(single.contains("found 1 frames without a burst"), "one exposure of two: {single}");
    assert!(refusal(&frame(0, 0.01, 1)[..75]).contains("an end within a frame"), "a cut file");
}

/// Runs the example program with a scripted picamera2 in place of the real one.
fn picamera2(out: &Path, raw: Option<&str>) -> std::process::Output {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut command = Command::new("python3");
    command.arg(root.join("examples/picamera2_pipe.py")).arg(out);
    command.args(["--frames", "12", "--exposures", "0.001", "0.006", "0.0333"]);
    command.env("PYTHONPATH", root.join("tests/scripted")).env("PYTHONDONTWRITEBYTECODE", "1");
    if let Some(name) = raw {
        command.env("SCRIPTED_RAW", name);
    }
    command.output().expect("python3")
}

/// Computed by hand: lines of 32 us shorten 1, 6 and 33.3 ms to 31, 187 and 1040 lines; digital gain 1.25; black 4096 of 65536 is 64 of 1024.
#[test]
fn the_picamera2_example_sends_the_exposures_of_the_metadata() {
    let file = tempfile::NamedTempFile::new().expect("a file");
    let output = picamera2(file.path(), None);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let (mut source, mut burst) = (source(file.path()), Burst::default());
    // The first frames have earlier exposures: the third burst has all three requested ones.
    let mut bursts = Vec::new();
    while bursts.len() < 2 {
        if source.next(&mut burst).is_ok() {
            bursts
                .push(burst.frames.iter().map(|f| (f.exposure.seconds, f.exposure.gain)).collect::<Vec<_>>());
        }
    }
    assert_eq!(bursts[1], [(0.000_992, 1.25), (0.005_984, 1.25), (0.033_28, 1.25)], "{bursts:?}");
    let c = source.calibration();
    assert_eq!(
        (c.layout.format(), c.layout.width(), c.layout.height(), c.layout.bytes_per_line()),
        (Format::Bayer16(Pattern::Rggb, 10), 64, 48, 160),
        "the mode that sees most in the fewest pixels"
    );
    assert_eq!((c.levels.black.round(), c.levels.white), (64.0, 1023.0), "the sensor's");
    let refused = picamera2(file.path(), Some("RGGB_PISP_COMP1"));
    let line = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && line.contains("found the raw format RGGB_PISP_COMP1"), "{line}");
}
