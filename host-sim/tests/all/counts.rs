//! Instruction counts in the READMEs, compared with `tests/instructions/baseline.txt`.

use std::fs::read_to_string;

/// Numbers of lights, and the overall times of `pharr`, `hemigon` and `q2tree` in milliseconds: tables 5.1 and C.1 to C.3 of \[Nikodym2012\].
const THESIS: [(u32, [Option<f64>; 3]); 3] = [
    (200, [Some(130.0), Some(460.0), Some(150.0)]),
    (1000, [Some(130.0), Some(460.0), Some(170.0)]),
    (10000, [Some(200.0), None, Some(1250.0)]),
];

#[test]
fn the_readme_sets_the_times_of_the_thesis_beside_the_counts_of_the_baseline() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    let read = |name: &str| read_to_string(format!("{root}/{name}")).expect(name);
    let (baseline, top) = (read("tests/instructions/baseline.txt"), read("README.md"));
    let total = |method: &str, lights: u32| -> f64 {
        let case = format!("rgb24:640x480:{method}:{lights} ");
        let line = baseline.lines().find(|line| line.starts_with(&case)).expect(&case);
        let last = line.split_whitespace().last().expect("a total");
        last.parse::<f64>().expect("a count") / 1e6
    };
    for (lights, times) in THESIS {
        let mut row = format!("| {lights} |");
        for (method, ms) in ["pharr", "hemigon", "q2tree"].into_iter().zip(times) {
            match ms {
                Some(ms) => {
                    let count = total(method, lights);
                    let (theirs, ours) = (ms / 150.0, count / total("q2tree", 200));
                    row += &format!(" {ms} ms, {theirs:.1} | {count:.1} M, {ours:.1} |");
                }
                None => row += " | |",
            }
        }
        assert!(top.contains(&row), "expected in README.md: {row}");
    }
}

#[test]
fn readmes_have_the_instruction_counts_of_the_baseline() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    let read = |name: &str| read_to_string(format!("{root}/{name}")).expect(name);
    let (baseline, top, core) =
        (read("tests/instructions/baseline.txt"), read("README.md"), read("core/README.md"));
    let names = [
        ("rgb24:640x480:q2tree:64", "RGB24, `q2tree`"),
        ("rgb24:640x480:adaptive:64", "RGB24, `adaptive`"),
        ("raw10:640x480:q2tree:64", "RAW10, `q2tree`"),
        ("yuyv:640x480:q2tree:64", "YUYV, `q2tree`"),
    ];
    let (mut totals, mut stages) = (Vec::new(), Vec::new());
    for (case, name) in names {
        let line = baseline.lines().find_map(|l| l.strip_prefix(case)).expect(case);
        let counts = line.split_whitespace().map(|n| n.parse::<f64>().expect("a count") / 1e6);
        let counts: [f64; 5] = counts.collect::<Vec<_>>().try_into().expect("five of them");
        let [front, pyramid, sample, other, all] = counts;
        let row = format!(
            "| {name}, 64 lights | {front:.1} M | {pyramid:.2} M | {sample:.2} M | {other:.2} M | {all:.1} M |"
        );
        assert!(core.contains(&row), "expected in core/README.md: {row}");
        if case.contains("q2tree") {
            totals.push(format!("{all:.1} M"));
            stages.push(format!("{front:.1}, {pyramid:.1}, {sample:.2} M"));
        } else {
            let told = format!(
                "`adaptive` in place of `q2tree`, the sampler takes {sample:.1} M instructions on ARMv7"
            );
            assert!(top.contains(&told), "expected in README.md: {told}");
            let told = format!("(64 points {sample:.1} M)");
            assert!(top.contains(&told), "expected in README.md: {told}");
        }
    }
    let sample = |case: &str| -> f64 {
        let line = baseline.lines().find_map(|l| l.strip_prefix(case)).expect(case);
        line.split_whitespace().nth(2).expect("a count").parse::<f64>().expect("a count") / 1e6
    };
    for (discs, words) in [(16, "16 discs take"), (64, "64 discs")] {
        let told = format!("{words} {:.1} M", sample(&format!("rgb24:640x480:adaptive+soft:{discs} ")));
        assert!(top.contains(&told), "expected in README.md: {told}");
    }
    for (name, cells) in
        [("ARMv7 with NEON, instructions", totals), ("of which merge and map, pyramid, `q2tree`", stages)]
    {
        let row = format!("| {name} | {} |", cells.join(" | "));
        assert!(top.contains(&row), "expected in README.md: {row}");
    }
}

#[test]
fn readmes_have_the_counts_of_all_exposures_of_a_sliding_window_and_of_flicker() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    let read = |name: &str| read_to_string(format!("{root}/{name}")).expect(name);
    let (baseline, top, core) =
        (read("tests/instructions/baseline.txt"), read("README.md"), read("core/README.md"));
    let counts = |case: &str| -> Vec<f64> {
        let line = baseline.lines().find_map(|l| l.strip_prefix(&format!("{case}:640x480:q2tree:64 ")));
        let numbers = line.expect(case).split_whitespace();
        numbers.map(|n| n.parse::<f64>().expect("a count") / 1e6).collect()
    };
    let names = [
        ("rgb24+all", "RGB24, `q2tree`, `MergeMode::All`"),
        ("yuyv+all", "YUYV, `q2tree`, `MergeMode::All`"),
        ("rgb24+sliding", "RGB24, `q2tree`, one frame of a `Window`"),
        ("yuyv+sliding", "YUYV, `q2tree`, one frame of a `Window`"),
        ("rgb24+mains", "RGB24, `q2tree`, all light flickers at 100 Hz"),
    ];
    for (case, name) in names {
        let own = counts(case);
        let row = format!(
            "| {name} | {:.1} M | {:.2} M | {:.2} M | {:.2} M | {:.1} M |",
            own[0], own[1], own[2], own[3], own[4]
        );
        assert!(core.contains(&row), "expected in core/README.md: {row}");
    }
    let [rgb24, yuyv] = ["rgb24+all", "yuyv+all"].map(|case| counts(case)[4]);
    let row = format!("| total with `--merge all` | {rgb24:.1} M | not counted | {yuyv:.1} M |");
    assert!(top.contains(&row), "expected in README.md: {row}");
    let [sliding, needed, all] = ["rgb24+sliding", "rgb24", "rgb24+all"].map(|case| counts(case)[4]);
    let told = [
        format!("A set takes {sliding:.1} M instructions on ARMv7 (RGB24, `q2tree`, 64 lights)"),
        format!("the three sets of a burst take {:.1} x as many", 3.0 * sliding / needed),
        format!("and {:.1} x as many as that set with `--merge all`", 3.0 * sliding / all),
    ];
    for told in told {
        assert!(top.contains(&told), "expected in README.md: {told}");
    }
}
