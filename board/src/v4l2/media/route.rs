//! Routes through a media graph, from a sensor to a node that captures.

use super::graph::{Graph, Link, Pad};

/// Largest number of links of a route.
const MOST_LINKS: usize = 8;

/// Largest number of links that a search for routes follows in all, which bounds the search in a graph that
/// branches at each entity.
const MOST_STEPS: usize = 20_000;

/// Largest number of links that branch off a route.
const MOST_BRANCHES: usize = 16;

/// Largest number of routes that a search returns.
const MOST_ROUTES: usize = 32;

/// A route from a sensor to a capture node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Route {
    /// Indices of the links of the route among those of the graph, from the sensor on; at least one.
    pub links: Vec<usize>,
}

impl Route {
    /// Returns the links of the route.
    pub fn links<'a>(&'a self, graph: &'a Graph) -> impl Iterator<Item = &'a Link> {
        self.links.iter().filter_map(|at| graph.links.get(*at))
    }

    /// Returns the entity at the end of the route.
    #[must_use]
    pub fn end(&self, graph: &Graph) -> Option<usize> {
        self.links(graph).last().map(|link| link.sink.entity)
    }

    /// Returns the indices of the links that must be disabled while the route is used: other links of its pads, and links to other nodes
    /// from bridges that serve this sensor alone. A stream waits for a buffer on each linked node.
    #[must_use]
    pub fn rivals(&self, graph: &Graph, sensor: usize) -> Vec<usize> {
        let on = |pad: Pad| self.links(graph).any(|l| l.source == pad || l.sink == pad);
        let passes = |entity: usize| entity != sensor && self.links(graph).any(|l| l.source.entity == entity);
        let is_shared = |entity: usize| {
            let is_ours = |l: &Link| self.links(graph).any(|ours| ours.source.entity == l.source.entity);
            graph.links.iter().any(|l| l.enabled && l.sink.entity == entity && !is_ours(l))
        };
        let is_rival = |at: &usize| {
            let link = &graph.links[*at];
            let touches = on(link.source) || on(link.sink);
            let gives = passes(link.source.entity)
                && graph.entities.get(link.sink.entity).is_some_and(|e| e.is_video())
                && !is_shared(link.source.entity);
            link.enabled && !link.immutable && (touches || gives) && !self.links.contains(at)
        };
        (0..graph.links.len()).filter(is_rival).collect()
    }

    /// Returns the indices of the enabled links that branch off the route, the nearest to the sensor first. If such a link cannot be
    /// disabled, a stream starts only if the formats at both ends of the link agree.
    #[must_use]
    pub fn branches(&self, graph: &Graph) -> Vec<usize> {
        let mut found: Vec<usize> = Vec::new();
        let is_ours = |pad: Pad| self.links(graph).any(|l| l.source == pad);
        let mut at = 0;
        loop {
            let reached: Vec<usize> = found.iter().map(|l| graph.links[*l].sink.entity).collect();
            let next = (0..graph.links.len()).find(|l| {
                let link = &graph.links[*l];
                let branches = is_ours(link.source) || reached.contains(&link.source.entity);
                link.enabled && branches && !self.links.contains(l) && !found.contains(l)
            });
            at += 1;
            match next.filter(|_| at <= MOST_BRANCHES) {
                Some(link) => found.push(link),
                None => return found,
            }
        }
    }

    /// Returns the indices of the links of the route that are disabled and must be enabled.
    #[must_use]
    pub fn missing(&self, graph: &Graph) -> Vec<usize> {
        let is_off = |at: &usize| graph.links.get(*at).is_some_and(|link| !link.enabled);
        self.links.iter().copied().filter(is_off).collect()
    }
}

/// Returns all routes of `graph` from `sensor` to entities for which `ends` is true, sorted by length, then by
/// pad numbers.
#[must_use]
pub fn routes(graph: &Graph, sensor: usize, ends: &dyn Fn(usize) -> bool) -> Vec<Route> {
    let mut search = Search { graph, ends, steps: 0, path: Vec::new(), found: Vec::new() };
    search.from(sensor);
    let mut found = search.found;
    found.sort_by_key(|route| {
        let pads: Vec<_> = route.links(graph).map(|l| (l.source.index, l.sink.index)).collect();
        (route.links.len(), pads)
    });
    found.truncate(MOST_ROUTES);
    found
}

struct Search<'a> {
    graph: &'a Graph,
    ends: &'a dyn Fn(usize) -> bool,
    steps: usize,
    path: Vec<usize>,
    found: Vec<Route>,
}

impl Search<'_> {
    fn from(&mut self, entity: usize) {
        if self.path.len() >= MOST_LINKS {
            return;
        }
        for (at, link) in self.graph.links.iter().enumerate() {
            self.steps += 1;
            if self.steps > MOST_STEPS {
                return;
            }
            if link.source.entity != entity
                || (link.immutable && !link.enabled)
                || self.was_at(link.sink.entity)
            {
                continue;
            }
            self.path.push(at);
            let next = link.sink.entity;
            if (self.ends)(next) {
                self.found.push(Route { links: self.path.clone() });
            } else if self.graph.entities.get(next).is_some_and(|e| !e.is_video() && !e.is_sensor()) {
                self.from(next);
            }
            self.path.pop();
        }
    }

    fn was_at(&self, entity: usize) -> bool {
        self.path.iter().filter_map(|at| self.graph.links.get(*at)).any(|l| l.source.entity == entity)
    }
}
