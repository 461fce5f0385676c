//! The memory of the program in one static, so that the linker refuses a program that needs more than the RAM.

use core::mem::size_of;
use hemilux_core::sampler::q2tree::{Leaf, Past, interior_len};
use hemilux_core::{Domain, Light, Order};
use static_cell::ConstStaticCell;

use crate::scene::EXPOSURES;

/// Number of columns, and of rows, of an image of the scene.
pub const SIDE: u32 = 96;

/// HEALPix order of the map: 1,024 texels above the horizon, 3.7 degrees wide.
pub const ORDER: u8 = 4;

/// Largest number of lights of the sampler.
pub const LIGHTS: usize = 256;

/// Number of 64-bit words of the front end, as `Sizes` computes it for the scene's camera.
const WORDS: usize = 18_398;

const FRAME: usize = 3 * (SIDE * SIDE) as usize;
const BITS: usize = interior_len(Domain::Hemisphere, Order::saturating(ORDER));

/// A vector of fixed capacity, whose memory is zero until [`Memory::fill`].
type FixedVec<T, const N: usize> = heapless::Vec<T, N>;

/// Frames, map, tree and lights of the program.
pub struct Memory {
    pub(crate) frames: [[u8; FRAME]; EXPOSURES.len()],
    pub(crate) map: [u64; WORDS],
    pub(crate) bits: [[u8; BITS]; 2],
    pub(crate) heap: FixedVec<Leaf, LIGHTS>,
    pub(crate) lights: FixedVec<Light, LIGHTS>,
    pub(crate) past: FixedVec<Past, LIGHTS>,
}

/// The single instance of [`Memory`].
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

    /// Name and number of bytes of each group of buffers.
    pub const PARTS: [(&str, usize); 3] = [
        ("frames", size_of::<[[u8; FRAME]; EXPOSURES.len()]>()),
        ("front end", size_of::<[u64; WORDS]>()),
        ("lights", LIGHTS * (size_of::<Light>() + size_of::<Past>() + size_of::<Leaf>()) + 2 * BITS),
    ];

    /// Extends every vector to its capacity.
    pub fn fill(&mut self) {
        fill(&mut self.heap);
        fill(&mut self.lights);
        fill(&mut self.past);
    }
}

fn fill<T: Clone + Default, const N: usize>(buffer: &mut FixedVec<T, N>) {
    while buffer.push(T::default()).is_ok() {}
}
