//! Converts three exposures of a fisheye camera to sixteen lights without heap and files. Only the printing and `Box` need `std`.
use hemilux_core::{Calibration, Exposure, Format, FrontEnd, Lens, Q2Tree};

const SIDE: usize = 64;
const LIGHTS: usize = 16;
/// Exposure times of the burst's three frames, seconds, ascending.
const TIMES: [f64; 3] = [0.001, 0.008, 0.064];

/// Stands in for a camera: returns rows of red, green and blue bytes of a sky and a lamp.
fn take_frame(seconds: f64) -> [[[u8; 3]; SIDE]; SIDE] {
    let mut frame = [[[0; 3]; SIDE]; SIDE];
    for (y, row) in frame.iter_mut().enumerate() {
        for (x, pixel) in row.iter_mut().enumerate() {
            let is_lamp = x.abs_diff(44) + y.abs_diff(20) < 5;
            let radiance = if is_lamp { [90.0, 70.0, 40.0] } else { [0.5, 0.7, 1.0] };
            *pixel = radiance.map(|v| (v * seconds * 2500.0) as u8);
        }
    }
    frame
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // The lens: r = f theta round the middle of the image, up to 90 degrees off axis.
    let lens = Lens::equidistant([31.5, 31.5], 20.0, 90f64.to_radians())?;
    let mut calibration = Calibration::try_new(lens, Format::Rgb24, SIDE as u32, SIDE as u32)?;
    calibration.scale = 255.0 / 2500.0;

    // The front end: a map of order 3 has 512 texels. Memory that is too short is refused with the length that is needed.
    let exposures = TIMES.map(|seconds| Exposure { seconds, gain: 1.0 });
    let mut memory = [0u64; 6000];
    let mut front = FrontEnd::try_new(calibration, &exposures, 3.try_into()?, &mut memory)?;

    // The sampler: 21 bytes hold one bit for each quad of the map that the tree can split.
    let (heap, lights, past) =
        ([Default::default(); LIGHTS], [Default::default(); LIGHTS], [Default::default(); LIGHTS]);
    let mut tree = Q2Tree::try_new(Default::default(), front.shape(), [[0; 21]; 2], heap, lights, past)?;

    // One burst.
    let frames = TIMES.map(take_frame);
    let frames = frames.each_ref().map(|frame| frame.as_flattened().as_flattened().into());
    let coverage = front.process(&frames)?;
    println!("{:.1} % of the hemisphere clips", 100.0 * coverage.clipped);
    for light in front.decompose(&mut tree, LIGHTS).lights {
        println!("light {}: towards {}, irradiance {:?}", light.id, light.direction, light.irradiance);
    }
    Ok(())
}
