//! Options for the file format and the axes of light sets.

use crate::error::SimError;
use crate::export::Export;
use clap::Args;
use hemilux::export::Form;
use hemilux_core::wire::Coordinates;

#[derive(Args, Debug)]
pub(super) struct ExportArgs {
    /// File format of the light set: json, text, xml, csv, glb (glTF), usda (USD), rad (Radiance) or mitsuba.
    #[arg(long, value_name = "NAME", default_value = "json", value_parser = form)]
    format: Form,
    /// Axes of the light set: probe, y-up, unity, unreal, or the name of a program, such as blender [default: the axes of the format].
    #[arg(long, value_name = "NAME", value_parser = coordinates)]
    coordinates: Option<Coordinates>,
}

impl ExportArgs {
    pub(super) fn export(&self) -> Result<Export, SimError> {
        Export::try_new(self.format, self.coordinates)
    }
}

fn form(text: &str) -> Result<Form, String> {
    let names = || Form::NAMED.map(|(name, _)| name).join(", ");
    Form::from_name(text).ok_or_else(|| format!("expected one of {}", names()))
}

fn coordinates(text: &str) -> Result<Coordinates, String> {
    let names = || Coordinates::names().collect::<Vec<_>>().join(", ");
    Coordinates::from_name(text).ok_or_else(|| format!("expected one of {}", names()))
}
