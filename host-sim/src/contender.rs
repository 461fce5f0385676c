//! The methods of a comparison behind one interface: the core's samplers, the baselines with and without Voronoi gather, and the offline
//! volume sampler.

use crate::baseline::{self, gather};
use crate::env::EnvMap;
use crate::maps::{self, OrderedMaps};
use crate::metrics::{Domain, Lit, LitSet};
use crate::scenario::Scenario;
use hemilux::maps::ReadOptions;
use hemilux::samplers;
use hemilux_core::SamplerKind;
use hemilux_core::light::Decomposition;
use hemilux_core::sampler::Request;

/// Kind of a method of a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MethodKind {
    /// A sampler of the core, which runs on the probe.
    Core,
    /// A method of the literature that decomposes each map on its own.
    Baseline,
    /// A baseline followed by a Voronoi gather.
    Gathered,
    /// A method whose input is all maps of the sequence at once.
    Offline,
}

/// Name and kind of a method of a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Method {
    /// Name of the method in charts and reports: a base name, and suffixes such as `+sh`.
    pub name: &'static str,
    /// Kind of the method: of the core, baseline, baseline with gather, or offline.
    pub kind: MethodKind,
}

impl Method {
    /// Returns the least number of lights that the method supports.
    #[must_use]
    pub fn least(&self, domain: Domain) -> usize {
        if self.kind == MethodKind::Core { self.sampler().least_lights(domain) } else { 1 }
    }

    /// Returns the name without the suffixes `+v` (gather), `+sh` (ambient light) and `+soft` (discs).
    #[must_use]
    pub fn base(&self) -> &'static str {
        self.name.split('+').next().unwrap_or(self.name)
    }

    /// Returns the kind of the core's sampler; the default kind for methods outside of the core.
    #[must_use]
    pub fn sampler(&self) -> SamplerKind {
        self.base().parse().unwrap_or_default()
    }

    /// Returns the request for `lights` lights that a sampler of the core receives.
    #[must_use]
    pub fn request(&self, lights: usize) -> Request {
        Request { ambient: self.is_asked("sh"), soft: self.is_soft(), ..Request::of_lights(lights) }
    }

    /// Returns whether the method fits its lights as discs.
    #[must_use]
    pub fn is_soft(&self) -> bool {
        self.is_asked("soft")
    }

    fn is_asked(&self, suffix: &str) -> bool {
        self.name.split('+').skip(1).any(|s| s == suffix)
    }
}

/// Returns all methods: the core's by [`SamplerKind::NAMES`] and `adaptive` with ambient light, with discs and with both, then the
/// baselines, then `volume`.
#[must_use]
pub fn methods() -> Vec<Method> {
    let core = SamplerKind::NAMES
        .into_iter()
        .chain(["adaptive+sh", "adaptive+soft", "adaptive+sh+soft"])
        .map(|name| Method { name, kind: MethodKind::Core });
    let baselines = baseline::all().into_iter().map(|b| {
        let kind = if b.name().ends_with("+v") { MethodKind::Gathered } else { MethodKind::Baseline };
        Method { name: b.name(), kind }
    });
    let offline = [Method { name: "volume", kind: MethodKind::Offline }];
    core.chain(baselines).chain(offline).collect()
}

/// Returns the baseline with the name `name` in its initial state.
///
/// # Panics
/// If there is no baseline of this name.
#[must_use]
pub fn baseline_called(name: &str) -> Box<dyn baseline::Baseline> {
    let mut all = baseline::all().into_iter();
    all.find(|b| b.name() == name).expect("the name is that of a baseline")
}

/// Converts the decomposition of a core sampler to the light set that the scores read.
#[must_use]
pub fn judged(made: &Decomposition<'_>) -> LitSet {
    let lit = |l: &hemilux_core::light::Light| Lit {
        direction: l.direction.to_array().map(f64::from),
        irradiance: l.irradiance.map(f64::from),
        radius_deg: f64::from(l.radius_deg),
        id: l.id,
    };
    let ambient_sh = made.ambient.map(|rows| rows.map(|rgb| rgb.map(f64::from)));
    LitSet { lights: made.lights.iter().map(lit).collect(), ambient_sh }
}

/// The light sets of one method over the frames of a sequence.
#[derive(Clone, Debug)]
pub struct MethodRun {
    /// Method that computed the light sets.
    pub method: Method,
    /// Largest number of lights of a set.
    pub lights: usize,
    /// One set per frame; `None` if the method does not support the scenario.
    pub sets: Option<Vec<LitSet>>,
}

/// Runs each sampler of the core over a sequence with each number of lights of `counts`; all runs share the maps.
#[must_use]
pub fn run_core(scenario: &Scenario, counts: &[usize]) -> Vec<MethodRun> {
    run_core_of(scenario, counts, |_| true)
}

