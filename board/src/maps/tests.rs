//! Each header field against its meaning, in files that are written here.

use super::{Covers, DecodedMap, FLOAT_MAX, HALF_MAX, Projection, ReadOptions, Refusal, read_from, write};
use exr::prelude::*;
use std::f64::consts::PI;
use std::io::Cursor;

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

/// Flat texels of a 4 x 2 map, texel k with the mantissas (k + 1, 0, 0) and exponent 128 (a factor of 1/256).
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
fn radiance_orientations_give_the_same_upright_picture() {
    // The upright picture has the texels 1 2 3 4 / 5 6 7 8; each order lists them as it stores them.
    let orders: [(&str, [u8; 8]); 8] = [
        ("-Y 2 +X 4", [1, 2, 3, 4, 5, 6, 7, 8]),
        ("-Y 2 -X 4", [4, 3, 2, 1, 8, 7, 6, 5]),
        ("+Y 2 +X 4", [5, 6, 7, 8, 1, 2, 3, 4]),
        ("+Y 2 -X 4", [8, 7, 6, 5, 4, 3, 2, 1]),
        ("+X 4 -Y 2", [1, 5, 2, 6, 3, 7, 4, 8]),
        ("+X 4 +Y 2", [5, 1, 6, 2, 7, 3, 8, 4]),
        ("-X 4 -Y 2", [4, 8, 3, 7, 2, 6, 1, 5]),
        ("-X 4 +Y 2", [8, 4, 7, 3, 6, 2, 5, 1]),
    ];
    for (line, stored) in orders {
        let body: Vec<u8> = stored.into_iter().flat_map(|v| [v, 0, 0, 128]).collect();
        let map = decode(&radiance(&format!("\n{line}\n"), &body)).expect(line);
        assert_eq!((map.width, map.height), (4, 2), "{line}");
        assert_eq!(reds(&map), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0], "{line}");
    }
}

#[test]
fn radiance_factors_divide_and_multiply_each_other() {
    let red = |header: &str| {
        reds(&decode(&radiance(&format!("{header}\n\n-Y 2 +X 4\n"), &flat())).expect(header))[0]
    };
    for (header, expected) in [
        ("EXPOSURE=4", 0.25),
        ("EXPOSURE= 4.0\nEXPOSURE=0.5", 0.5),
        ("EXPOSURE=0", 1.0),
        ("\tEXPOSURE=4", 1.0),
        ("COLORCORR=2 1 1", 0.5),
        ("COLORCORR= 2 1 1\nCOLORCORR=4 3 3\nEXPOSURE=2", 0.0625),
        ("COLORCORR=0 0 0", 1.0),
        ("pfilt -e 2\nSOFTWARE=x = y\nPIXASPECT=2", 1.0),
        ("FORMAT=32-bit_rle_rgbe\r", 1.0),
        ("GAMMA=1.0", 1.0),
    ] {
        assert_eq!(red(header), expected, "{header:?}");
    }
    for bad in [
        "EXPOSURE=-1",
        "EXPOSURE=nan",
        "EXPOSURE=x",
        "EXPOSURE=1e40",
        "COLORCORR=1 1",
        "FORMAT=32-bit_rle_luv",
        "PRIMARIES=0 0 0 0 0 0 0 0",
        "PRIMARIES=1 2",
        "HEMILUX_COVERS=disc",
        "GAMMA=2.2",
    ] {
        let told = refusal(&radiance(&format!("{bad}\n\n-Y 2 +X 4\n"), &flat()));
        assert!(told.contains(&bad[..4]) || told.contains("primaries"), "{bad}: {told}");
    }
}

#[test]
fn radiance_lines_may_end_with_cr_lf_and_begin_with_any_signature() {
    for signature in ["#?RADIANCE", "#?RGBE", "#?SomeProgram"] {
        let bytes = [format!("{signature}\r\nEXPOSURE=2\r\n\r\n-Y 2 +X 4\r\n").as_bytes(), &flat()].concat();
        assert_eq!(reds(&decode(&bytes).expect(signature))[7], 4.0, "{signature}");
    }
}

