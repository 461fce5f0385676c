//! Radiance HDR pictures (`.hdr`, `.pic`): RGBE and XYZE.
//!
//! The decoder of the `image` crate is not used: it ignores EXPOSURE, COLORCORR, PRIMARIES, VIEW and the axis order, and refuses `#?RGBE` and
//! XYZE.

mod header;
mod scanlines;

use super::limit::Budget;
use super::primaries::{self, Primaries};
use super::{DecodedFile, Raster, ReadOptions, Refusal, Stated};
use header::Header;
use std::io::BufRead;

pub(super) fn is(begin: &[u8]) -> bool {
    begin.starts_with(b"#?")
}

pub(super) fn read(
    mut reader: impl BufRead,
    budget: &Budget,
    options: &ReadOptions,
) -> Result<DecodedFile, Refusal> {
    let header = header::read(&mut reader)?;
    if let (Some(view), None) = (&header.view, options.projection) {
        let expected =
            "a latitude-longitude map (--projection latlong or angular reads the picture nevertheless)";
        return Err(Refusal::new(format!("VIEW={view}"), expected));
    }
    let mut raster = header.resolution.decode(&mut reader, budget)?;
    let mut stated = Stated { covers: header.covers, ..Stated::default() };
    convert(&header, &mut raster, &mut stated)?;
    Ok(DecodedFile { raster, stated })
}

/// Applies the EXPOSURE, COLORCORR, FORMAT and PRIMARIES lines of the header to the texels.
fn convert(header: &Header, raster: &mut Raster, stated: &mut Stated) -> Result<(), Refusal> {
    let factors = header.factors();
    if factors != [1.0; 3] {
        raster.texels.iter_mut().flatten().zip(factors.iter().cycle()).for_each(|(v, f)| *v *= f);
    }
    let primaries = match (header.is_xyz, header.primaries) {
        (true, _) => Some(primaries::XYZ),
        (false, stated) => stated.map(Primaries),
    };
    if let Some(primaries) = primaries.filter(|p| !p.are_rec_709()) {
        primaries::convert(&mut raster.texels, &primaries.to_rec_709()?);
        let from = if header.is_xyz { "CIE XYZ" } else { "the primaries of the header" };
        stated.notes.push(format!("converted from {from} to Rec. 709 without adaptation of white"));
    }
    Ok(())
}
