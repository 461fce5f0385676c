//! Checks that JPEG files are complete.

/// Entropy-coded bits that no decoder reads as blocks, since no Huffman code consists of one-bits alone. If they are missing, decoders assume
/// zero-bits before a marker and fill the rest of the picture.
pub(crate) const SEAL: [u8; 32] = {
    let mut bits = [0xff; 32];
    let mut at = 1;
    while at < bits.len() {
        bits[at] = 0;
        at += 2;
    }
    bits
};

/// Returns true if a JPEG file has its end marker after the first scan.
pub(crate) fn is_whole(bytes: &[u8]) -> bool {
    end(bytes).is_some()
}

/// Returns false if a block of a JPEG file cannot be decoded, or the file is not [whole](is_whole). Unsupported kinds of JPEG count as sound.
pub(super) fn is_sound(bytes: &[u8]) -> bool {
    let Some(end) = end(bytes) else { return false };
    let sealed = [&bytes[..end], &SEAL, &[0xff, 0xd9]].concat();
    let mut decoder = jpeg_decoder::Decoder::new(&sealed[..]);
    let decoded = decoder.read_info().and_then(|()| {
        let (width, height) = decoder.info().map_or((1, 1), |info| (info.width, info.height));
        // The smallest scale suffices: the codes must be read, but the pixels are not used.
        decoder.scale(width.div_ceil(8), height.div_ceil(8))?;
        decoder.decode()
    });
    matches!(decoded, Ok(_) | Err(jpeg_decoder::Error::Unsupported(_)))
}

/// Returns the position of the end marker after the first scan of a JPEG file. Segments such as EXIF, whose thumbnails contain end markers,
/// are skipped by their length.
fn end(bytes: &[u8]) -> Option<usize> {
    let mut at = 2;
    let mut in_scan = false;
    while let Some(found) = bytes.get(at..).and_then(|rest| rest.iter().position(|b| *b == 0xff)) {
        at += found + 1;
        match bytes.get(at) {
            // Stuffing, fill bytes and restart markers are skipped.
            Some(0x00 | 0xff | 0x01 | 0xd0..=0xd8) => {}
            Some(0xd9) => return in_scan.then_some(at - 1),
            Some(marker) => {
                in_scan |= *marker == 0xda;
                let [high, low] = bytes.get(at + 1..at + 3)?.first_chunk()?;
                at += 1 + usize::from(u16::from_be_bytes([*high, *low]));
            }
            None => return None,
        }
    }
    None
}
