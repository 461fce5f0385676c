//! The part of a sensor to which a lens file applies, and the conversion of its lens to another part.

use glam::DVec2;
use hemilux_core::lens::{Intrinsics, Lens};

/// The part of a sensor that pictures cover.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shown {
    /// Left edge, top edge, width and height of the part, in pixels of the sensor from the corner of its active area.
    pub crop: [u32; 4],
    /// Number of sensor pixels per pixel of the picture, horizontally and vertically.
    pub binning: [u32; 2],
}

impl Shown {
    /// Returns the columns and rows of pictures of this part.
    #[must_use]
    pub const fn size(&self) -> [u32; 2] {
        let [x, y] = self.binning;
        [self.crop[2] / if x == 0 { 1 } else { x }, self.crop[3] / if y == 0 { 1 } else { y }]
    }

    /// Converts `lens`, which belongs to pictures of the part `self`, to the lens of pictures of the part `to`. Returns `None` if the
    /// centre of the lens lies outside of the part `to`.
    #[must_use]
    pub fn convert(&self, lens: &Lens, to: &Self) -> Option<Lens> {
        let pair = |v: [u32; 2]| DVec2::new(v[0].into(), v[1].into());
        let corner = |shown: &Self| pair([shown.crop[0], shown.crop[1]]);
        let (from, into) = (pair(self.binning), pair(to.binning));
        let half = DVec2::splat(0.5);
        let old = lens.intrinsics();
        // The centre of a pixel lies half a pixel from its corner.
        let on_sensor = corner(self) + (old.centre_px + half) * from;
        let centre_px = (on_sensor - corner(to)) / into - half;
        let is_shown = centre_px.cmpge(-half).all() && centre_px.cmplt(pair(to.size()) - half).all();
        let scale = from / into;
        let new =
            Intrinsics { centre_px, focal_px: old.focal_px * scale, skew_px: old.skew_px * scale.x, ..*old };
        Lens::try_new(new).ok().filter(|_| is_shown)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use hemilux_core::lens::Model;

    /// Modes of the sensor imx219 from its driver.
    const FULL: Shown = Shown { crop: [0, 0, 3280, 2464], binning: [2, 2] };
    const SMALL: Shown = Shown { crop: [1000, 752, 1280, 960], binning: [2, 2] };
    const PLAIN: Shown = Shown { crop: [680, 692, 1920, 1080], binning: [1, 1] };

    fn lens() -> Lens {
        let mut vignetting = [0.0; 8];
        vignetting[0] = 1.0;
        let intrinsics = Intrinsics {
            model: Model::KannalaBrandt([-0.01, 0.002, 0.0, 0.0]),
            centre_px: DVec2::new(812.25, 620.5),
            focal_px: DVec2::new(400.0, 402.0),
            skew_px: 0.5,
            max_theta: 1.5,
            vignetting,
        };
        Lens::try_new(intrinsics).expect("a lens")
    }

    /// A direction has the same position on the sensor in each mode.
    #[test]
    fn a_converted_lens_projects_a_direction_to_the_same_sensor_pixel() {
        let sensor = |shown: &Shown, px: DVec2| {
            let at =
                |axis: usize| f64::from(shown.crop[axis]) + (px[axis] + 0.5) * f64::from(shown.binning[axis]);
            DVec2::new(at(0), at(1))
        };
        let lens = lens();
        for to in [FULL, SMALL, PLAIN] {
            let converted = FULL.convert(&lens, &to).expect("it shows the centre");
            for direction in [DVec3::Z, DVec3::new(0.1, 0.05, 1.0), DVec3::new(-0.5, 0.4, 1.0)] {
                let (old, new) =
                    (lens.project(direction.normalize()), converted.project(direction.normalize()));
                let (old, new) = (old.expect("seen"), new.expect("seen"));
                let off = (sensor(&FULL, old) - sensor(&to, new)).length();
                assert!(off < 1e-9, "{direction} in {to:?}: {off} sensor pixels");
            }
            let back = to.convert(&converted, &FULL).expect("and back");
            assert!((back.intrinsics().centre_px - lens.intrinsics().centre_px).length() < 1e-9, "{to:?}");
        }
    }

    #[test]
    fn a_mode_without_the_centre_has_no_lens() {
        let corner = Shown { crop: [0, 0, 640, 480], binning: [1, 1] };
        assert_eq!(FULL.convert(&lens(), &corner), None, "the upper left corner");
    }
}
