//! Compares error and cost of the functions that the core calls per light and per pixel, by implementation: libm, micromath, a table, or
//! the standard library (a processor instruction for the square root, the C library for the other functions).
//!
//! ```text
//! math --out DIR [--counts FILE]     writes math.txt and math.svg; FILE has lines "NAME WAY INSTRUCTIONS" of tests/instructions/math.sh
//! math NAME WAY CALLS                makes CALLS calls, for instruction counters
//! ```

mod chart;
mod ways;

use chart::Row;
use std::collections::HashMap;
use std::path::Path;
use std::process::ExitCode;
use ways::{FUNCTIONS, Function, WAYS};

/// Number of arguments that are used in rotation when calls are counted.
const ARGUMENTS: usize = 1024;

/// Number of arguments at which errors are measured.
const GRID: usize = 1 << 20;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let done = match words[..] {
        ["--out", out] => report(Path::new(out), None),
        ["--out", out, "--counts", counts] => report(Path::new(out), Some(Path::new(counts))),
        [name, way, calls] => repeat(name, way, calls),
        _ => Err("found other arguments, expected --out DIR [--counts FILE] or NAME WAY CALLS".into()),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("math: {e}");
            ExitCode::FAILURE
        }
    }
}

/// Calls the function `name` `calls` times in the implementation `way`.
fn repeat(name: &str, way: &str, calls: &str) -> Result<(), String> {
    let function = FUNCTIONS.iter().find(|f| f.name == name).ok_or(format!("found function {name}"))?;
    let calls: usize =
        calls.parse().map_err(|e| format!("{calls}: found {e}, expected a number of calls"))?;
    let xs: Vec<f32> = (0..ARGUMENTS).map(|i| function.argument(i, ARGUMENTS)).collect();
    let table = function.table();
    let sum = match way {
        "none" => sum(&xs, calls, |x| x),
        "libm" => sum(&xs, calls, function.libm),
        "micromath" => sum(&xs, calls, function.micromath),
        "table" => sum(&xs, calls, |x| table.at(x)),
        "std" => sum(&xs, calls, function.std),
        _ => return Err(format!("found way {way}, expected none or one of {}", WAYS.join(", "))),
    };
    std::hint::black_box(sum);
    Ok(())
}

/// Calls `f` in rotation over `xs`; the loop is the same for all implementations, so its cost is the cost of the implementation `none`.
fn sum(xs: &[f32], calls: usize, f: impl Fn(f32) -> f32) -> f32 {
    xs.iter().cycle().take(calls).map(|x| f(std::hint::black_box(*x))).sum()
}

fn report(out: &Path, counts: Option<&Path>) -> Result<(), String> {
    let counts = counts.map(|path| {
        let text = std::fs::read_to_string(path).map_err(|e| format!("{}: found {e}", path.display()))?;
        let line = |l: &str| {
            let words: Vec<_> = l.split_whitespace().collect();
            let [name, way, n] = words[..] else { return None };
            Some(((name.to_string(), way.to_string()), n.parse::<f64>().ok()?))
        };
        Ok::<_, String>(text.lines().filter_map(line).collect::<HashMap<_, _>>())
    });
    let counts = counts.transpose()?.unwrap_or_default();
    let row = |function: &'static Function| {
        let table = function.table();
        let ways: [&dyn Fn(f32) -> f32; WAYS.len()] =
            [&function.libm, &function.micromath, &|x| table.at(x), &function.std];
        let errors = ways.map(|f| worst(function, f));
        let count = |way: &str| counts.get(&(function.name.to_string(), way.to_string())).copied();
        Row { function, errors, counts: WAYS.map(count) }
    };
    let rows: Vec<_> = FUNCTIONS.iter().map(row).collect();
    let text = chart::table(&rows);
    print!("{text}");
    let write = |name: &str, text: &str| {
        let path = out.join(name);
        std::fs::write(&path, text)
            .map_err(|e| format!("{}: found {e}, expected to write it", path.display()))
    };
    std::fs::create_dir_all(out)
        .map_err(|e| format!("--out {}: found {e}, expected a folder", out.display()))?;
    write("math.txt", &text)?;
    write("math.svg", &chart::svg(&rows))
}

/// Returns the largest error of the implementation `f` over the function's range.
fn worst(function: &Function, f: &dyn Fn(f32) -> f32) -> f64 {
    let error = |i: usize| {
        let x = function.argument(i, GRID);
        let (found, exact) = (f64::from(f(x)), (function.exact)(f64::from(x)));
        let off = (found - exact).abs();
        if function.relative && exact != 0.0 { off / exact.abs() } else { off }
    };
    (0..GRID).map(error).fold(0.0, f64::max)
}
