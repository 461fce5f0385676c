//! Prints the lights of a scene without a window: `cargo run --example headless -- [http://127.0.0.1:8080] [frames]`.

use bevy_app::App;
use bevy_hemilux::{HemiluxPlugin, LightId, Probe};
use bevy_light::DirectionalLight;
use bevy_transform::components::Transform;
use hemilux::client::State;
use std::time::Duration;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let address = arguments.next().unwrap_or_else(|| "http://127.0.0.1:8080".into());
    let frames = arguments.next().and_then(|n| n.parse().ok()).unwrap_or(usize::MAX);
    let mut app = App::new();
    app.add_plugins(HemiluxPlugin::new(&address));
    let mut told = None;
    for frame in 0..frames {
        app.update();
        let state = app.world().resource::<Probe>().state();
        if told.as_ref() != Some(&state)
            && let State::Lost(reason) | State::Stale(reason) = &state
        {
            eprintln!("headless: {reason}");
        }
        told = Some(state);
        let mut lights = app.world_mut().query::<(&LightId, &Transform, &DirectionalLight)>();
        for (LightId(id), transform, light) in lights.iter(app.world()) {
            println!("{frame} {id} {:+.3} {:.1} lx", transform.back().as_vec3(), light.illuminance);
        }
        std::thread::sleep(Duration::from_millis(100));
    }
}
