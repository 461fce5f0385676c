//! Memory that the caller lends: a `Vec` on a host, an array or a static slice on bare metal.

/// A fixed-capacity buffer of `T`, owned or borrowed.
pub trait Buffer<T>: AsRef<[T]> + AsMut<[T]> {}

impl<T, B: AsRef<[T]> + AsMut<[T]> + ?Sized> Buffer<T> for B {}

/// A lent buffer is too short.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TooSmall {
    /// Elements that are needed.
    pub needed: usize,
    /// Elements that were lent.
    pub lent: usize,
}

impl core::fmt::Display for TooSmall {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "a buffer of {} elements was lent, {} are needed", self.lent, self.needed)
    }
}

impl core::error::Error for TooSmall {}

/// Refuses a buffer with fewer than `needed` elements.
///
/// # Errors
/// [`TooSmall`] with both numbers.
pub fn check<T>(buffer: &impl AsRef<[T]>, needed: usize) -> Result<(), TooSmall> {
    let lent = buffer.as_ref().len();
    if lent < needed { Err(TooSmall { needed, lent }) } else { Ok(()) }
}
