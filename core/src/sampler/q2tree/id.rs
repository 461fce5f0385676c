//! The ids of lights: functions of order and index of their quads.

use crate::healpix::Order;
use core::ops::Range;

/// Returns the id of the light of a quad, unique over all orders: 4 * 4^order + ipix.
pub(super) fn id_of(order: u8, ipix: u32) -> u32 {
    (4 << (2 * order)) + ipix
}

/// Returns the order of the quad with `id`: ipix is below 12 * 4^order, so the highest set bit of the id is bit 2 order + 2 or 2 order + 3.
pub(super) fn order_of(id: u32) -> u8 {
    (id.max(4).ilog2() / 2 - 1) as u8
}

/// Returns the index of the quad with `id` within its order.
pub(super) fn ipix_of(id: u32) -> u32 {
    id.wrapping_sub(4 << (2 * order_of(id)))
}

/// Returns a pseudo-random point of the unit square that is a function of `id`, within `spread` / 2 of the centre along each axis.
pub(super) fn jitter(id: u32, spread: f64) -> [f64; 2] {
    // The finaliser of MurmurHash3 distributes neighbouring ids over all 32 bits.
    let mut h = id;
    h = (h ^ (h >> 16)).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    h ^= h >> 16;
    [h & 0xffff, h >> 16].map(|v| 0.5 + spread * ((f64::from(v) + 0.5) / 65536.0 - 0.5))
}

/// Returns the range of quads of [`Order::MAX`] that the quad `id` contains.
pub(super) fn range(id: u32) -> Range<u64> {
    let ipix = u64::from(ipix_of(id));
    let shift = 2 * u32::from(Order::MAX.get().saturating_sub(order_of(id)));
    ipix << shift..(ipix + 1) << shift
}