#[test]
fn radiance_primaries_and_xyze_become_rec_709() {
    // (0.37276, 0.34935, 0.14241) is the XYZ of the Rec. 709 colour (0.6, 0.3, 0.1), by the matrix of IEC 61966-2-1.
    let mantissas = [0.37276, 0.34935, 0.14241].map(|v: f64| (v * 512.0).round() as u8);
    let body: Vec<u8> = (0..8).flat_map(|_| [mantissas[0], mantissas[1], mantissas[2], 127]).collect();
    for header in ["FORMAT=32-bit_rle_xyze", "PRIMARIES=1 0 0 1 0 0 0.333333333 0.333333333"] {
        let map = decode(&radiance(&format!("{header}\n\n-Y 2 +X 4\n"), &body)).expect(header);
        for (found, expected) in map.texels[3].iter().zip([0.6, 0.3, 0.1]) {
            assert!((found - expected).abs() < 0.01, "{header}: {:?}", map.texels[3]);
        }
        assert_eq!(map.notes.len(), 1, "{header}: {:?}", map.notes);
    }
    let same = "PRIMARIES=0.64 0.33 0.3 0.6 0.15 0.06 0.3127 0.329";
    assert!(
        decode(&radiance(&format!("{same}\n\n-Y 2 +X 4\n"), &flat())).expect("Rec. 709").notes.is_empty()
    );
}

#[test]
fn radiance_views_are_refused_unless_a_projection_is_named() {
    let bytes = radiance("VIEW= -vtv -vp 0 0 0 -vd 0 1 0 -vh 45 -vv 45\n\n-Y 2 +X 4\n", &flat());
    assert!(refusal(&bytes).contains("-vtv"), "named");
    let options = ReadOptions { projection: Some(Projection::LatLong), ..ReadOptions::default() };
    assert!(decode_with(&bytes, &options).is_ok(), "overruled");
    assert!(decode(&radiance("VIEW= -vp 1 2 3\n\n-Y 2 +X 4\n", &flat())).is_ok(), "a position");
}

#[test]
fn radiance_scanlines_of_all_three_encodings_are_read() {
    let header = "\n-Y 1 +X 8\n";
    let by_component = [&[2, 2, 0, 8, 136, 9, 3, 1, 2, 3, 133, 7, 136, 0, 136, 128][..]].concat();
    let old_runs = [&[9, 1, 0, 128, 9, 2, 0, 128, 9, 3, 0, 128, 9, 7, 0, 128, 1, 1, 1, 4][..]].concat();
    let plain: Vec<u8> = [1, 2, 3, 7, 7, 7, 7, 7].into_iter().flat_map(|g| [9, g, 0, 128]).collect();
    for (name, body) in [("by component", by_component), ("old runs", old_runs), ("flat", plain)] {
        let map = decode(&radiance(header, &body)).expect(name);
        let greens: Vec<f32> = map.texels.iter().map(|t| t[1] * 256.0).collect();
        assert_eq!(greens, [1.0, 2.0, 3.0, 7.0, 7.0, 7.0, 7.0, 7.0], "{name}");
        assert_eq!(reds(&map), [9.0; 8], "{name}");
    }
    // Repeats in sequence are digits of base 256.
    let body = [&[5, 0, 0, 128, 1, 1, 1, 2, 1, 1, 1, 1][..]].concat();
    let map = decode(&radiance("\n-Y 1 +X 259\n", &body)).expect("a long run");
    assert_eq!(reds(&map), [5.0; 259], "258 repeats");
}

