//! The tests of the simulator: one program, because each further program takes as long to build as most of the tests take to run.

mod boards;
mod command_line;
mod common;
mod compressed;
mod counts;
mod export;
mod false_frames;
mod files;
mod formats;
mod hostile;
mod judge;
mod mains;
mod office;
mod reads;
mod replay;
mod round_trip;
mod soak;
mod soft;
mod still_maps;
mod whole_view;
mod window;
