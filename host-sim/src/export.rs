//! Writer of light sets to standard output in a file format (form) and coordinate axes.

use crate::error::SimError;
use hemilux::consistency::LeftOut;
use hemilux::export::{Form, encode};
use hemilux_core::wire::{Coordinates, FramesLeftOut, LightSet};
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;

/// File format (form) and coordinate axes of the light sets that a command writes.
#[derive(Clone, Copy, Debug)]
pub struct Export {
    form: Form,
    axes: Coordinates,
}

impl Export {
    /// Combines `form` with `axes`; without `axes`, the form's own axes are used.
    ///
    /// # Errors
    /// [`SimError::Usage`] for axes in which the form cannot be written.
    pub fn try_new(form: Form, axes: Option<Coordinates>) -> Result<Self, SimError> {
        let axes = form.axes(axes).map_err(|e| SimError::Usage(format!("--coordinates: found {e}")))?;
        Ok(Self { form, axes })
    }

    /// Returns whether written maps must cover the whole sphere, since the programs that read the form do not support hemispheres.
    #[must_use]
    pub fn needs_whole_maps(&self) -> bool {
        self.form == Form::Usda
    }

    /// Refuses a sequence of `count` sets for a form whose files contain one set.
    ///
    /// # Errors
    /// [`SimError::Usage`] for more than one set in a form whose files contain one set.
    pub fn check_count(&self, count: usize) -> Result<(), SimError> {
        if count <= 1 || !self.form.is_scene() {
            return Ok(());
        }
        let name = self.form.name();
        Err(SimError::Usage(format!(
            "--format {name}: found a sequence of {count}, expected one map or burst, or the format json, text, xml or csv"
        )))
    }

    /// Writes one light set to standard output. `map` is the path of a map of the same scene, which a USD file refers to.
    ///
    /// # Errors
    /// [`SimError`] if the set cannot be encoded or standard output is closed.
    pub fn print(&self, set: &LightSet<'_>, map: Option<&Path>) -> Result<(), SimError> {
        self.print_with(set, map, &[])
    }

    /// Writes one light set to standard output, in the JSON form with `frames_left_out`: index, reason and file of each frame of the burst that
    /// was not merged.
    ///
    /// # Errors
    /// The errors of [`Export::print`].
    pub fn print_with(
        &self,
        set: &LightSet<'_>,
        map: Option<&Path>,
        frames_left_out: &[LeftOut],
    ) -> Result<(), SimError> {
        let set = LightSet { coordinates: self.axes, frames_left_out: FramesLeftOut::NONE, ..*set };
        let map = map.map(|path| path.to_string_lossy());
        let mut bytes = Vec::new();
        encode(self.form, &set, map.as_deref(), &mut bytes).map_err(|e| SimError::Failed(e.to_string()))?;
        let list = |f: &LeftOut| json!({"index": f.index, "why": f.fault.name(), "file": f.file});
        let list: Value = frames_left_out.iter().map(list).collect();
        if self.form == Form::Json && !frames_left_out.is_empty() && bytes.pop_if(|b| *b == b'}').is_some() {
            bytes.extend(format!(",\"frames_left_out\":{list}}}").bytes());
        }
        if self.form != Form::Glb && bytes.last() != Some(&b'\n') {
            bytes.push(b'\n');
        }
        let closed = |e: std::io::Error| {
            SimError::Failed(format!("standard output: found {e}, expected a stream that can be written"))
        };
        std::io::stdout().write_all(&bytes).map_err(closed)
    }
}
