//! The functions that are compared, and their implementations.

use micromath::F32Ext;
use std::f64::consts::PI;

/// Names of the implementations.
pub const WAYS: [&str; 4] = ["libm", "micromath", "table", "std"];

/// Largest number of entries of a function's table: 4 KB.
const STEPS: usize = 1024;

/// A function of one argument that the core calls, with its implementations.
pub struct Function {
    pub name: &'static str,
    /// Use of the function in the core, for the report.
    pub used: &'static str,
    /// Range of the arguments; if it is above 0, its arguments are spaced evenly within each octave.
    pub range: [f64; 2],
    /// Whether the error of the function is relative.
    pub relative: bool,
    pub exact: fn(f64) -> f64,
    pub libm: fn(f32) -> f32,
    pub micromath: fn(f32) -> f32,
    pub std: fn(f32) -> f32,
}

pub const FUNCTIONS: [Function; 10] = [
    Function {
        name: "sqrt",
        used: "importance, discs, weights",
        range: [1e-6, 4.0],
        relative: true,
        exact: f64::sqrt,
        libm: libm::sqrtf,
        micromath: |x| F32Ext::sqrt(x),
        std: f32::sqrt,
    },
    Function {
        name: "acos",
        used: "radius of a light",
        range: [-1.0, 1.0],
        relative: false,
        exact: f64::acos,
        libm: libm::acosf,
        micromath: |x| F32Ext::acos(x),
        std: f32::acos,
    },
    Function {
        name: "atan2",
        used: "steps of a track",
        range: [1e-3, 1e3],
        relative: true,
        exact: |x| x.atan2(1.0),
        libm: |x| libm::atan2f(x, 1.0),
        micromath: |x| F32Ext::atan2(x, 1.0),
        std: |x| x.atan2(1.0),
    },
    Function {
        name: "cos",
        used: "thinning, estimates",
        range: [-PI, PI],
        relative: false,
        exact: f64::cos,
        libm: libm::cosf,
        micromath: |x| F32Ext::cos(x),
        std: f32::cos,
    },
    Function {
        name: "sin",
        used: "lights that face a normal",
        range: [-PI, PI],
        relative: false,
        exact: f64::sin,
        libm: libm::sinf,
        micromath: |x| F32Ext::sin(x),
        std: f32::sin,
    },
    Function {
        name: "exp",
        used: "error of many lights",
        range: [-12.0, 1.0],
        relative: true,
        exact: f64::exp,
        libm: libm::expf,
        micromath: |x| F32Ext::exp(x),
        std: f32::exp,
    },
    Function {
        name: "ln",
        used: "error of many lights",
        range: [1e-12, 10.0],
        relative: false,
        exact: f64::ln,
        libm: libm::logf,
        micromath: |x| F32Ext::ln(x),
        std: f32::ln,
    },
    Function {
        name: "pow0.8",
        used: "tone mapping: sigmoid",
        range: [1e-4, 1e4],
        relative: true,
        exact: |x| x.powf(0.8),
        libm: |x| libm::powf(x, 0.8),
        micromath: |x| F32Ext::powf(x, 0.8),
        std: |x| x.powf(0.8),
    },
    Function {
        name: "pow1/2.4",
        used: "tone mapping: sRGB",
        range: [0.003_130_8, 1.0],
        relative: true,
        exact: |x| x.powf(1.0 / 2.4),
        libm: |x| libm::powf(x, 1.0 / 2.4),
        micromath: |x| F32Ext::powf(x, 1.0 / 2.4),
        std: |x| x.powf(1.0 / 2.4),
    },
    Function {
        name: "rint",
        used: "directions in Q14",
        range: [-16_384.0, 16_384.0],
        relative: false,
        exact: f64::round_ties_even,
        libm: libm::rintf,
        micromath: |x| F32Ext::round(x),
        std: f32::round_ties_even,
    },
];

impl Function {
    /// Returns argument `i` of `n` arguments, ascending over the function's range.
    pub fn argument(&self, i: usize, n: usize) -> f32 {
        let [low, high] = self.range;
        let part = (i as f64 + 0.5) / n as f64;
        (if low > 0.0 { low * (high / low).powf(part) } else { low + part * (high - low) }) as f32
    }

    /// Returns the table with which the implementation `table` computes the function.
    pub fn table(&self) -> Table {
        let [low, high] = self.range.map(|v| v as f32);
        if low > 0.0 {
            // The number of mantissa bits for which the entries of all octaves fit the table.
            let steps = |shift: u32| ((high.to_bits() - low.to_bits()) >> shift) as usize;
            let shift = (0..32).find(|s| steps(*s) < STEPS).unwrap_or(31);
            let base = low.to_bits() >> shift << shift;
            let at = |i: usize| f32::from_bits(base + ((i as u32) << shift));
            let values = (0..=steps(shift) + 1).map(|i| (self.exact)(f64::from(at(i))) as f32).collect();
            return Table { values, shape: Shape::Octaves { base, shift } };
        }
        let step = (f64::from(high) - f64::from(low)) / STEPS as f64;
        let values = (0..=STEPS).map(|i| (self.exact)(f64::from(low) + step * i as f64) as f32).collect();
        Table { values, shape: Shape::Even { low, per_step: (1.0 / step) as f32 } }
    }
}

/// A table of a function with linear interpolation.
pub struct Table {
    values: Vec<f32>,
    shape: Shape,
}

enum Shape {
    /// The entries are at equal steps over the range of the arguments.
    Even { low: f32, per_step: f32 },
    /// The entries are at equal steps within each octave: the bits of a float are nearly proportional to its logarithm.
    Octaves { base: u32, shift: u32 },
}

impl Table {
    pub fn at(&self, x: f32) -> f32 {
        let (index, part) = match self.shape {
            Shape::Even { low, per_step } => {
                let place = (x - low) * per_step;
                (place as usize, place - (place as u32) as f32)
            }
            Shape::Octaves { base, shift } => {
                let bits = x.to_bits().wrapping_sub(base);
                let within = bits & ((1 << shift) - 1);
                ((bits >> shift) as usize, within as f32 / (1u32 << shift) as f32)
            }
        };
        let Some([a, b]) = self.values.get(index..).and_then(|v| v.first_chunk()) else {
            return self.values.last().copied().unwrap_or(0.0);
        };
        a + (b - a) * part
    }
}
