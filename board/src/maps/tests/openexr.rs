//! OpenEXR files: layers, windows, chromaticities, parts, tiles and sample types.

use super::*;

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
    // The white of ACES AP0 is (0.95265, 1, 1.00883) in XYZ; the expected texels are its Rec. 709 colour without adaptation, by the sRGB
    // matrix.
    let mut image = uniform(&[("R", 1.0), ("G", 1.0), ("B", 1.0)], (4, 2), LayerAttributes::default());
    image.attributes.chromaticities = Some(AP0);
    assert_close(decode(&written(&image)).expect("a map").texels[0], [1.04696, 0.99465, 0.91539]);
}

const AP0: attribute::Chromaticities = attribute::Chromaticities {
    red: Vec2(0.7347, 0.2653),
    green: Vec2(0.0, 1.0),
    blue: Vec2(0.0001, -0.077),
    white: Vec2(0.32168, 0.33767),
};

/// Returns a map of 4 x 2 half-float texels of ACES AP0 whose first texel is `first`.
fn aces(first: [f32; 3]) -> DecodedMap {
    let channels = SpecificChannels::rgb(move |at: Vec2<usize>| {
        let [r, g, b] = if at == Vec2(0, 0) { first } else { [0.5; 3] }.map(f16::from_f32);
        (r, g, b)
    });
    let layer = Layer::new((4, 2), LayerAttributes::default(), Encoding::FAST_LOSSLESS, channels);
    let mut image = Image::from_layer(layer);
    image.attributes.chromaticities = Some(AP0);
    let mut bytes = Cursor::new(Vec::new());
    image.write().non_parallel().to_buffered(&mut bytes).expect("a file");
    decode(bytes.get_ref()).expect("a map")
}

#[test]
fn half_floats_of_other_primaries_are_limited_before_they_are_converted() {
    // The texel is Rec. 709 (90000, 30000, 10000), whose components in AP0 are half floats.
    let map = aces([52119.0, 33573.0, 14691.0]);
    for (found, expected) in map.texels[0].into_iter().zip([90_000.0, 30_000.0, 10_000.0]) {
        assert!((found / expected - 1.0).abs() < 2e-3, "{:?}", map.texels[0]);
    }
    assert_eq!((map.negative, map.clipped), (0, vec![0, 0]), "nothing is out of range");
    let infinite = aces([f32::INFINITY; 3]);
    assert_eq!((infinite.negative, infinite.clipped), (0, vec![1, 0]), "infinity is told");
    let white = [1.04696, 0.99465, 0.91539].map(|v| v * f64::from(HALF_MAX));
    assert_close(infinite.texels[0], white);
}

#[test]
fn known_openexr_colour_spaces_are_applied_and_unknown_ones_noted() {
    let with = |key: &str, value: AttributeValue| {
        let mut image = uniform(&[("R", 1.0), ("G", 1.0), ("B", 1.0)], (4, 2), LayerAttributes::default());
        image.layer_data.attributes.other.insert(key.into(), value);
        written(&image)
    };
    let named = |key: &str, name: &str| decode(&with(key, AttributeValue::Text(name.into()))).expect("a map");
    let white = [1.04696, 0.99465, 0.91539];
    assert_close(named("colorInteropID", "lin_ap0_scene").texels[0], white);
    assert_close(named("oiio:ColorSpace", "ACEScg").texels[0], white);
    let container = decode(&with("acesImageContainerFlag", AttributeValue::I32(1))).expect("a map");
    assert_close(container.texels[0], white);
    let linear = named("colorInteropID", "lin_rec709_scene");
    assert_eq!((linear.texels[0], linear.notes.len()), ([1.0; 3], 0), "{:?}", linear.notes);
    let unknown = named("oiio:ColorSpace", "Filmic");
    assert!(unknown.notes.iter().any(|note| note.contains("oiio:ColorSpace Filmic")), "{:?}", unknown.notes);
    assert!(refusal(&with("Orientation", AttributeValue::I32(3))).contains("Orientation"), "turned");
    assert!(decode(&with("Orientation", AttributeValue::I32(1))).is_ok(), "upright");
}

#[test]
fn openexr_blocks_that_are_missing_are_refused() {
    const ROWS: usize = 8;
    let channels = SpecificChannels::rgb(|at: Vec2<usize>| (at.x() as f32, at.y() as f32, 1.0f32));
    let layer = Layer::new((16, ROWS), LayerAttributes::default(), Encoding::UNCOMPRESSED, channels);
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).expect("a file");
    let bytes = bytes.into_inner();
    // The first offset in the offset table is the position of the table's own end.
    let u64_at = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight bytes"));
    let table = (0..bytes.len() - 8).find(|at| u64_at(*at) == (at + 8 * ROWS) as u64).expect("a table");
    assert!(decode(&bytes).is_ok(), "all blocks");
    let mut twice = bytes.clone();
    let first = u64_at(table).to_le_bytes();
    twice[table + 8 * (ROWS - 1)..table + 8 * ROWS].copy_from_slice(&first);
    assert!(refusal(&twice).contains("two blocks at column 0, row 0"), "{}", refusal(&twice));
    let second = u64_at(table + 8) as usize;
    let mut moved = bytes.clone();
    moved[second..second + 4].copy_from_slice(&[0; 4]);
    assert!(refusal(&moved).contains("two blocks at"), "{}", refusal(&moved));
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

/// The counters of a DWA block follow its position and its length; the tenth and the first ones are the version and the kind of the coefficients.
#[test]
fn sizes_of_dwa_blocks_that_exceed_the_block_are_refused() {
    let channels = SpecificChannels::rgb(|at: Vec2<usize>| {
        let v = (at.x() * 7 + at.y() * 13) as f32;
        (f16::from_f32(v.sin().abs()), f16::from_f32(v.cos().abs()), f16::ONE)
    });
    for (compression, blocks) in [
        (Compression::DWAA(None), Blocks::ScanLines),
        (Compression::DWAB(None), Blocks::ScanLines),
        (Compression::DWAA(None), Blocks::Tiles(Vec2(64, 32))),
    ] {
        let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
        let layer = Layer::new((64, 32), LayerAttributes::default(), encoding, channels.clone());
        let mut bytes = Cursor::new(Vec::new());
        Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).expect("a file");
        let bytes = bytes.into_inner();
        decode(&bytes).expect("a map");
        let version = 2u64.to_le_bytes();
        let at = bytes.windows(8).rposition(|eight| eight == version).expect("the version of the block");
        for counter in [1, 6, 7, 8, 9] {
            let mut larger = bytes.clone();
            larger[at + 8 * counter + 5] = 1;
            let told = refusal(&larger);
            assert!(told.contains("pixels | at most"), "{compression:?}, counter {counter}: {told}");
        }
    }
}
