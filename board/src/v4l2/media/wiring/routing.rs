//! Routes through the entities of a graph whose drivers have streams: without an active route from sink pad to source pad, no frame passes.
//!
//! Drivers without streams have no routes, and requests for routes fail.

use super::super::graph::{Link, Pad};
use super::Wiring;
use crate::v4l2::abi::{PadRoute, ROUTE_ACTIVE};
use crate::v4l2::{Call, CameraError, persist};

/// The routes of an entity before the change.
pub(super) struct RoutesBefore {
    pad: Pad,
    routes: Vec<PadRoute>,
}

/// Returns whether a route is active and connects the first streams of two pads.
fn connects(route: &PadRoute, sink: Pad, source: Pad) -> bool {
    let ends = [route.sink_pad, route.sink_stream, route.source_pad, route.source_stream];
    route.flags & ROUTE_ACTIVE != 0 && ends == [sink.index, 0, source.index, 0]
}

impl Wiring {
    /// Activates a route through each entity between the sensor and the node.
    ///
    /// # Errors
    /// [`CameraError`] that names the pad through which the stream enters the entity without a route.
    pub(super) fn set_routes(&mut self) -> Result<(), CameraError> {
        let links: Vec<Link> = self.route.links(&self.graph).copied().collect();
        for pair in links.windows(2) {
            let (sink, source) = (pair[0].sink, pair[1].source);
            let Some(before) = self.routes_of(sink) else { continue };
            if !before.iter().any(|route| connects(route, sink, source)) {
                self.activate(sink, source, before)?;
            }
        }
        Ok(())
    }

    /// Returns the routes of the entity of `pad`; `None` if its driver has none.
    fn routes_of(&mut self, pad: Pad) -> Option<Vec<PadRoute>> {
        let node = self.node(pad)?;
        let mut routes = Vec::new();
        persist(|| node.call(Call::GetRoutes(&mut routes))).ok().map(|()| routes)
    }

    /// Activates the route from `sink` to `source`: in addition to the other routes of the entity, or alone if the driver refuses both.
    fn activate(&mut self, sink: Pad, source: Pad, before: Vec<PadRoute>) -> Result<(), CameraError> {
        let ours = PadRoute {
            sink_pad: sink.index,
            source_pad: source.index,
            flags: ROUTE_ACTIVE,
            ..Default::default()
        };
        let is_other = |route: &PadRoute| {
            (route.sink_pad, route.sink_stream) != (sink.index, 0)
                && (route.source_pad, route.source_stream) != (source.index, 0)
        };
        let beside: Vec<PadRoute> = before.iter().copied().filter(is_other).chain([ours]).collect();
        self.routes.push(RoutesBefore { pad: sink, routes: before });
        let mut reason = "no such route".to_string();
        for mut routes in [beside, vec![ours]] {
            let Some(node) = self.node(sink) else { continue };
            match persist(|| node.call(Call::SetRoutes(&mut routes))) {
                Ok(()) if routes.iter().any(|route| connects(route, sink, source)) => return Ok(()),
                Ok(()) => {}
                Err(errno) => reason = errno.to_string(),
            }
        }
        let (from, to) = (self.graph.name(sink), self.graph.name(source));
        let found = format!("no route to pad {to} ({reason})");
        Err(self.unfit(&format!("pad {from}"), &found, "an active route between these pads"))
    }

    /// Sets the routes of each entity that were active before the change, which resets the formats of the pads.
    pub(super) fn restore_routes(&mut self) {
        for RoutesBefore { pad, mut routes } in std::mem::take(&mut self.routes) {
            if let Some(node) = self.node(pad) {
                let _ = persist(|| node.call(Call::SetRoutes(&mut routes)));
            }
        }
    }
}
