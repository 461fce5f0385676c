use super::*;
use hemilux::calibration::{Burst, Calibration, Pixels};
use hemilux::probe::settings::Change;
use hemilux::source::SourceError;
use hemilux_core::{Exposure, MergeMode};

/// A source whose frames have the light of their lower half multiplied by `factor`.
struct TornFrames {
    inner: Box<dyn Source>,
    factor: f32,
}

impl Source for TornFrames {
    fn calibration(&self) -> &Calibration {
        self.inner.calibration()
    }

    fn exposures(&self) -> Vec<Exposure> {
        self.inner.exposures()
    }

    fn set_exposures(&mut self, seconds: Option<&[f64]>) -> Result<(), String> {
        self.inner.set_exposures(seconds)
    }

    fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        self.inner.next(burst)?;
        for frame in &mut burst.frames {
            if let Pixels::U16(codes) = &mut frame.pixels {
                let from = codes.len() / 2;
                codes[from..].iter_mut().for_each(|code| *code = (self.factor * f32::from(*code)) as u16);
            }
        }
        Ok(())
    }
}

/// A run of the first bursts of a soak test, without clients.
struct Run<'a> {
    faults: &'a str,
    camera: DayCamera,
    bursts: u64,
    /// Exposure times, which change every 100 bursts; `None` for those of the camera.
    seconds: &'a [Option<&'a [f64]>],
    merge: MergeMode,
}

impl Run<'_> {
    /// Processes the bursts of `wrap` of the camera and compares their sets with `flux`.
    fn judged(self, flux: Fluxes, wrap: impl FnOnce(Box<dyn Source>) -> Box<dyn Source>) -> Outcome {
        let newest = self.camera.newest();
        let source = FaultSource::new(wrap(Box::new(self.camera)), self.faults.parse().expect("faults"));
        let (counts, tally) = (source.counts(), Arc::new(Tally::new()));
        let seconds = |burst: usize| self.seconds[burst / 100 % self.seconds.len()];
        let mut config = Config { exposures_s: seconds(0).map(<[f64]>::to_vec), ..Config::steady() };
        config.pipeline.merge = self.merge;
        let mut worker = Worker::try_new(Box::new(source), "soak".into(), config).expect("a worker");
        let link = worker.link();
        let mut judge = SetJudge::new(flux, &newest, &tally, &counts);
        for burst in 0..self.bursts as usize {
            if burst > 0 && burst % 100 == 0 && self.seconds.len() > 1 {
                let setting =
                    SETTINGS.iter().find(|setting| setting.name == "exposures_s").expect("a setting");
                let mut change = Change::default();
                change.add(setting, serde_json::json!(seconds(burst))).expect("exposures");
                link.settings().change(&change).expect("legal exposures");
            }
            let is_ok = worker.step().is_ok();
            judge.judge_burst(&link, is_ok);
        }
        judge.into_outcome()
    }
}

fn flux() -> Fluxes {
    fluxes().expect("fluxes")
}

const KINDS: [&str; 5] = ["torn", "swapped", "black", "saturated", "label"];
const TWO: Option<&[f64]> = Some(&[0.000_926, 0.033_333]);
const FOUR: Option<&[f64]> = Some(&[0.000_926, 0.003_704, 0.014_816, 0.059_264]);

#[test]
fn no_fault_in_dim_light_makes_a_wrong_set() {
    // The light rises from 1/500 to 1/100 of the brightest; rows of the shortest exposure have a mean of one to fourteen codes.
    for (seconds, merge) in [(None, MergeMode::All), (TWO, MergeMode::All), (TWO, MergeMode::Needed)] {
        for (seed, kind) in KINDS.into_iter().enumerate() {
            let faults = format!("{kind}=0.05,sound=8,seed={seed}");
            let camera = camera(8_000).expect("a camera").without_lamps();
            let run = Run { faults: &faults, camera, bursts: 1_000, seconds: &[seconds], merge };
            let outcome = run.judged(flux(), |camera| camera);
            let seen: u64 = outcome.faults.iter().map(|fault| fault.seen).sum();
            assert!(seen > 30, "{kind}: {seen} faults");
            assert_eq!(outcome.wrong, 0, "{kind}, {seconds:?}, {merge:?}: {:#?}", outcome.words);
        }
    }
}

#[test]
fn neither_faults_nor_other_exposures_make_a_wrong_set_under_lamps() {
    let settings = [
        (&[None][..], MergeMode::All),
        (&[None], MergeMode::Needed),
        (&[None, TWO, None, FOUR], MergeMode::All),
    ];
    let (mut found, mut off_mean) = (0, 0);
    for ((seconds, merge), (seed, kind)) in settings
        .into_iter()
        .flat_map(|run| KINDS.into_iter().chain(["drop"]).enumerate().map(move |kind| (run, kind)))
    {
        let faults = format!("{kind}=0.05,sound=8,seed={seed}");
        // The lamps are lit from burst 150 to burst 600.
        let camera = camera(3_000).expect("a camera");
        let outcome =
            Run { faults: &faults, camera, bursts: 800, seconds, merge }.judged(flux(), |camera| camera);
        assert!(outcome.lit > 350, "{kind}: {} sets under lamps", outcome.lit);
        assert!(2 * outcome.found > outcome.searched, "{kind}: {} sets with lamps found", outcome.found);
        assert_eq!(outcome.wrong, 0, "{kind}, {seconds:?}, {merge:?}: {:#?}", outcome.words);
        (found, off_mean) = (found + outcome.found, off_mean + outcome.off_mean);
    }
    assert!(200 * off_mean <= found, "{off_mean} of {found} sets differ from the mean light of the lamps");
}

