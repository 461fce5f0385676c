//! Options of every command that reads an environment map.

use clap::{Args, ValueEnum};
use hemilux::maps::{Covers, Projection, ReadOptions};

#[derive(Args, Debug)]
pub(super) struct MapArgs {
    /// Uses the upper half of the map alone; a 4:1 map that does not state its coverage is read as the upper half.
    #[arg(long, conflicts_with = "sphere")]
    hemisphere: bool,
    /// Reads the map as a map of the whole sphere, and ignores the coverage that the file states.
    #[arg(long)]
    sphere: bool,
    /// Layer of an OpenEXR file, such as ViewLayer.Combined.
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Projection of the map, in place of the projection that the file states.
    #[arg(long, value_enum)]
    projection: Option<ProjectionArg>,
    /// Largest number of texels of a map; by default 134217728, and less for short files.
    #[arg(long, value_name = "N")]
    max_pixels: Option<u64>,
}

#[derive(ValueEnum, Clone, Copy, Debug)]
enum ProjectionArg {
    /// Azimuth along columns, polar angle along rows.
    Latlong,
    /// A disc whose radius is proportional to the angle from its centre.
    Angular,
    /// Six cube faces: a vertical or horizontal cross, or a strip.
    Cube,
    /// A square photograph of a mirror ball whose edge touches the sides of the square.
    MirrorBall,
}

impl From<MapArgs> for ReadOptions {
    fn from(args: MapArgs) -> Self {
        let projection = args.projection.map(|p| match p {
            ProjectionArg::Latlong => Projection::LatLong,
            ProjectionArg::Angular => Projection::Angular,
            ProjectionArg::Cube => Projection::Cube,
            ProjectionArg::MirrorBall => Projection::MirrorBall,
        });
        let covers = match (args.hemisphere, args.sphere) {
            (true, _) => Some(Covers::Hemisphere),
            (_, true) => Some(Covers::Sphere),
            _ => None,
        };
        Self { max_pixels: args.max_pixels, layer: args.layer, projection, covers }
    }
}
