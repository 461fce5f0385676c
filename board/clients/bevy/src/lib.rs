//! Shows the lights of a hemilux light probe as directional lights of a Bevy scene. A light keeps its entity for as long as it exists.
//!
//! ```no_run
//! # use bevy_app::App;
//! App::new().add_plugins(bevy_hemilux::HemiluxPlugin::new("http://127.0.0.1:8080")).run();
//! ```
//! In a program with the crate `bevy`, add the plugin to `DefaultPlugins`. [`Probe`] contains the newest set and the state of the
//! connection.

use bevy_app::{App, Plugin, PreUpdate};
use bevy_color::LinearRgba;
use bevy_ecs::component::Component;
use bevy_ecs::entity::Entity;
use bevy_ecs::resource::Resource;
use bevy_ecs::system::{Commands, Query, Res, ResMut};
use bevy_light::DirectionalLight;
use bevy_math::Vec3;
use bevy_transform::components::Transform;
use hemilux::client::{Client, ClientError, Coordinates, Light, Options, State};
use std::collections::HashMap;
use std::time::Instant;

/// Plugin that shows the lights of a probe as [`DirectionalLight`]s.
#[derive(Clone, Debug)]
pub struct HemiluxPlugin {
    /// Address of the probe, `http://HOST:PORT`.
    pub address: String,
    /// Largest number of lights that are shown.
    pub lights: usize,
    /// Factor from the probe's unit of irradiance to lux.
    pub lux: f32,
    /// True if the lights cast shadows.
    pub shadows: bool,
}

impl HemiluxPlugin {
    /// Creates the plugin for four lights with shadows of the probe at `address`; the probe's unit is taken to be 1,000 lux.
    #[must_use]
    pub fn new(address: &str) -> Self {
        Self { address: address.into(), lights: 4, lux: 1000.0, shadows: true }
    }
}

/// The connection to the probe, as a resource of the app.
#[derive(Resource)]
pub struct Probe {
    client: Result<Client, ClientError>,
    lux: f32,
    shadows: bool,
    entities: HashMap<u32, Entity>,
    run: String,
}

impl Probe {
    /// Returns the state of the connection; for an invalid address, [`State::Lost`] with the reason.
    #[must_use]
    pub fn state(&self) -> State {
        match &self.client {
            Ok(client) => client.state(),
            Err(error) => State::Lost(error.to_string()),
        }
    }
}

/// Id of the light that an entity shows.
#[derive(Clone, Copy, Component, Debug, PartialEq, Eq)]
pub struct LightId(pub u32);

impl Plugin for HemiluxPlugin {
    fn build(&self, app: &mut App) {
        let lights = Some(self.lights);
        let options = Options { lights, coordinates: Coordinates::YUp, ..Options::new(&self.address) };
        let client = Client::connect(&options);
        let (lux, shadows) = (self.lux, self.shadows);
        app.insert_resource(Probe { client, lux, shadows, entities: HashMap::new(), run: String::new() });
        app.add_systems(PreUpdate, follow);
    }
}

/// Creates or updates an entity for each light at this time, and removes the entities of lights that have ended.
fn follow(
    mut commands: Commands,
    mut probe: ResMut<Probe>,
    mut shown: Query<(&mut Transform, &mut DirectionalLight)>,
) {
    let mut lights = Vec::new();
    let Ok(client) = &probe.client else { return };
    let Some(run) = client.latest().map(|set| set.run.clone()) else { return };
    client.interpolated(Instant::now(), &mut lights);
    let is_new_run = probe.run != run;
    let gone = |id: &u32| is_new_run || !lights.iter().any(|light| light.id == *id);
    for (_, entity) in probe.entities.extract_if(|id, _| gone(id)) {
        commands.entity(entity).despawn();
    }
    probe.run = run;
    for light in &lights {
        let (transform, directional) = bundle(light, probe.lux, probe.shadows);
        match probe.entities.get(&light.id).and_then(|entity| shown.get_mut(*entity).ok()) {
            Some((mut place, mut lamp)) => (*place, *lamp) = (transform, directional),
            None => {
                let entity = commands.spawn((transform, directional, LightId(light.id))).id();
                probe.entities.insert(light.id, entity);
            }
        }
    }
}

/// Returns a Bevy light that emits along its -Z axis and whose illuminance times colour is the irradiance of `light` times `lux`.
fn bundle(light: &Light, lux: f32, shadows: bool) -> (Transform, DirectionalLight) {
    let [r, g, b] = light.irradiance;
    let top = r.max(g).max(b).max(f32::MIN_POSITIVE);
    let towards = Vec3::from_array(light.direction.to_array());
    let up = if towards.y.abs() > 0.99 { Vec3::X } else { Vec3::Y };
    let directional = DirectionalLight {
        illuminance: top * lux,
        color: LinearRgba::rgb(r / top, g / top, b / top).into(),
        shadow_maps_enabled: shadows,
        ..DirectionalLight::default()
    };
    (Transform::default().looking_to(-towards, up), directional)
}

/// Returns the state of the connection to the probe, for a system that displays it.
pub fn state(probe: Res<Probe>) -> State {
    probe.state()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_light_shines_away_from_its_direction_with_the_illuminance_of_its_irradiance() {
        for direction in [[0.6, 0.8, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]] {
            let light =
                Light { id: 3, direction: direction.into(), irradiance: [2.0, 4.0, 1.0], ..Light::default() };
            let (transform, directional) = bundle(&light, 100.0, true);
            let off = (transform.forward().as_vec3() + Vec3::from_array(direction)).length();
            assert!(off < 1e-6, "{direction:?}: {off}");
            let colour = LinearRgba::from(directional.color);
            let found = [colour.red, colour.green, colour.blue].map(|v| v * directional.illuminance);
            assert_eq!(found, [200.0, 400.0, 100.0]);
        }
    }

    #[test]
    fn a_wrong_address_leaves_the_program_running_and_is_one_line() {
        let mut app = App::new();
        app.add_plugins(HemiluxPlugin::new("nonsense"));
        app.update();
        let State::Lost(reason) = app.world().resource::<Probe>().state() else { panic!("a reason") };
        assert!(reason.contains("nonsense") && !reason.contains('\n'), "{reason}");
    }
}
