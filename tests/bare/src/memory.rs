//! All the memory there is: one static, so that the linker refuses a program that needs more.

use core::mem::size_of;
use hemilux_core::Order;
use hemilux_core::healpix::Domain;
use hemilux_core::light::Light;
use hemilux_core::internals::merge::Reciprocal;
use hemilux_core::internals::plan::{Run, Span, Texel};
use hemilux_core::pyramid::{Quad, pyramid_len};
use hemilux_core::{Depth};
use hemilux_core::internals::response::{curve_len};
use hemilux_core::sampler::q2tree::{Leaf, Past, interior_len};
use static_cell::ConstStaticCell;

use crate::scene::EXPOSURES;

/// Columns and rows of an image.
pub const SIDE: u32 = 96;

/// Order of the map: 1,024 texels above the horizon, 3.7 degrees wide.
pub const ORDER: u8 = 4;

/// Most lights.
pub const LIGHTS: usize = 256;

/// Pixels inside the lens circle, and runs of them that share a texel: what `plan_size` says of the scene's lens.
const WEIGHTS: usize = RUNS;
const RUNS: usize = 3900;

const FRAME: usize = 3 * (SIDE * SIDE) as usize;
const TEXELS: usize = Domain::Hemisphere.quads(ORDER);
const QUADS: usize = pyramid_len(Domain::Hemisphere, Order::saturating(ORDER));
const BITS: usize = interior_len(Domain::Hemisphere, Order::saturating(ORDER));

/// Memory of fixed size, of zeros until [`Memory::fill`].
type Room<T, const N: usize> = heapless::Vec<T, N>;

/// Frames, plan, map, tree and lights.
pub struct Memory {
    pub(crate) frames: [[u8; FRAME]; EXPOSURES.len()],
    pub(crate) curve: [i32; curve_len(Depth::U8)],
    pub(crate) tables: [u32; 0],
    pub(crate) reciprocals: Room<Reciprocal, { 1 << EXPOSURES.len() }>,
    pub(crate) spans: Room<Span, { SIDE as usize }>,
    pub(crate) weights: [u16; WEIGHTS],
    pub(crate) runs: Room<Run, RUNS>,
    pub(crate) texels: Room<Texel, TEXELS>,
    pub(crate) quads: Room<Quad, QUADS>,
    pub(crate) bits: [[u8; BITS]; 2],
    pub(crate) heap: Room<Leaf, LIGHTS>,
    pub(crate) lights: Room<Light, LIGHTS>,
    pub(crate) past: Room<Past, LIGHTS>,
}

/// The one there is.
pub static MEMORY: ConstStaticCell<Memory> = ConstStaticCell::new(Memory::EMPTY);

impl Memory {
    const EMPTY: Self = Self {
        frames: [[0; FRAME]; _],
        curve: [0; _],
        tables: [],
        reciprocals: Room::new(),
        spans: Room::new(),
        weights: [0; _],
        runs: Room::new(),
        texels: Room::new(),
        quads: Room::new(),
        bits: [[0; BITS]; 2],
        heap: Room::new(),
        lights: Room::new(),
        past: Room::new(),
    };

    /// Its bytes, buffer by buffer.
    pub const PARTS: [(&str, usize); 6] = [
        ("frames", size_of::<[[u8; FRAME]; EXPOSURES.len()]>()),
        ("response", size_of::<[i32; curve_len(Depth::U8)]>()),
        ("plan", SIDE as usize * size_of::<Span>() + 2 * WEIGHTS + RUNS * size_of::<Run>()),
        ("texels", TEXELS * size_of::<Texel>()),
        ("pyramid", QUADS * size_of::<Quad>()),
        ("lights", LIGHTS * (size_of::<Light>() + size_of::<Past>() + size_of::<Leaf>()) + 2 * BITS),
    ];

    /// Gives every buffer its full length.
    pub fn fill(&mut self) {
        fill(&mut self.reciprocals);
        fill(&mut self.spans);
        fill(&mut self.runs);
        fill(&mut self.texels);
        fill(&mut self.quads);
        fill(&mut self.heap);
        fill(&mut self.lights);
        fill(&mut self.past);
    }
}

fn fill<T: Clone + Default, const N: usize>(room: &mut Room<T, N>) {
    while room.push(T::default()).is_ok() {}
}
