//! The structure of JPEG files, as far as it tells whether one is whole.

/// Whether a JPEG file has its end marker after the first scan; segments such as EXIF, whose thumbnails have end markers of their
/// own, are passed over by their length.
pub(crate) fn is_whole(bytes: &[u8]) -> bool {
    let mut at = 2;
    let mut in_scan = false;
    while let Some(found) = bytes.get(at..).and_then(|rest| rest.iter().position(|b| *b == 0xff)) {
        at += found + 1;
        match bytes.get(at) {
            // Stuffing, fill bytes and restart markers.
            Some(0x00 | 0xff | 0x01 | 0xd0..=0xd8) => {}
            Some(0xd9) => return in_scan,
            Some(marker) => {
                in_scan |= *marker == 0xda;
                let Some([high, low]) = bytes.get(at + 1..at + 3).and_then(|b| b.first_chunk()) else {
                    return false;
                };
                at += 1 + usize::from(u16::from_be_bytes([*high, *low]));
            }
            None => return false,
        }
    }
    false
}
