//! Fuzz target: lens files of hemilux and of other programs.

#![no_main]

use hemilux::recorded::parse_lens;
use libfuzzer_sys::fuzz_target;
use std::path::Path;

fuzz_target!(|text: &str| {
    if let Ok(file) = parse_lens(Path::new("lens"), text) {
        assert!(file.size.iter().all(|side| *side > 0), "an image without pixels");
    }
});
