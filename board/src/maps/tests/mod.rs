//! Each header field of a map file, tested against its definition; the tests write the files.

use super::{Covers, DecodedMap, FLOAT_MAX, HALF_MAX, Projection, ReadOptions, Refusal, read_from, write};
use exr::prelude::*;
use std::f64::consts::PI;
use std::io::Cursor;

mod openexr;
mod projections;
mod radiance;

fn decode(bytes: &[u8]) -> std::result::Result<DecodedMap, Refusal> {
    decode_with(bytes, &ReadOptions::default())
}

fn decode_with(bytes: &[u8], options: &ReadOptions) -> std::result::Result<DecodedMap, Refusal> {
    read_from(Cursor::new(bytes), bytes.len() as u64, options)
}

fn refusal(bytes: &[u8]) -> String {
    let Refusal { found, expected } = decode(bytes).expect_err("refused");
    assert!(!found.contains('\n') && !expected.contains('\n'), "one line");
    format!("{found} | {expected}")
}

fn radiance(header: &str, body: &[u8]) -> Vec<u8> {
    [format!("#?RADIANCE\n{header}").as_bytes(), body].concat()
}

/// Returns the texels of a 4 x 2 map in flat encoding: texel k has the mantissas (k + 1, 0, 0) and exponent 128 (a factor of 1/256).
fn flat() -> Vec<u8> {
    (0..8u8).flat_map(|k| [k + 1, 0, 0, 128]).collect()
}

fn reds(map: &DecodedMap) -> Vec<f32> {
    map.texels.iter().map(|t| t[0] * 256.0).collect()
}

fn assert_close(found: [f32; 3], expected: [f64; 3]) {
    for (f, e) in found.iter().zip(expected) {
        assert!((f64::from(*f) - e).abs() < 3e-4 * e.abs().max(0.1), "{found:?}, expected {expected:?}");
    }
}

#[test]
fn pfm_rows_run_upwards_in_either_byte_order() {
    let floats = |values: &[f32], little: bool| -> Vec<u8> {
        values.iter().flat_map(|v| if little { v.to_le_bytes() } else { v.to_be_bytes() }).collect()
    };
    let colour: Vec<f32> = (0..6).map(|v| v as f32).collect();
    for (scale, little) in [("-1.0", true), ("1.0", false)] {
        let bytes = [format!("PF\n1 2\n{scale}\n").as_bytes(), &floats(&colour, little)].concat();
        assert_eq!(decode(&bytes).expect("a map").texels, [[3.0, 4.0, 5.0], [0.0, 1.0, 2.0]], "{scale}");
    }
    let grey = [&b"Pf\n2 1\n-1\n"[..], &floats(&[7.0, 8.0], true)].concat();
    assert_eq!(decode(&grey).expect("a map").texels, [[7.0; 3], [8.0; 3]], "grey");
    // Header lines may end with two bytes, and blanks may follow the scale: the samples are the last bytes of the file, even if those bytes
    // are blanks.
    for end in ["\r\n", " \n"] {
        let bytes = [format!("PF{end}1 2{end}-1.0{end}").as_bytes(), &floats(&colour, true)].concat();
        assert_eq!(decode(&bytes).expect("a map").texels, [[3.0, 4.0, 5.0], [0.0, 1.0, 2.0]], "{end:?}");
    }
    let blanks = f32::from_le_bytes(*b"    ");
    let grey = [&b"Pf\n2 1\n-1\n"[..], &floats(&[blanks, 8.0], true)].concat();
    assert_eq!(decode(&grey).expect("a map").texels, [[blanks; 3], [8.0; 3]], "samples of blanks");
    assert!(refusal(b"PF\n2 2\n-2.0\n").contains("scale"), "scale");
    assert!(refusal(b"PF\n2 2\n-1.0\n....").contains("ends in row 0"), "short");
    assert!(refusal(b"PF\n100000 100000\n-1.0\n").contains("--max-pixels"), "size");
}

