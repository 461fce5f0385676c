//! Fuzz target: OpenEXR, Radiance HDR and PFM maps, in every projection.

#![no_main]

use hemilux::maps::{Covers, Projection, ReadOptions, read_from};
use libfuzzer_sys::fuzz_target;
use std::io::Cursor;

const PROJECTIONS: [Option<Projection>; 5] = [
    None,
    Some(Projection::LatLong),
    Some(Projection::Angular),
    Some(Projection::MirrorBall),
    Some(Projection::Cube),
];

fuzz_target!(|bytes: &[u8]| {
    // The last byte selects the projection of the map.
    let Some((choice, file)) = bytes.split_last() else { return };
    let covers = [None, Some(Covers::Sphere), Some(Covers::Hemisphere)][usize::from(choice / 5 % 3)];
    let projection = PROJECTIONS[usize::from(choice % 5)];
    let options = ReadOptions { max_pixels: Some(1 << 14), projection, covers, layer: None };
    if let Ok(map) = read_from(Cursor::new(file), file.len() as u64, &options) {
        assert_eq!(map.texels.len(), map.width * map.height, "texels do not fill the map");
        assert!(map.texels.as_flattened().iter().all(|v| v.is_finite() && *v >= 0.0), "a texel out of range");
    }
});
