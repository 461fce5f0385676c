//! Light sets that own their lights.

use hemilux_core::light::{Light, Sh9};
use hemilux_core::wire::{LightSet, Record};

/// A light set that owns its strings, lights and harmonics.
pub type OwnedSet = Record<String, Vec<Light>, Sh9>;

/// Copies the light set `from` into `to`. The strings and the lights of `to` are overwritten in place: no memory is allocated while the new
/// ones fit.
pub fn copy(from: &LightSet<'_>, to: &mut OwnedSet) {
    let mut texts = [std::mem::take(&mut to.run), std::mem::take(&mut to.sampler)].into_iter();
    let text = |new: &str| {
        let mut text = texts.next().unwrap_or_default();
        text.clear();
        text.push_str(new);
        text
    };
    let mut kept = std::mem::take(&mut to.lights);
    let lights = |new: &[Light]| {
        kept.clear();
        kept.extend_from_slice(new);
        kept
    };
    *to = from.map(text, lights, |harmonics| *harmonics);
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemilux_core::wire::Stale;

    #[test]
    fn a_copy_equals_its_source_and_keeps_the_memory_of_its_texts_and_lights() {
        let lights = [Light { id: 7, ..Light::default() }, Light { id: 9, ..Light::default() }];
        let ambient = [[0.5; 3]; 9];
        let stale = Some(Stale { age_ms: 12, reason: "unplugged" });
        let ambient_sh = Some(&ambient);
        let full =
            LightSet { run: "8c1f2", frame: 5, sampler: "adaptive", lights: &lights, ..LightSet::EMPTY };
        let full = LightSet { stale, ambient_sh, scalar_flux: [1.0, 2.0, 3.0], ..full };
        let mut set = OwnedSet::default();
        copy(&full, &mut set);
        assert_eq!(set.view(), full, "every field");
        let memory = |set: &OwnedSet| (set.run.as_ptr(), set.sampler.as_ptr(), set.lights.as_ptr());
        let before = memory(&set);
        copy(&LightSet { run: "run", sampler: "pharr", lights: &lights[..1], ..LightSet::EMPTY }, &mut set);
        assert_eq!((set.run.as_str(), set.sampler.as_str(), set.lights.len()), ("run", "pharr", 1));
        assert_eq!((set.stale.is_none(), set.ambient_sh, memory(&set)), (true, None, before));
    }
}
