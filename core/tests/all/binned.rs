//! Binned mosaics: means computed by hand, saturated samples, and the light of binned and unbinned frames.

use hemilux_core::format::Pattern;
use hemilux_core::lens::Lens;
use hemilux_core::{
    Calibration, Exposure, Format, FrontEnd, Layout, LayoutError, Levels, Order, Samples, Sizes,
};

const FORMATS: [Format; 4] = [
    Format::Raw10(Pattern::Rggb),
    Format::Raw12(Pattern::Bggr),
    Format::Bayer8(Pattern::Grbg),
    Format::Bayer16(Pattern::Gbrg, 10),
];

/// Packs `codes` to the bytes of a row, as the kernel's documentation of the packed formats states.
fn pack(format: Format, codes: &[u16]) -> Vec<u8> {
    match format {
        Format::Raw10(_) => {
            let low = |four: &[u16]| (0..4).fold(0, |low, i| low | (four[i] as u8 & 3) << (2 * i));
            let group =
                |four: &[u16]| [0, 1, 2, 3].map(|i| (four[i] >> 2) as u8).into_iter().chain([low(four)]);
            codes.chunks(4).flat_map(|four| group(four).collect::<Vec<_>>()).collect()
        }
        Format::Raw12(_) => {
            let low = |two: &[u16]| (two[0] as u8 & 15) | (two[1] as u8 & 15) << 4;
            codes.chunks(2).flat_map(|two| [(two[0] >> 4) as u8, (two[1] >> 4) as u8, low(two)]).collect()
        }
        Format::Bayer8(_) => codes.iter().map(|code| *code as u8).collect(),
        _ => codes.iter().flat_map(|code| code.to_le_bytes()).collect(),
    }
}

/// Returns the total energy of a frame whose pixels have `code`, through a lens of 180 degrees.
fn total(format: Format, bin: u32, side: u32, code: impl Fn(u32, u32) -> u16) -> [f32; 3] {
    let centre = f64::from(side - 1) / 2.0;
    let lens = Lens::equidistant([centre; 2], f64::from(side) / std::f64::consts::PI, 1.5).expect("a lens");
    let layout = Layout::tight(format, side, side).and_then(|l| l.binned(bin)).expect("a layout");
    let mut calibration = Calibration::new(lens, layout);
    calibration.levels = Levels { black: 0.0, white: f64::from(format.max_code()) };
    let exposures = [Exposure { seconds: 0.01, gain: 1.0 }, Exposure { seconds: 0.04, gain: 1.0 }];
    let order = Order::try_from(4).expect("an order");
    let sizes = Sizes::of(&calibration, &exposures, order).expect("sizes");
    let mut front =
        FrontEnd::try_new(calibration, &exposures, order, vec![0; sizes.words()]).expect("a front end");
    let frame = |gain: u32| -> Vec<u8> {
        let most = format.max_code();
        let row = |y| (0..side).map(|x| (u32::from(code(x, y)) * gain).min(most) as u16).collect::<Vec<_>>();
        (0..side).flat_map(|y| pack(format, &row(y))).collect()
    };
    let frames = [frame(1), frame(4)];
    front.process(&[Samples::U8(&frames[0]), Samples::U8(&frames[1])]).expect("a burst");
    [front.map().total().y(); 3]
}

#[test]
fn binned_frames_have_the_light_of_the_frame_itself() {
    for format in FORMATS {
        // The code is a pattern per colour with means of 30 and of 90, below saturation in both exposures of 8 bits.
        let code = |x: u32, y: u32| {
            (if (x + y).is_multiple_of(2) { 20 } else { 40 }) + ((x / 2 + 2 * (y / 2)) % 4) as u16 * 4
        };
        for bin in [2, 4, 8] {
            // Merged images have 64 x 64 pixels: fewer pixels sample the rim of the lens too coarsely.
            let (full, binned) = (total(format, 1, 128 * bin, code), total(format, bin, 128 * bin, code));
            for (found, expected) in binned.iter().zip(full) {
                assert!((found / expected - 1.0).abs() < 0.02, "{format:?} / {bin}: {binned:?}, {full:?}");
            }
        }
    }
}

/// One of the 2 x 2 samples of each colour is of a lamp: saturated in the long exposure, and 60 times as bright as the other samples.
#[test]
fn a_saturated_sample_makes_its_mean_saturated() {
    for format in FORMATS {
        let most = format.max_code() as u16;
        let lamp = |x: u32, y: u32| {
            if (x / 2).is_multiple_of(2) && (y / 2).is_multiple_of(2) { most / 2 } else { most / 120 }
        };
        let (full, binned) = (total(format, 1, 64, lamp), total(format, 2, 64, lamp));
        for (found, expected) in binned.iter().zip(full) {
            assert!((found / expected - 1.0).abs() < 0.03, "{format:?}: {binned:?}, {full:?}");
        }
    }
}

#[test]
fn bins_that_a_layout_cannot_have_are_refused() {
    let raw = Layout::tight(Format::Raw10(Pattern::Rggb), 1640, 1232).expect("a layout");
    let merged = raw.binned(2).expect("a bin").merged_size();
    assert_eq!((merged.width, merged.height), (410, 308), "a quarter of the frame");
    for bin in [0, 3, 16, u32::MAX] {
        assert_eq!(raw.binned(bin), Err(LayoutError::BadSize), "{bin}");
    }
    let rgb = Layout::tight(Format::Rgb24, 640, 480).expect("a layout");
    assert_eq!(rgb.binned(2), Err(LayoutError::BadSize), "no mosaic");
}