/// In the evening, the shorter exposure measures the bulb and some rows alone, so that it does not confirm the other rows of the longer one.
#[test]
fn no_torn_frame_of_two_exposures_makes_a_wrong_set_in_the_evening() {
    let camera = camera(864_000).expect("a camera").starting_at(45_000);
    let faults = "torn=0.03,sound=8,seed=0";
    let run = Run { faults, camera, bursts: 2_500, seconds: &[TWO], merge: MergeMode::Needed };
    let outcome = run.judged(flux(), |camera| camera);
    let torn: u64 = outcome.faults.iter().map(|fault| fault.seen).sum();
    assert!(torn > 60, "{torn} torn frames");
    assert_eq!(outcome.wrong, 0, "{:#?}", outcome.words);
    assert!(outcome.left_out <= torn, "frames of {} bursts left out, {torn} torn", outcome.left_out);
}

/// In the first seconds after the lamps are switched on at night, the bulb flickers in one row of the shortest exposure, and the other rows are dark.
#[test]
fn no_torn_frame_makes_a_wrong_set_after_lamps_are_switched_on() {
    for seed in 48..56 {
        let camera = camera(864_000).expect("a camera").starting_at(43_195);
        let faults = format!("torn=0.05,sound=8,seed={seed}");
        let run = Run { faults: &faults, camera, bursts: 60, seconds: &[None], merge: MergeMode::Needed };
        let outcome = run.judged(flux(), |camera| camera);
        assert!(outcome.lit > 50 && outcome.faults.iter().any(|fault| fault.seen > 0), "{outcome:?}");
        assert_eq!(outcome.wrong, 0, "seed {seed}: {:#?}", outcome.words);
    }
}

/// A jump in the dark must repeat before it counts as light. A fault in the burst of the switch takes one of the bursts that repeat, and the bulb
/// flickers in the shorter exposures of the others.
#[test]
fn faults_are_recovered_within_two_bursts_while_lamps_are_switched_on() {
    let mut seen = 0;
    for (seed, kind, seconds) in [10, 18, 21]
        .into_iter()
        .flat_map(|seed| ["size", "torn"].map(|kind| (seed, kind)))
        .flat_map(|(seed, kind)| [None, TWO].map(|seconds| (seed, kind, seconds)))
    {
        let camera = camera(864_000).expect("a camera").starting_at(43_192);
        let faults = format!("{kind}=0.08,sound=8,seed={seed}");
        let run = Run { faults: &faults, camera, bursts: 20, seconds: &[seconds], merge: MergeMode::Needed };
        let outcome = run.judged(flux(), |camera| camera);
        let count = |of: fn(&judge::FaultOutcome) -> u64| outcome.faults.iter().map(of).sum::<u64>();
        let unrecovered = count(|fault| fault.unrecovered);
        assert_eq!((unrecovered, outcome.wrong), (0, 0), "{kind}, seed {seed}: {:#?}", outcome.words);
        seen += count(|fault| fault.seen);
    }
    assert!(seen >= 12, "{seen} faults");
}

#[test]
fn sets_of_other_lamps_are_wrong() {
    let wrong = |factor: f64| {
        let flux = Fluxes { lamps: flux().lamps.map(|v| factor * v), ..flux() };
        let camera = camera(3_000).expect("a camera");
        let run = Run { faults: "all=0", camera, bursts: 700, seconds: &[None], merge: MergeMode::All };
        let outcome = run.judged(flux, |camera| camera);
        outcome.wrong + outcome.off_mean
    };
    assert_eq!(wrong(1.0), 0, "the lamps of the camera");
    assert!([wrong(0.7), wrong(1.3)].iter().all(|wrong| *wrong > 200), "other lamps");
}

#[test]
fn the_committed_report_of_a_day_has_the_figures_of_the_readme() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("a workspace");
    let read = |name: &str| std::fs::read_to_string(root.join(name)).expect("a text");
    let (report, readme) = (read("fixtures/soak.txt"), read("board/README.md"));
    let count = |name: &str| -> f64 {
        let line = report.lines().find_map(|line| line.strip_prefix(name)).expect("a line of the report");
        line.trim().parse().expect("a number")
    };
    assert!(report.starts_with("24.00 h") && report.trim_end().ends_with("all requirements hold"));
    let one_in = count("sets under lamps that are found") / count("sets off the mean of the lamps");
    let stated = format!("in a day, one in {} does", 10.0 * (one_in / 10.0).round());
    assert!(readme.contains(&stated), "expected in board/README.md: {stated}");
}

#[test]
fn sets_of_torn_bursts_of_one_exposure_are_wrong() {
    let torn = |factor| move |inner| -> Box<dyn Source> { Box::new(TornFrames { inner, factor }) };
    // A single frame cannot contradict another one, so that the probe merges it.
    let wrong = |factor| {
        let camera = camera(16_000).expect("a camera");
        let seconds = &[Some(&[0.033_333][..])];
        let run = Run { faults: "all=0", camera, bursts: 50, seconds, merge: MergeMode::Needed };
        run.judged(flux(), torn(factor)).wrong
    };
    assert_eq!(wrong(1.0), 0, "bursts without a fault");
    // The lower half has about half of the light.
    assert_eq!([wrong(0.8), wrong(1.2)], [50, 50]);
}
