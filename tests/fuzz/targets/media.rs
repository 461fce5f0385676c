//! Fuzz target: the graph of a media device with arbitrary answers of its driver, and the routes through the graph.

#![no_main]

use hemilux::v4l2::media::{Device, Graph, Topology, abi, route};
use libfuzzer_sys::fuzz_target;

/// Largest number of entities, interfaces, pads or links.
const MOST: usize = 24;

/// A source of numbers from bytes; 0 after the last byte.
struct Numbers<'a>(std::slice::Iter<'a, u8>);

impl Numbers<'_> {
    /// Returns a small number, so that entries refer to each other, or an arbitrary number.
    fn next(&mut self) -> u32 {
        let mut byte = || u32::from(*self.0.next().unwrap_or(&0));
        match byte() {
            255 => byte() << 24 | byte() << 16 | byte() << 8 | byte(),
            small => small,
        }
    }

    fn entries<T>(&mut self, make: impl Fn(&mut Self) -> T) -> Vec<T> {
        let count = self.next() as usize % MOST;
        (0..count).map(|_| make(self)).collect()
    }
}

fn topology(numbers: &mut Numbers<'_>) -> Topology {
    let functions = [abi::SENSOR, abi::VIDEO, 0];
    let types = [abi::LINK_DATA, abi::LINK_INTERFACE, abi::LINK_ENABLED, abi::LINK_IMMUTABLE];
    Topology {
        entities: numbers.entries(|n| abi::Entity {
            id: n.next(),
            name: [n.next() as u8; 64],
            function: functions[n.next() as usize % functions.len()],
            ..abi::Entity::default()
        }),
        interfaces: numbers.entries(|n| abi::Interface {
            id: n.next(),
            device: [n.next(), n.next()],
            ..abi::Interface::default()
        }),
        pads: numbers.entries(|n| abi::Pad {
            id: n.next(),
            entity: n.next(),
            flags: n.next(),
            index: n.next(),
            ..abi::Pad::default()
        }),
        links: numbers.entries(|n| abi::Link {
            id: n.next(),
            source: n.next(),
            sink: n.next(),
            flags: n.next() | types[n.next() as usize % types.len()],
            ..abi::Link::default()
        }),
    }
}

fuzz_target!(|bytes: &[u8]| {
    let graph = Graph::of(&topology(&mut Numbers(bytes.iter())));
    for sensor in graph.sensors() {
        let is_end = |at: usize| graph.entities[at].is_video();
        for found in route::routes(&graph, sensor, &is_end) {
            assert!(found.end(&graph).is_some_and(is_end), "a route that ends elsewhere");
            let links = found.links(&graph).count();
            assert!(links > 0 && found.missing(&graph).len() <= links, "more missing links than links");
            let _ = (found.rivals(&graph, sensor), found.branches(&graph));
        }
        let _: Option<Device> = graph.entities[sensor].device;
    }
});
