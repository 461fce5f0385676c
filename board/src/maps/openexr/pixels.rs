//! Decompression of the blocks of one part of an OpenEXR file into a window.

use super::super::{Raster, Refusal};
use super::layers::Layer;
use super::{EXPECTED, dwa};
use exr::block::UncompressedBlock;
use exr::block::reader::{ChunksReader, Reader};
use exr::meta::attribute::{IntegerBounds, SampleType};
use exr::meta::header::Header;
use exr::prelude::f16;
use std::collections::HashSet;
use std::io::{BufRead, Seek};

/// Decodes the full-resolution blocks of the part with the layer; texels outside of `window` are dropped.
pub(super) fn decode(
    reader: Reader<impl BufRead + Seek>,
    header: &Header,
    layer: &Layer,
    window: IntegerBounds,
    raster: &mut Raster,
) -> Result<(), Refusal> {
    let refused = |e: exr::error::Error| Refusal::new(e, EXPECTED);
    let wanted = |index: exr::block::BlockIndex| {
        index.layer == layer.part && index.level.x() == 0 && index.level.y() == 0
    };
    let mut chunks = reader.filter_chunks(false, |_, _, index| wanted(index)).map_err(refused)?;
    let place = WindowOffset {
        x: i64::from(header.own_attributes.layer_position.x()) - i64::from(window.position.x()),
        y: i64::from(header.own_attributes.layer_position.y()) - i64::from(window.position.y()),
    };
    let (mut places, mut pixels) = (HashSet::new(), 0);
    while let Some(chunk) = chunks.next() {
        let chunk = chunk.map_err(refused)?;
        if let Some(part) = chunks.meta_data().headers.get(chunk.layer_index) {
            dwa::check(&chunk, part)?;
        }
        let block = UncompressedBlock::decompress_chunk(chunk, chunks.meta_data(), false).map_err(refused)?;
        if !wanted(block.index) {
            continue;
        }
        let at = block.index.pixel_position;
        if !places.insert((at.x(), at.y())) {
            return Err(Refusal::new(format!("two blocks at column {}, row {}", at.x(), at.y()), EXPECTED));
        }
        pixels += block.index.pixel_size.area();
        place.block(&block, header, layer, raster)?;
    }
    let all = header.layer_size.area();
    if pixels == all {
        return Ok(());
    }
    Err(Refusal::new(format!("blocks of {pixels} of {all} pixels"), "an OpenEXR file with all its blocks"))
}

/// Position of the data window inside of the raster.
struct WindowOffset {
    x: i64,
    y: i64,
}

impl WindowOffset {
    fn block(
        &self,
        block: &UncompressedBlock,
        header: &Header,
        layer: &Layer,
        raster: &mut Raster,
    ) -> Result<(), Refusal> {
        let channels = &header.channels.list;
        let sizes: Vec<usize> = channels.iter().map(|c| c.sample_type.bytes_per_sample()).collect();
        let columns = block.index.pixel_size.x();
        let line: usize = sizes.iter().map(|s| s * columns).sum();
        for (i, bytes) in block.data.chunks_exact(line.max(1)).take(block.index.pixel_size.y()).enumerate() {
            let y = self.y + (block.index.pixel_position.y() + i) as i64;
            let Some(y) = usize::try_from(y).ok().filter(|y| *y < raster.height) else { continue };
            let left = self.x + block.index.pixel_position.x() as i64;
            let row = raster.row_mut(y);
            for (k, channel) in layer.channels.into_iter().enumerate() {
                let start: usize = sizes[..channel].iter().map(|s| s * columns).sum();
                let samples = bytes.get(start..start + sizes[channel] * columns);
                let samples = samples.ok_or_else(|| Refusal::new("a block that is too short", EXPECTED))?;
                samples_into(samples, channels[channel].sample_type, left, row, k);
            }
        }
        Ok(())
    }
}

/// Stores samples in component `k` of the texels of a row, from column `left` on; samples outside of the row are dropped.
fn samples_into(bytes: &[u8], kind: SampleType, left: i64, row: &mut [[f32; 3]], k: usize) {
    let skipped = usize::try_from(-left).unwrap_or(0);
    let first = usize::try_from(left).unwrap_or(0);
    let targets = row.iter_mut().skip(first).map(|texel| &mut texel[k]);
    match kind {
        SampleType::F16 => {
            let values =
                bytes.as_chunks::<2>().0.iter().skip(skipped).map(|b| f16::from_ne_bytes(*b).to_f32());
            targets.zip(values).for_each(|(t, v)| *t = v);
        }
        SampleType::F32 => {
            let values = bytes.as_chunks::<4>().0.iter().skip(skipped).map(|b| f32::from_ne_bytes(*b));
            targets.zip(values).for_each(|(t, v)| *t = v);
        }
        SampleType::U32 => {
            let values = bytes.as_chunks::<4>().0.iter().skip(skipped).map(|b| u32::from_ne_bytes(*b) as f32);
            targets.zip(values).for_each(|(t, v)| *t = v);
        }
    }
}