/// Runs the methods of the core for which `is_wanted` returns true over a sequence, with each number of lights of `counts`.
#[must_use]
pub fn run_core_of(
    scenario: &Scenario,
    counts: &[usize],
    is_wanted: impl Fn(&Method) -> bool,
) -> Vec<MethodRun> {
    let mut maps = OrderedMaps::new(&scenario.seen()[0], scenario.domain, counts);
    let core: Vec<Method> =
        methods().into_iter().filter(|m| m.kind == MethodKind::Core && is_wanted(m)).collect();
    let mut running: Vec<_> = core
        .iter()
        .flat_map(|&method| counts.iter().map(move |&lights| (method, lights)))
        .map(|(method, lights)| {
            (method, lights, samplers::make(method.sampler(), maps.of(lights).0, lights).ok(), Vec::new())
        })
        .collect();
    for (t, map) in scenario.seen().iter().enumerate().step_by(scenario.held) {
        maps.fill(map);
        for (method, most, sampler, sets) in &mut running {
            if let Some(sampler) = sampler {
                let lights = scenario.lights(t, *most, method.least(scenario.domain));
                sets.push(judged(&sampler.update(&maps.of(*most).1, &method.request(lights))));
            }
        }
    }
    let runs = running.into_iter();
    runs.map(|(method, lights, sampler, sets)| {
        let sets = sampler.map(|_| in_effect(sets, scenario));
        MethodRun { method, lights, sets }
    })
    .collect()
}

/// Returns the set that is in effect in each frame: each of `sets` for as many frames as the scenario states.
fn in_effect(sets: Vec<LitSet>, scenario: &Scenario) -> Vec<LitSet> {
    let held = sets.into_iter().flat_map(|set| std::iter::repeat_n(set, scenario.held));
    held.take(scenario.truth.len()).collect()
}

/// Runs a baseline over a sequence; returns its sets, and the sets after the Voronoi gather.
fn run_baseline(method: Method, scenario: &Scenario, lights: usize) -> [Vec<LitSet>; 2] {
    let mut sampler = baseline_called(method.name);
    let (mut raw, mut gathered) = (Vec::new(), Vec::new());
    for (t, map) in scenario.seen().iter().enumerate().step_by(scenario.held) {
        let lights = scenario.lights(t, lights, 1);
        let made = sampler.decompose(map, scenario.domain, lights);
        gathered.push(gather(map, scenario.domain, &made).into());
        raw.push(made.into());
    }
    [raw, gathered].map(|sets| in_effect(sets, scenario))
}

fn run_volume(scenario: &Scenario, lights: usize) -> Option<Vec<LitSet>> {
    // The volume sampler has one number of lights for the whole sequence.
    scenario.share.is_empty().then(|| {
        let maps: Vec<EnvMap> = scenario.seen().iter().step_by(scenario.held).cloned().collect();
        let frames = baseline::volume(&maps, scenario.domain, lights);
        in_effect(frames.into_iter().map(LitSet::from).collect(), scenario)
    })
}

/// Runs the methods outside of the core over a sequence with each number of lights of `counts`.
#[must_use]
pub fn run_baselines(scenario: &Scenario, counts: &[usize]) -> Vec<MethodRun> {
    let all = methods();
    let mut runs = Vec::new();
    for method in all.iter().filter(|m| m.kind == MethodKind::Baseline) {
        let gathered = all.iter().find(|m| m.kind == MethodKind::Gathered && m.base() == method.name);
        let mut after = Vec::new();
        for &lights in counts {
            let [raw, with_v] = run_baseline(*method, scenario, lights);
            runs.push(MethodRun { method: *method, lights, sets: Some(raw) });
            after.extend(gathered.map(|&method| MethodRun { method, lights, sets: Some(with_v) }));
        }
        runs.extend(after);
    }
    for &method in all.iter().filter(|m| m.kind == MethodKind::Offline) {
        runs.extend(counts.iter().map(|&lights| MethodRun {
            method,
            lights,
            sets: run_volume(scenario, lights),
        }));
    }
    runs
}

/// Reads the maps of a folder with their names; wider maps are resampled to `width` columns.
///
/// # Errors
/// [`crate::error::SimError`] with the path of the folder or of the map that cannot be read.
pub fn read_maps(
    folder: &std::path::Path,
    width: usize,
) -> Result<Vec<(String, EnvMap)>, crate::error::SimError> {
    let read = |path: std::path::PathBuf| {
        let map = crate::decompose::read(&path, &ReadOptions::default())?;
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok((name, if map.width() > width { maps::resized(&map, width) } else { map }))
    };
    crate::decompose::list(folder)?.into_iter().map(read).collect()
}