#[test]
fn broken_radiance_files_are_refused_by_name() {
    for (header, body, part) in [
        ("\n-Y 1 +X 8\n", &[2, 2, 0, 9][..], "9 texels"),
        ("\n-Y 1 +X 8\n", &[2, 2, 0, 8, 200, 1], "beyond the end"),
        ("\n-Y 1 +X 8\n", &[2, 2, 0, 8, 136], "end of the file"),
        ("\n-Y 1 +X 8\n", &[1, 1, 1, 9], "without a texel"),
        ("\n-Y 1 +X 8\n", &[5, 0, 0, 1, 1, 1, 1, 9], "beyond the end"),
        ("\n-Y 2 -Y 2\n", &[], "-Y 2 -Y 2"),
        ("\n-Y 0 +X 2\n", &[], "0 texels"),
        ("\n-Y 2\n", &[], "resolution line"),
        ("\n-Y 4000000000 +X 4000000000\n", &[], "at most"),
        ("FORMAT=", &[], "does not end"),
    ] {
        let told = refusal(&radiance(header, body)).replace("2 x 0", "0");
        assert!(told.contains(part), "{header:?}: {told}");
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
    assert!(refusal(b"PF\n2 2\n-2.0\n").contains("scale"), "scale");
    assert!(refusal(b"PF\n2 2\n-1.0\n....").contains("ends in row 0"), "short");
    assert!(refusal(b"PF\n100000 100000\n-1.0\n").contains("--max-pixels"), "size");
}

/// An OpenEXR file of one layer with these channels, each of one value.
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

const RGB: [(&str, f32); 3] = [("R", 3.0), ("G", 2.0), ("B", 1.0)];

#[test]
fn openexr_colour_layers_are_found_by_name() {
    let mut blender =
        vec![("ViewLayer.Combined.A", 1.0), ("ViewLayer.Depth.Z", 9.0), ("ViewLayer.Normal.X", 9.0)];
    blender.extend([("ViewLayer.Normal.Y", 9.0), ("ViewLayer.Normal.Z", 9.0)]);
    blender.extend([
        ("ViewLayer.Combined.R", 3.0),
        ("ViewLayer.Combined.G", 2.0),
        ("ViewLayer.Combined.B", 1.0),
    ]);
    let one = |channels: &[(&str, f32)]| written(&uniform(channels, (4, 2), LayerAttributes::default()));
    for channels in
        [&RGB[..], &blender, &[("Background.R", 3.0), ("Background.G", 2.0), ("Background.B", 1.0)]]
    {
        assert_eq!(decode(&one(channels)).expect("a map").texels[5], [3.0, 2.0, 1.0], "{channels:?}");
    }
    assert_eq!(decode(&one(&[("Y", 4.0), ("A", 1.0)])).expect("a map").texels[0], [4.0; 3], "grey");
    let told = refusal(&one(&[("Z", 4.0), ("N.X", 1.0), ("N.Y", 1.0)]));
    assert!(told.contains("N.X, N.Y, Z"), "{told}");
    blender.extend([
        ("ViewLayer.DiffDir.R", 7.0),
        ("ViewLayer.DiffDir.G", 7.0),
        ("ViewLayer.DiffDir.B", 7.0),
    ]);
    let several = one(&blender);
    let told = refusal(&several);
    assert!(told.contains("ViewLayer.Combined, ViewLayer.DiffDir | --layer"), "{told}");
    for (name, red) in [("ViewLayer.DiffDir", 7.0), ("Combined", 3.0)] {
        let options = ReadOptions { layer: Some(name.into()), ..ReadOptions::default() };
        assert_eq!(decode_with(&several, &options).expect(name).texels[0][0], red, "{name}");
    }
    let options = ReadOptions { layer: Some("none".into()), ..ReadOptions::default() };
    assert!(
        decode_with(&several, &options).expect_err("refused").found.contains("\"none\""),
        "an unknown layer"
    );
}

#[test]
fn openexr_data_window_is_placed_in_the_display_window() {
    let image = |at: (i32, i32), size: (usize, usize), map: Option<attribute::EnvironmentMap>| {
        let attributes = LayerAttributes {
            layer_position: Vec2(at.0, at.1),
            environment_map: map,
            ..LayerAttributes::default()
        };
        let mut image = uniform(&RGB, size, attributes);
        image.attributes.display_window = IntegerBounds::new((0, 0), (8, 4));
        written(&image)
    };
    let lit = |map: &DecodedMap| -> Vec<usize> {
        (0..map.texels.len()).filter(|k| map.texels[*k][0] > 0.0).collect()
    };
    let crop = decode(&image((2, 1), (2, 2), None)).expect("a crop");
    assert_eq!((crop.width, crop.height, lit(&crop)), (8, 4, vec![10, 11, 18, 19]), "crop");
    let over = decode(&image((-3, -1), (16, 9), None)).expect("an overscan");
    assert_eq!((over.width, over.height, lit(&over).len()), (8, 4, 32), "overscan");
    let corner = decode(&image((6, -1), (16, 2), None)).expect("both");
    assert_eq!(lit(&corner), [6, 7], "crop and overscan");
    assert!(refusal(&image((8, 0), (4, 4), None)).contains("display window"), "apart");
    let own =
        decode(&image((2, 1), (2, 1), Some(attribute::EnvironmentMap::LatitudeLongitude))).expect("a map");
    assert_eq!((own.width, own.height), (2, 1), "an environment map is its data window");
}

#[test]
fn openexr_chromaticities_become_rec_709() {
    let channels = [("R", 0.37276), ("G", 0.34935), ("B", 0.14241)];
    let mut image = uniform(
        &channels,
        (4, 2),
        LayerAttributes { white_luminance: Some(100.0), ..LayerAttributes::default() },
    );
    let third = 1.0 / 3.0;
    image.attributes.chromaticities = Some(attribute::Chromaticities {
        red: Vec2(1.0, 0.0),
        green: Vec2(0.0, 1.0),
        blue: Vec2(0.0, 0.0),
        white: Vec2(third, third),
    });
    let map = decode(&written(&image)).expect("a map");
    assert_close(map.texels[0], [0.6, 0.3, 0.1]);
    assert!(map.notes.iter().any(|n| n.contains("whiteLuminance 100")), "{:?}", map.notes);
    // White of ACES AP0 is (0.95265, 1, 1.00883) in XYZ; in Rec. 709 without adaptation that is this, by the sRGB matrix.
    let mut image = uniform(&[("R", 1.0), ("G", 1.0), ("B", 1.0)], (4, 2), LayerAttributes::default());
    image.attributes.chromaticities = Some(attribute::Chromaticities {
        red: Vec2(0.7347, 0.2653),
        green: Vec2(0.0, 1.0),
        blue: Vec2(0.0001, -0.077),
        white: Vec2(0.32168, 0.33767),
    });
    assert_close(decode(&written(&image)).expect("a map").texels[0], [1.04696, 0.99465, 0.91539]);
}

#[test]
fn openexr_parts_are_layers() {
    let part = |name: &str, value: f32| {
        let channels = [("R", value), ("G", value), ("B", value)];
        let attributes = LayerAttributes { layer_name: Some(name.into()), ..LayerAttributes::default() };
        uniform(&channels, (4, 2), attributes).layer_data
    };
    let attributes = ImageAttributes::new(IntegerBounds::new((0, 0), (4, 2)));
    let image = Image::empty(attributes).with_layer(part("left", 1.0)).with_layer(part("right", 2.0));
    let mut bytes = Cursor::new(Vec::new());
    image.write().non_parallel().to_buffered(&mut bytes).expect("a file");
    let bytes = bytes.into_inner();
    assert!(refusal(&bytes).contains("left, right"), "both are named");
    let options = ReadOptions { layer: Some("right".into()), ..ReadOptions::default() };
    assert_eq!(decode_with(&bytes, &options).expect("a part").texels[0], [2.0; 3], "the second part");
}

#[test]
fn tiles_and_half_floats_are_read() {
    let channels = SpecificChannels::rgb(|at: Vec2<usize>| {
        (f16::from_f32((at.y() * 40 + at.x()) as f32), f16::ONE, f16::INFINITY)
    });
    for blocks in [Blocks::Tiles(Vec2(16, 8)), Blocks::ScanLines] {
        let encoding = Encoding { compression: Compression::ZIP1, blocks, line_order: LineOrder::Increasing };
        let layer = Layer::new((40, 20), LayerAttributes::default(), encoding, channels.clone());
        let mut bytes = Cursor::new(Vec::new());
        Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).expect("a file");
        let map = decode(bytes.get_ref()).expect("a map");
        for (k, texel) in map.texels.iter().enumerate() {
            assert_eq!(*texel, [k as f32, 1.0, HALF_MAX], "texel {k}");
        }
        assert_eq!(map.clipped, [40; 20], "infinities of half floats are counted");
    }
}

