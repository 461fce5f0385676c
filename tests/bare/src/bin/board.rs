//! Runs on an emulated board: renders the burst, computes the lights, writes them to `lights.json` through semihosting, and checks them.
//! The defmt log is on standard output; the exit status is 0 only if every check passes.
#![no_std]
#![no_main]

use defmt_semihosting as _;
use hemilux_bare::{MEMORY, Memory, Wrong, start};
use semihosting::fs::File;
use semihosting::process;

/// Number of bytes per write to the host.
const CHUNK: usize = 320;

#[cfg_attr(target_abi = "eabihf", cortex_m_rt::entry)]
#[cfg_attr(not(target_abi = "eabihf"), unsafe(no_mangle))]
fn main() -> ! {
    start::paint();
    let status = match run() {
        Ok(()) => 0,
        Err(wrong) => {
            defmt::error!("{}", wrong);
            1
        }
    };
    process::exit(status)
}

fn run() -> Result<(), Wrong> {
    let memory = MEMORY.try_take().ok_or(Wrong::Output)?;
    memory.fill();
    defmt::info!("{=str}: {=usize} bytes of buffers", start::NAME, size_of::<Memory>());
    for (name, bytes) in Memory::PARTS {
        defmt::info!("  {=str}: {=usize}", name, bytes);
    }
    let file = File::create(c"lights.json").map_err(|_| Wrong::Output)?;
    let mut json = Json { file, chunk: [0; CHUNK], len: 0, all: 0 };
    let report = hemilux_bare::run(memory, start::clock, &mut json)?;
    embedded_io::Write::flush(&mut json).map_err(|_| Wrong::Output)?;
    let (used, room) = start::depth();
    defmt::info!("{}", report.sizes);
    defmt::info!(
        "frames {=u32:#x}; {=usize} lights in {=usize} bytes of JSON",
        report.taken.hash,
        report.lights,
        json.all
    );
    defmt::info!("energy: scene {}, map {}, lights {}", report.taken.energy, report.map, report.energy);
    defmt::info!("brightest light {=f32} degrees from the lamp", report.lamp_deg);
    let [front, pyramid, sample, encode] =
        core::array::from_fn(|i| start::instructions(report.ticks[i], report.ticks[i + 1]));
    defmt::info!(
        "instructions: front {=u32} pyramid {=u32} sample {=u32} encode {=u32}",
        front,
        pyramid,
        sample,
        encode
    );
    defmt::info!("stack: {=usize} of {=usize} bytes", used, room);
    if used + SPARE > room {
        return Err(Wrong::Check("stack, bytes", used as f32, (room - SPARE) as f32));
    }
    report.check()?;
    defmt::info!("passed");
    Ok(())
}

/// Least number of bytes of the stack that the program must leave unused.
const SPARE: usize = 1024;

/// A writer that collects bytes and sends them to the host in chunks.
struct Json {
    file: File,
    chunk: [u8; CHUNK],
    len: usize,
    all: usize,
}

impl embedded_io::ErrorType for Json {
    type Error = embedded_io::ErrorKind;
}

impl embedded_io::Write for Json {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Self::Error> {
        if self.len == CHUNK {
            self.flush()?;
        }
        let room = &mut self.chunk[self.len..];
        let n = bytes.len().min(room.len());
        room[..n].copy_from_slice(&bytes[..n]);
        self.len += n;
        self.all += n;
        Ok(n)
    }

    fn flush(&mut self) -> Result<(), Self::Error> {
        use semihosting::io::Write as _;
        self.file.write_all(&self.chunk[..self.len]).map_err(|_| embedded_io::ErrorKind::Other)?;
        self.len = 0;
        Ok(())
    }
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    defmt::error!("{}", defmt::Display2Format(info));
    process::exit(101)
}
