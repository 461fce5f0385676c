//! Tests of Radiance HDR files: header fields, encodings and refusals.

use super::*;

#[test]
fn radiance_orientations_give_the_same_upright_picture() {
    // The upright picture has the texels 1 2 3 4 / 5 6 7 8; each order is listed in its order of storage.
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
    // (0.37276, 0.34935, 0.14241) is the XYZ of the Rec. 709 colour (0.6, 0.3, 0.1) by the matrix of IEC 61966-2-1.
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