/// Returns an OpenEXR file of one layer whose channels have one value each.
fn uniform(
    channels: &[(&str, f32)],
    size: (usize, usize),
    attributes: LayerAttributes,
) -> Image<Layer<AnyChannels<FlatSamples>>> {
    let channel =
        |(name, value): &(&str, f32)| AnyChannel::new(*name, FlatSamples::F32(vec![*value; size.0 * size.1]));
    let list = AnyChannels::sort(channels.iter().map(channel).collect());
    Image::from_layer(Layer::new(size, attributes, Encoding::FAST_LOSSLESS, list))
}

fn written(image: &Image<Layer<AnyChannels<FlatSamples>>>) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write().non_parallel().to_buffered(&mut bytes).expect("a file");
    bytes.into_inner()
}

/// Returns a map of `size` whose texel (column, row) has the value of `paint`.
fn painted(size: (usize, usize), paint: impl Fn(usize, usize) -> f32 + Sync) -> Vec<u8> {
    write::openexr(size.0, size.1, Covers::Sphere, |row, column| [paint(column, row); 3]).expect("a file")
}

const RGB: [(&str, f32); 3] = [("R", 3.0), ("G", 2.0), ("B", 1.0)];

#[test]
fn coverage_is_read_back_and_can_be_overridden() {
    let file = |covers| write::openexr(8, 2, covers, |row, _| [row as f32; 3]).expect("a file");
    let read = |bytes: &[u8], covers| {
        decode_with(bytes, &ReadOptions { covers, ..ReadOptions::default() }).expect("a map").covers
    };
    let hemisphere = file(Covers::Hemisphere);
    assert_eq!(read(&hemisphere, None), Covers::Hemisphere, "stated");
    assert_eq!(read(&hemisphere, Some(Covers::Sphere)), Covers::Sphere, "overruled");
    assert_eq!(read(&file(Covers::Sphere), None), Covers::Sphere, "stated");
    assert_eq!(
        read(&file(Covers::Sphere), Some(Covers::Hemisphere)),
        Covers::Hemisphere,
        "overruled by a 4:1 shape"
    );
    let header = format!(
        "{}
-Y 2 +X 4
",
        write::radiance_line(Covers::Hemisphere)
    );
    assert_eq!(read(&radiance(&header, &flat()), None), Covers::Hemisphere, "a header line");
    assert_eq!(
        read(
            &radiance(
                "
-Y 2 +X 4
",
                &flat()
            ),
            Some(Covers::Hemisphere)
        ),
        Covers::Sphere,
        "its upper half"
    );
}

#[test]
fn shapes_that_are_not_two_to_one_are_noted() {
    for (size, advice) in
        [((8, 8), "angular"), ((16, 4), "--hemisphere"), ((6, 8), "cube"), ((9, 5), "not 2:1")]
    {
        let notes = decode(&painted(size, |_, _| 1.0)).expect("a map").notes;
        assert!(notes.iter().any(|n| n.contains(advice)), "{size:?}: {notes:?}");
    }
    assert!(decode(&painted((8, 4), |_, _| 1.0)).expect("a map").notes.is_empty(), "2:1");
}

#[test]
fn other_formats_and_broken_files_are_refused_by_name() {
    for (bytes, name) in [
        (&b"\x89PNG\r\n\x1a\n"[..], "PNG"),
        (b"\xff\xd8\xff\xe0", "JPEG"),
        (b"II*\0", "TIFF"),
        (b"hello", "begins with"),
        (b"", "begins with"),
        (&[0x76, 0x2f, 0x31, 0x01], "OpenEXR"),
        (&[0x76, 0x2f, 0x31, 0x01, 2, 0x08, 0, 0], "OpenEXR"),
    ] {
        let told = refusal(bytes);
        assert!(told.contains(name), "{bytes:?}: {told}");
    }
    let whole = painted((64, 32), |x, y| (x * y) as f32);
    for length in [100, 300, whole.len() / 2, whole.len() - 1] {
        assert!(decode(&whole[..length]).is_err(), "cut at {length}");
    }
}

#[test]
fn max_pixels_replaces_both_limits() {
    let bytes = painted((64, 32), |_, _| 1.0);
    let with = |max_pixels| {
        decode_with(&bytes, &ReadOptions { max_pixels: Some(max_pixels), ..ReadOptions::default() })
    };
    assert!(with(2048).is_ok(), "at the limit");
    assert!(with(2047).expect_err("refused").expected.contains("2047"), "above it");
}
