//! All the memory there is: one static, so that the linker refuses a program that needs more.

use core::mem::size_of;
use hemilux_core::sampler::q2tree::{Leaf, Past, interior_len};
use hemilux_core::{Domain, Light, Order};
use static_cell::ConstStaticCell;

use crate::scene::EXPOSURES;

/// Columns and rows of an image.
pub const SIDE: u32 = 96;

/// Order of the map: 1,024 texels above the horizon, 3.7 degrees wide.
pub const ORDER: u8 = 4;

/// Most lights.
pub const LIGHTS: usize = 256;

/// Words of the front end: what `Sizes` says of the scene's camera.
const WORDS: usize = 18_398;

const FRAME: usize = 3 * (SIDE * SIDE) as usize;
const BITS: usize = interior_len(Domain::Hemisphere, Order::saturating(ORDER));

/// Memory of fixed size, of zeros until [`Memory::fill`].
type FixedVec<T, const N: usize> = heapless::Vec<T, N>;

/// Frames, map, tree and lights.
pub struct Memory {
    pub(crate) frames: [[u8; FRAME]; EXPOSURES.len()],
    pub(crate) map: [u64; WORDS],
    pub(crate) bits: [[u8; BITS]; 2],
    pub(crate) heap: FixedVec<Leaf, LIGHTS>,
    pub(crate) lights: FixedVec<Light, LIGHTS>,
    pub(crate) past: FixedVec<Past, LIGHTS>,
}

/// The one there is.
pub static MEMORY: ConstStaticCell<Memory> = ConstStaticCell::new(Memory::EMPTY);

impl Memory {
    const EMPTY: Self = Self {
        frames: [[0; FRAME]; _],
        map: [0; _],
        bits: [[0; BITS]; 2],
        heap: FixedVec::new(),
        lights: FixedVec::new(),
        past: FixedVec::new(),
    };

    /// Its bytes, buffer by buffer.
    pub const PARTS: [(&str, usize); 3] = [
        ("frames", size_of::<[[u8; FRAME]; EXPOSURES.len()]>()),
        ("front end", size_of::<[u64; WORDS]>()),
        ("lights", LIGHTS * (size_of::<Light>() + size_of::<Past>() + size_of::<Leaf>()) + 2 * BITS),
    ];

    /// Gives every buffer its full length.
    pub fn fill(&mut self) {
        fill(&mut self.heap);
        fill(&mut self.lights);
        fill(&mut self.past);
    }
}

fn fill<T: Clone + Default, const N: usize>(buffer: &mut FixedVec<T, N>) {
    while buffer.push(T::default()).is_ok() {}
}
