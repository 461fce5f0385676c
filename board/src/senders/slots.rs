//! A fixed number of slots for lights: a light keeps its slot while it is among the brightest.

use hemilux_core::color::luminance;
use hemilux_core::light::Light;

/// Id of the light in each slot; 0 in a free slot.
#[derive(Clone, Debug)]
pub(super) struct Slots(Vec<u32>);

impl Slots {
    pub(super) fn new(count: usize) -> Self {
        Self(vec![0; count])
    }

    /// Assigns the brightest of `lights` to the slots and returns the light of each slot; `None` for a free slot.
    pub(super) fn place<'a>(&mut self, lights: &'a [Light]) -> Vec<Option<&'a Light>> {
        let mut shown: Vec<_> = lights.iter().collect();
        shown.sort_by(|a, b| luminance(b.irradiance).total_cmp(&luminance(a.irradiance)));
        shown.truncate(self.0.len());
        for id in &mut self.0 {
            if !shown.iter().any(|light| light.id == *id) {
                *id = 0;
            }
        }
        for light in &shown {
            if !self.0.contains(&light.id)
                && let Some(free) = self.0.iter_mut().find(|id| **id == 0)
            {
                *free = light.id;
            }
        }
        self.0.iter().map(|id| shown.iter().find(|light| light.id == *id).copied()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn light(id: u32, energy: f32) -> Light {
        Light { id, irradiance: [energy; 3], ..Light::default() }
    }

    #[test]
    fn a_light_keeps_its_slot_and_a_new_one_gets_a_free_slot() {
        let mut slots = Slots::new(3);
        let ids = |placed: Vec<Option<&Light>>| placed.iter().map(|l| l.map(|l| l.id)).collect::<Vec<_>>();
        let first = [light(7, 1.0), light(8, 3.0)];
        assert_eq!(ids(slots.place(&first)), [Some(8), Some(7), None], "brightest first");
        let second = [light(7, 9.0), light(9, 2.0)];
        assert_eq!(ids(slots.place(&second)), [Some(9), Some(7), None], "8 is gone, 7 stays");
        let third = [light(1, 1.0), light(9, 2.0), light(7, 3.0), light(2, 4.0)];
        assert_eq!(ids(slots.place(&third)), [Some(9), Some(7), Some(2)], "the dimmest is left out");
    }
}