#[test]
fn floats_above_the_half_range_keep_their_value() {
    let channels = [("R", 300_000.0), ("G", f32::NAN), ("B", -1.0)];
    let map = decode(&written(&uniform(&channels, (4, 2), LayerAttributes::default()))).expect("a map");
    assert_eq!((map.texels[0], map.negative), ([300_000.0, 0.0, 0.0], 8), "kept");
    assert_eq!(map.clipped, [0, 0], "nothing is clipped");
    let channels = [("R", 1e30), ("G", f32::INFINITY), ("B", 1.0)];
    let map = decode(&written(&uniform(&channels, (4, 2), LayerAttributes::default()))).expect("a map");
    assert_eq!((map.texels[0], map.clipped), ([FLOAT_MAX, HALF_MAX, 1.0], vec![4, 4]), "counted");
}

#[test]
fn coverage_comes_back_and_can_be_overruled() {
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

/// A map of `size` whose texel (column, row) has the value of `paint`.
fn painted(size: (usize, usize), paint: impl Fn(usize, usize) -> f32 + Sync) -> Vec<u8> {
    write::openexr(size.0, size.1, Covers::Sphere, |row, column| [paint(column, row); 3]).expect("a file")
}

/// Flux over the sphere, and the flux-weighted direction.
fn flux(map: &DecodedMap) -> (f64, [f64; 3]) {
    let edge = |i: usize| (i as f64 * PI / map.height as f64).cos();
    let (mut sum, mut moment) = (0.0, [0.0; 3]);
    for (k, texel) in map.texels.iter().enumerate() {
        let (row, column) = (k / map.width, k % map.width);
        let e = f64::from(texel[0]) * (edge(row) - edge(row + 1)) * 2.0 * PI / map.width as f64;
        let theta = (row as f64 + 0.5) * PI / map.height as f64;
        let phi = PI - (column as f64 + 0.5) * 2.0 * PI / map.width as f64;
        let d = [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()];
        moment.iter_mut().zip(d).for_each(|(m, v)| *m += e * v);
        sum += e;
    }
    (sum, moment.map(|m| m / sum))
}

fn projected(bytes: &[u8], projection: Projection) -> DecodedMap {
    decode_with(bytes, &ReadOptions { projection: Some(projection), ..ReadOptions::default() })
        .expect("a map")
}

#[test]
fn uniform_maps_of_every_projection_have_the_flux_of_the_sphere() {
    for (projection, size) in [
        (Projection::Angular, (64, 64)),
        (Projection::MirrorBall, (64, 64)),
        (Projection::Cube, (48, 64)),
        (Projection::Cube, (64, 48)),
        (Projection::Cube, (16, 96)),
    ] {
        let (sum, moment) = flux(&projected(&painted(size, |_, _| 1.0), projection));
        assert!((sum / (4.0 * PI) - 1.0).abs() < 0.005, "{projection:?} {size:?}: {sum}");
        assert!(moment.iter().all(|m| m.abs() < 0.01), "{projection:?} {size:?}: {moment:?}");
    }
    let square = painted((64, 32), |_, _| 1.0);
    let options = ReadOptions { projection: Some(Projection::Angular), ..ReadOptions::default() };
    assert!(decode_with(&square, &options).expect_err("refused").expected.contains("square"), "2:1");
}

#[test]
fn texels_of_cube_maps_have_the_solid_angles_of_their_definitions() {
    // A square of half side h on a face of half side 1: 4 asin(h^2 / (1 + h^2)).
    let square = |h: f64| 4.0 * (h * h / (1.0 + h * h)).asin();
    let middle = |place: (usize, usize)| move |x: usize, y: usize| f32::from(u8::from((x, y) == place));
    // OpenEXR: of five texels in a row the first and the last are centred on the edges.
    let (strip, _) = flux(&projected(&painted((5, 30), middle((2, 2))), Projection::Cube));
    assert!((strip / square(1.0 / 4.0) - 1.0).abs() < 1e-6, "{strip}");
    let (cross, _) = flux(&projected(&painted((15, 20), middle((7, 7))), Projection::Cube));
    assert!((cross / square(1.0 / 5.0) - 1.0).abs() < 1e-6, "{cross}");
}

#[test]
fn projections_put_lamps_where_their_definitions_do() {
    // A lamp to the left of forward by 45 degrees, by hand from each definition.
    let left = [0.5f64.sqrt(), 0.5f64.sqrt(), 0.0];
    let up = [0.0, 0.0, 1.0];
    let lamp = |at: (usize, usize)| move |x: usize, y: usize| f32::from(u8::from((x, y) == at)) * 100.0;
    let cases = [
        // Angular: radius 45 / 180 of 64 texels left of the centre; the zenith at radius 1/2.
        (Projection::Angular, (128, 128), (47, 63), left),
        (Projection::Angular, (128, 128), (63, 32), up),
        // Ball: radius sin(22.5 degrees) of 64 texels, on the right as reflections are; the zenith at sin(45 degrees).
        (Projection::MirrorBall, (128, 128), (88, 63), left),
        (Projection::MirrorBall, (128, 128), (63, 18), up),
        // Crosses: the edge between the left and the front face; the middle of the top face.
        (Projection::Cube, (96, 128), (32, 47), left),
        (Projection::Cube, (128, 96), (32, 47), left),
        (Projection::Cube, (96, 128), (47, 15), up),
        // OpenEXR: face +X is 90 degrees to the left, and its right edge touches +Z.
        (Projection::Cube, (32, 192), (31, 15), left),
        (Projection::Cube, (32, 192), (15, 79), up),
    ];
    for (projection, size, at, expected) in cases {
        let (_, moment) = flux(&projected(&painted(size, lamp(at)), projection));
        let cosine: f64 = moment.iter().zip(expected).map(|(a, b)| a * b).sum();
        assert!(
            cosine > 4f64.to_radians().cos(),
            "{projection:?} {size:?}: {moment:?}, expected {expected:?}"
        );
    }
    // The back face of a vertical cross is upside down: its lower edge touches the top face, at 45 degrees above the horizon behind.
    let (_, moment) = flux(&projected(&painted((96, 128), lamp((47, 127))), Projection::Cube));
    assert!(moment[0] < -0.68 && moment[2] > 0.68, "{moment:?}");
    let (_, moment) = flux(&projected(&painted((96, 128), lamp((32, 111))), Projection::Cube));
    assert!(
        moment[0] < -0.68 && moment[1] > 0.68,
        "the back face's left edge touches the left face: {moment:?}"
    );
}

#[test]
fn openexr_cube_maps_are_converted_as_stated() {
    let attributes = LayerAttributes {
        environment_map: Some(attribute::EnvironmentMap::Cube),
        ..LayerAttributes::default()
    };
    let map = decode(&written(&uniform(&RGB, (8, 48), attributes))).expect("a map");
    assert_eq!((map.width, map.height), (32, 16), "a latitude-longitude map");
    assert!((flux(&map).0 / (12.0 * PI) - 1.0).abs() < 0.005, "flux");
}

#[test]
fn shapes_that_are_not_two_to_one_are_told() {
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
fn max_pixels_takes_the_place_of_both_limits() {
    let bytes = painted((64, 32), |_, _| 1.0);
    let with = |max_pixels| {
        decode_with(&bytes, &ReadOptions { max_pixels: Some(max_pixels), ..ReadOptions::default() })
    };
    assert!(with(2048).is_ok(), "at the limit");
    assert!(with(2047).expect_err("refused").expected.contains("2047"), "above it");
}
