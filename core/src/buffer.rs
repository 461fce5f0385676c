//! Lent memory: a `Vec` on a host, an array or a static slice on bare metal.

/// A buffer of `T` with a fixed length, owned or borrowed. Implemented for everything that is `AsRef<[T]>` and `AsMut<[T]>`.
pub trait Buffer<T>: AsRef<[T]> + AsMut<[T]> {}

impl<T, B: AsRef<[T]> + AsMut<[T]> + ?Sized> Buffer<T> for B {}

/// The error of a lent buffer that has too few elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TooSmall {
    /// Number of elements that the buffer must have.
    pub needed: usize,
    /// Number of elements of the lent buffer.
    pub lent: usize,
}

impl core::fmt::Display for TooSmall {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "a buffer of {} elements was lent, {} are needed", self.lent, self.needed)
    }
}

impl core::error::Error for TooSmall {}

/// Checks that `buffer` has at least `needed` elements.
///
/// # Errors
/// [`TooSmall`] with the needed and the lent number of elements, if `buffer` has fewer than `needed`.
pub(crate) fn check<T>(buffer: &impl AsRef<[T]>, needed: usize) -> Result<(), TooSmall> {
    let lent = buffer.as_ref().len();
    if lent < needed { Err(TooSmall { needed, lent }) } else { Ok(()) }
}
