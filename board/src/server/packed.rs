//! Gzip compression of files of the page, and of streams whose parts are compressed once for all clients.

use flate2::read::GzDecoder;
use flate2::{Compress, Compression, FlushCompress};
use std::io::Read;

/// The gzip header of a stream, without file name, time and operating system of the origin.
pub(super) const STREAM_HEAD: [u8; 10] = [0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 255];

/// Returns `bytes` as a part of a gzip stream: deflate blocks without references to earlier parts, which end on a byte. Parts can therefore be
/// concatenated in any order.
pub(super) fn part(bytes: &[u8]) -> Vec<u8> {
    deflate(bytes, Compression::fast(), FlushCompress::Sync)
}

/// Returns `bytes` as a gzip file.
pub(super) fn file(bytes: &[u8]) -> Vec<u8> {
    let mut sum = flate2::Crc::new();
    sum.update(bytes);
    let mut file = STREAM_HEAD.to_vec();
    file.extend(deflate(bytes, Compression::best(), FlushCompress::Finish));
    file.extend(sum.sum().to_le_bytes());
    file.extend(sum.amount().to_le_bytes());
    file
}

/// Returns the text of a gzip file that is compiled into the program.
pub(super) fn text(file: &[u8]) -> String {
    let mut text = String::new();
    // A file of the program cannot be damaged.
    let _ = GzDecoder::new(file).read_to_string(&mut text);
    text
}

fn deflate(bytes: &[u8], level: Compression, flush: FlushCompress) -> Vec<u8> {
    let mut state = Compress::new(level, false);
    let mut out = Vec::with_capacity(bytes.len() / 2 + 64);
    loop {
        let done = usize::try_from(state.total_in()).unwrap_or(usize::MAX).min(bytes.len());
        // Compression to memory cannot fail.
        let written = state.compress_vec(&bytes[done..], &mut out, flush);
        let is_whole = state.total_in() == bytes.len() as u64 && out.len() < out.capacity();
        if written.is_err() || is_whole {
            return out;
        }
        out.reserve(out.len().max(64));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::read::DeflateDecoder;

    #[test]
    fn a_file_is_read_back_by_any_gzip_reader() {
        for bytes in
            [vec![], b"a".to_vec(), (0..200_000u32).map(|i| (i.wrapping_mul(i) >> 7) as u8).collect()]
        {
            let mut read = Vec::new();
            GzDecoder::new(&file(&bytes)[..]).read_to_end(&mut read).expect("gzip with its sum");
            assert_eq!(read, bytes);
        }
    }

    #[test]
    fn parts_decode_in_any_order_without_waiting_for_later_parts() {
        let texts: Vec<_> = (0..3).map(|i| format!("data: {i} {}\n\n", "0.125,".repeat(4000 * i))).collect();
        let parts: Vec<_> = texts.iter().map(|t| part(t.as_bytes())).collect();
        assert!(parts[2].len() < texts[2].len() / 20, "{} bytes", parts[2].len());
        for order in [[0, 1, 2], [2, 1, 0], [1, 1, 2]] {
            let stream: Vec<u8> = order.iter().flat_map(|i| parts[*i].clone()).collect();
            let expected: String = order.iter().map(|i| texts[*i].as_str()).collect();
            let mut read = vec![0; expected.len()];
            DeflateDecoder::new(&stream[..]).read_exact(&mut read).expect("all of it, without an end");
            assert_eq!(String::from_utf8(read).expect("text"), expected);
        }
    }
}
