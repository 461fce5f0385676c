//! The core alone: with the feature `strict`, the image does not link if it contains a reachable panic. The image can also be run, without
//! a log: the exit status is 0 if the lights pass the checks.
#![no_std]
#![no_main]

use core::convert::Infallible;
use hemilux_bare::{MEMORY, start};

#[cfg_attr(target_abi = "eabihf", cortex_m_rt::entry)]
#[cfg_attr(not(target_abi = "eabihf"), unsafe(no_mangle))]
fn main() -> ! {
    let lights = MEMORY.try_take().and_then(|memory| {
        memory.fill();
        hemilux_bare::run(memory, start::clock, &mut Sink(0)).ok()
    });
    let right = lights.is_some_and(|report| report.check().is_ok());
    semihosting::process::exit(i32::from(!right))
}

/// A writer that discards its bytes.
struct Sink(u32);

impl embedded_io::ErrorType for Sink {
    type Error = Infallible;
}

impl embedded_io::Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        self.0 = core::hint::black_box(bytes.iter().fold(self.0, |sum, b| sum.wrapping_add(u32::from(*b))));
        Ok(bytes.len())
    }

    fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    #[cfg(feature = "strict")]
    {
        unsafe extern "C" {
            fn a_panic_can_be_reached() -> !;
        }
        // SAFETY: the function does not exist, so that no image with this call links.
        unsafe { a_panic_can_be_reached() }
    }
    #[cfg(not(feature = "strict"))]
    semihosting::process::exit(101)
}
