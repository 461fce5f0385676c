//! Writing of map files, with a statement of the part of the sphere that a map covers.

use super::Covers;
use exr::meta::attribute::{AttributeValue, EnvironmentMap, Text};
use exr::prelude::{Encoding, Image, Layer, LayerAttributes, SpecificChannels, WritableImage};

/// Name of the OpenEXR attribute for the covered part of the sphere, with the value `sphere` or `hemisphere`.
pub const COVERS: &str = "hemilux.covers";

/// Returns the line of a Radiance header that states the covered part of the sphere, with a line feed at the end.
#[must_use]
pub fn radiance_line(covers: Covers) -> String {
    format!("HEMILUX_COVERS={}\n", covers.name())
}

/// Adds [`radiance_line`] to the header of an encoded Radiance picture.
pub fn state_coverage(picture: &mut Vec<u8>, covers: Covers) {
    let after_signature = picture.iter().position(|b| *b == b'\n').map_or(0, |at| at + 1);
    picture.splice(after_signature..after_signature, radiance_line(covers).into_bytes());
}

/// Returns the OpenEXR attributes of a latitude-longitude map that covers `covers`.
#[must_use]
pub fn attributes(covers: Covers) -> LayerAttributes {
    let mut attributes =
        LayerAttributes { software_name: Some("hemilux".into()), ..LayerAttributes::default() };
    // The attribute `envmap` of OpenEXR is defined for the whole sphere alone.
    if covers == Covers::Sphere {
        attributes.environment_map = Some(EnvironmentMap::LatitudeLongitude);
    }
    attributes.other.insert(Text::from(COVERS), AttributeValue::Text(covers.name().into()));
    attributes
}

/// Encodes a map as 32-bit OpenEXR; `radiance(row, column)` returns the linear Rec. 709 radiance of a texel.
///
/// # Errors
/// The error of the encoder.
pub fn openexr(
    width: usize,
    height: usize,
    covers: Covers,
    radiance: impl Fn(usize, usize) -> [f32; 3] + Sync,
) -> Result<Vec<u8>, exr::error::Error> {
    let pixel = |at: exr::math::Vec2<usize>| {
        let [r, g, b] = radiance(at.y(), at.x());
        (r, g, b)
    };
    let channels = SpecificChannels::rgb(pixel);
    let layer = Layer::new((width, height), attributes(covers), Encoding::FAST_LOSSLESS, channels);
    let mut bytes = std::io::Cursor::new(Vec::new());
    Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes)?;
    Ok(bytes.into_inner())
}
