//! The kinds of faults, and the fraction of bursts that each kind damages.

use std::time::Duration;

/// A kind of fault of a burst or of a source.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// One frame of the burst is missing.
    Drop,
    /// The burst is delivered after a pause.
    Late,
    /// The rows of a frame below a random row are those of another exposure.
    Torn,
    /// All samples of a frame are 0.
    Black,
    /// All samples of a frame have the largest code.
    Saturated,
    /// The pixels of two frames are exchanged.
    Swapped,
    /// The stated exposure of a frame is four times the true one.
    Label,
    /// A frame has half of its samples.
    Size,
    /// The times of the burst are up to a minute too early.
    Clock,
    /// The source reports that its device is gone, and returns after a pause.
    Vanish,
    /// The call of [`Source::next`](crate::source::Source::next) does not return for seconds.
    Hang,
}

impl Fault {
    /// All kinds of faults that can be injected.
    pub const ALL: [Self; 11] = [
        Self::Drop,
        Self::Late,
        Self::Torn,
        Self::Black,
        Self::Saturated,
        Self::Swapped,
        Self::Label,
        Self::Size,
        Self::Clock,
        Self::Vanish,
        Self::Hang,
    ];

    /// Returns the name of the kind in [`FaultSpec`].
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Drop => "drop",
            Self::Late => "late",
            Self::Torn => "torn",
            Self::Black => "black",
            Self::Saturated => "saturated",
            Self::Swapped => "swapped",
            Self::Label => "label",
            Self::Size => "size",
            Self::Clock => "clock",
            Self::Vanish => "vanish",
            Self::Hang => "hang",
        }
    }
}

/// The fraction of bursts that each kind of fault damages, and the lengths of the pauses. A burst has at most one fault.
#[derive(Clone, Debug, PartialEq)]
pub struct FaultSpec {
    /// Fraction of bursts with each kind of fault, 0 to 1, in the order of [`Fault::ALL`]; the sum is at most 1.
    pub shares: [f64; Fault::ALL.len()],
    /// Seed of the random schedule of the faults.
    pub seed: u64,
    /// Number of bursts at the start that have no fault.
    pub sound: u64,
    /// Length of the pause before a burst that [`Fault::Late`] delays.
    pub late: Duration,
    /// Time for which the device is missing in [`Fault::Vanish`].
    pub gone: Duration,
    /// Duration of the call of [`Fault::Hang`].
    pub hang: Duration,
}

impl FaultSpec {
    /// A specification without faults, with the default pauses.
    pub const NONE: Self = Self {
        shares: [0.0; Fault::ALL.len()],
        seed: 1,
        sound: 0,
        late: Duration::from_millis(80),
        gone: Duration::from_secs(1),
        hang: Duration::from_secs(3),
    };

    /// Returns the fault of a burst that the random number `part`, 0 to 1, selects; `None` for a burst without a fault.
    #[must_use]
    pub fn choose(&self, part: f64) -> Option<Fault> {
        let mut sum = 0.0;
        Fault::ALL.into_iter().zip(self.shares).find_map(|(fault, share)| {
            sum += share;
            (part < sum).then_some(fault)
        })
    }

    fn set(&mut self, key: &str, value: &str) -> Option<()> {
        let share = || value.parse::<f64>().ok().filter(|v| (0.0..=1.0).contains(v));
        let pause = || value.parse::<f64>().ok().filter(|v| (0.0..=60.0).contains(v));
        match key {
            "all" => self.shares = [share()?; Fault::ALL.len()],
            "seed" => self.seed = value.parse().ok()?,
            "sound" => self.sound = value.parse().ok()?,
            "late_s" => self.late = Duration::from_secs_f64(pause()?),
            "gone_s" => self.gone = Duration::from_secs_f64(pause()?),
            "hang_s" => self.hang = Duration::from_secs_f64(pause()?),
            name => self.shares[Fault::ALL.iter().position(|fault| fault.name() == name)?] = share()?,
        }
        Some(())
    }
}

/// Parses text such as `all=0.01,hang=0,seed=7`: fractions of bursts by kind of fault; later fractions override earlier ones.
impl std::str::FromStr for FaultSpec {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut spec = Self::NONE;
        for pair in text.split(',') {
            let (key, value) = pair.split_once('=').unwrap_or((pair, ""));
            spec.set(key.trim(), value.trim()).ok_or_else(|| {
                format!(
                    "found '{pair}', expected KIND=SHARE with all, {} and a share of bursts from 0 to 1, or seed=N, sound=BURSTS, \
                     late_s=S, gone_s=S, hang_s=S",
                    Fault::ALL.map(Fault::name).join(", ")
                )
            })?;
        }
        let sum: f64 = spec.shares.iter().sum();
        if sum > 1.0 + 1e-9 {
            return Err(format!("found shares with a sum of {sum}, expected at most 1"));
        }
        Ok(spec)
    }
}
