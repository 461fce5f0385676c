//! OpenEXR files: scan lines and tiles, single-part and multi-part, flat images.

mod colours;
mod dwa;
mod layers;
mod pixels;

use super::limit::Budget;
use super::write::COVERS;
use super::{Covers, DecodedFile, Projection, ReadOptions, Refusal, Stated};
use exr::compression::Compression;
use exr::meta::attribute::{AttributeValue, EnvironmentMap, IntegerBounds, SampleType, Text};
use exr::meta::header::Header;
use layers::Layer;
use std::io::{BufRead, Seek};

const IDENTITY: [f32; 16] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];

const EXPECTED: &str = "an OpenEXR file that decodes";

pub(super) fn is(begin: &[u8]) -> bool {
    begin.starts_with(&[0x76, 0x2f, 0x31, 0x01])
}

pub(super) fn read(
    reader: impl BufRead + Seek,
    budget: &Budget,
    options: &ReadOptions,
) -> Result<DecodedFile, Refusal> {
    let reader = exr::block::read(reader, false).map_err(|e| Refusal::new(e, EXPECTED))?;
    let headers = reader.headers().to_vec();
    let layer = layers::choose(&headers, options.layer.as_deref())?;
    let header = &headers[layer.part];
    let window = map_window(header, options)?;
    let [width, height] = [window.size.x() as u64, window.size.y() as u64];
    let is_dwa = matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_));
    let budget = if is_dwa { &budget.of_dwa() } else { budget };
    budget.check(width, height)?;
    check_blocks(header, budget)?;
    let mut raster = budget.raster(width, height)?;
    pixels::decode(reader, header, &layer, window, &mut raster)?;
    let mut stated = stated(header, &layer)?;
    let space = colours::of(header, &mut stated.notes);
    if let Some(space) = space.filter(|space| !space.primaries.are_rec_709()) {
        stated.to_rec_709 = Some(space.primaries.to_rec_709()?);
        stated.notes.push(format!(
            "converted from the file's {} to Rec. 709 without adaptation of white",
            space.stated_by
        ));
    }
    if window != data_window(header) {
        let place = |b: IntegerBounds| {
            format!("{} x {} at ({}, {})", b.size.x(), b.size.y(), b.position.x(), b.position.y())
        };
        let data = place(data_window(header));
        stated.notes.push(format!("data window {data} placed in the display window {}", place(window)));
    }
    Ok(DecodedFile { raster, stated })
}

fn data_window(header: &Header) -> IntegerBounds {
    IntegerBounds { position: header.own_attributes.layer_position, size: header.layer_size }
}

/// Returns the window of the file that contains the map. In environment maps with the attribute `envmap`, it is the data window (OpenEXR,
/// "Environment Maps"); in other files, it is the display window, in which missing texels are black and outside of which texels are
/// dropped.
fn map_window(header: &Header, options: &ReadOptions) -> Result<IntegerBounds, Refusal> {
    let (data, display) = (data_window(header), header.shared_attributes.display_window);
    let is_environment = options.projection.is_none() && header.own_attributes.environment_map.is_some();
    if is_environment || data == display {
        return Ok(data);
    }
    let inside = |a: i32, a_size: usize, b: i32, b_size: usize| {
        let (a, b) = (i64::from(a), i64::from(b));
        a < b + b_size as i64 && b < a + a_size as i64
    };
    let overlap = inside(data.position.x(), data.size.x(), display.position.x(), display.size.x())
        && inside(data.position.y(), data.size.y(), display.position.y(), display.size.y());
    if overlap {
        return Ok(display);
    }
    let found = format!("the data window {data:?} outside of the display window {display:?}");
    Err(Refusal::new(found, "windows that overlap"))
}

/// Checks the memory of one compressed block before the first block is decompressed.
fn check_blocks(header: &Header, budget: &Budget) -> Result<(), Refusal> {
    budget.check(header.layer_size.x() as u64, header.layer_size.y() as u64)?;
    let block = header.max_block_byte_size() as u64;
    let most = 1024 * budget.bytes.max(1 << 12);
    if block <= most {
        return Ok(());
    }
    let found = format!("blocks of {block} bytes in a file of {} bytes", budget.bytes);
    Err(Refusal::new(found, format!("at most {most} bytes a block")))
}

fn stated(header: &Header, layer: &Layer) -> Result<Stated, Refusal> {
    let own = &header.own_attributes;
    let mut notes = Vec::new();
    if layer.is_one_of_several {
        let name = if layer.name.is_empty() { "without a name" } else { &layer.name };
        notes.push(format!("read the layer {name}"));
    }
    if let Some(luminance) = own.white_luminance {
        notes.push(format!(
            "whiteLuminance {luminance} cd/m2 is not applied: radiance is in the unit of the file"
        ));
    }
    if let Some(matrix) = own.world_to_camera.filter(|m| *m != IDENTITY) {
        notes.push(format!(
            "worldToCamera {matrix:?} is not applied: the map is read as standing upright in the world"
        ));
    }
    let half = layer.channels.iter().all(|c| header.channels.list[*c].sample_type == SampleType::F16);
    let projection = match own.environment_map {
        Some(EnvironmentMap::Cube) => Some(Projection::Cube),
        Some(EnvironmentMap::LatitudeLongitude) => Some(Projection::LatLong),
        None => None,
    };
    let covers = covers(header)?;
    if own.environment_map == Some(EnvironmentMap::LatitudeLongitude) && covers.is_none() {
        let off = 180.0 / header.layer_size.y().max(1) as f64 / 2.0;
        notes.push(format!(
            "envmap latlong is read with the first texel's centre half a texel from the seam and the pole, as renderers do; OpenEXR's \
             own programs put it on them: directions differ by up to {off:.2} degrees"
        ));
    }
    check_orientation(header)?;
    Ok(Stated { covers, projection, half, to_rec_709: None, notes })
}

/// Refuses the attribute of OpenImageIO and Photoshop that states a rotation of the picture.
fn check_orientation(header: &Header) -> Result<(), Refusal> {
    match attribute(header, "Orientation") {
        None | Some(AttributeValue::I32(1)) => Ok(()),
        Some(other) => Err(Refusal::new(format!("the attribute Orientation {other:?}"), "1, an upright map")),
    }
}

/// Returns the attribute called `name` of the part or, if the part has none, of the file.
fn attribute<'a>(header: &'a Header, name: &str) -> Option<&'a AttributeValue> {
    let name = Text::new_or_none(name)?;
    header.own_attributes.other.get(&name).or_else(|| header.shared_attributes.other.get(&name))
}

/// Returns the part of the sphere that the attribute [`COVERS`] states.
fn covers(header: &Header) -> Result<Option<Covers>, Refusal> {
    let Some(value) = attribute(header, COVERS) else { return Ok(None) };
    let covers = match value {
        AttributeValue::Text(text) => Covers::from_name(&text.to_string()),
        _ => None,
    };
    let refused = || Refusal::new(format!("{COVERS} = {value:?}"), "sphere or hemisphere");
    covers.map(Some).ok_or_else(refused)
}
