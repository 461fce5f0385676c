//! Cameras of scripted media devices: the Pi 4's Unicam and both drivers of the Pi 5's receiver, with their media graphs.

use super::graph::{Graph, Topology};
use super::route::routes;
use super::{Device, abi};
use crate::v4l2::Size;
use crate::v4l2::capture::Camera;
use crate::v4l2::device;
use crate::v4l2::fake::graph::{Described, Mode, PadFault};
use crate::v4l2::fake::{FakeKernel, Kind, Script};
use crate::v4l2::frame::RawFrame;
use crate::v4l2::setup::Options;
use crate::v4l2::{Call, Kernel, Node};
use std::path::Path;
use std::time::Duration;

/// Graph of the Pi 4: all links are fixed.
const UNICAM: &str = "\
    imx219 10-0010:0 -> unicam-image:0 [on fixed]
    imx219 10-0010:1 -> unicam-embedded:0 [on fixed]";

/// Graph of the Pi 5 with the vendor's driver, in the state in which libcamera leaves it.
const CFE: &str = "\
    imx219 10-0010:0 -> csi2:0 [on fixed]
    imx219 10-0010:1 -> csi2:1 [on fixed]
    csi2:4 -> pisp-fe:0 [on]
    csi2:4 -> rp1-cfe-csi2_ch0:0 []
    csi2:5 -> rp1-cfe-embedded:0 [on]
    csi2:5 -> rp1-cfe-csi2_ch1:0 []
    pisp-fe:2 -> rp1-cfe-fe_image0:0 [on]";

/// Graph of the Pi 5 with the mainline driver, which has one sink and other entity names.
const MAINLINE: &str = "\
    imx219 10-0010:0 -> csi2:0 [on fixed]
    csi2:1 -> pisp-fe:0 [on]
    csi2:1 -> rp1-cfe-csi2-ch0:0 []
    csi2:2 -> rp1-cfe-csi2-ch1:0 []
    pisp-fe:2 -> rp1-cfe-fe-image0:0 [on]";

/// Returns the modes that the driver of the sensor imx219 lists.
fn modes() -> Vec<Mode> {
    vec![
        Mode { size: (3280, 2464), crop: [8, 8, 3280, 2464] },
        Mode { size: (1640, 1232), crop: [8, 8, 3280, 2464] },
        Mode { size: (640, 480), crop: [1008, 760, 1280, 960] },
    ]
}

fn described(links: &'static str, first_node: u32) -> Described {
    let inner = if links == MAINLINE { vec![(0, 1)] } else { vec![(0, 4), (1, 5), (0, 2)] };
    let native = Some([8, 8, 3280, 2464]);
    let codes = vec![0x3014, 0x300f];
    Described {
        links,
        inner,
        codes,
        modes: modes(),
        native,
        fault: None,
        routes: None,
        fixed_routes: false,
        first_node,
    }
}

fn script(graphs: Vec<Described>) -> Script {
    Script { kind: Kind::Csi, formats: vec!["pRAA"], graphs, ..Script::default() }
}

/// Returns the script of a Pi 4 with an imx219.
pub(crate) fn pi_4_script() -> Script {
    script(vec![described(UNICAM, 0)])
}

fn options(path: &str) -> Options {
    Options { exposures_s: vec![0.001, 0.006, 0.036], ..Options::of(path) }
}

/// Streams from the camera of `options` and returns the camera and the size of its frames.
fn stream(kernel: &mut FakeKernel, options: &Options) -> (Camera, (u32, u32)) {
    let mut camera = Camera::open(kernel, options).expect("a camera");
    let (mut frame, mut frames) = (RawFrame::default(), 0);
    while frames < 6 {
        frames += usize::from(camera.next(kernel, Duration::from_secs(1), &mut frame).expect("a frame"));
    }
    assert_eq!(frame.bytes.len(), camera.picture().layout.frame_bytes(), "a whole frame");
    let size = (camera.picture().width(), camera.picture().height());
    (camera, size)
}

#[test]
fn each_pi_receiver_is_set_to_the_full_view_and_restored() {
    for (name, links, nodes) in [
        ("unicam", UNICAM, ["imx219", "/dev/video1", "/dev/media0"]),
        ("cfe", CFE, ["imx219", "/dev/video3", "/dev/media0"]),
        ("mainline", MAINLINE, ["imx219 10", "/dev/video3", "/dev/media0"]),
    ] {
        for path in nodes {
            let mut kernel = FakeKernel::new(script(vec![described(links, 0)]));
            let before = kernel.world().boards[0].state();
            let (camera, size) = stream(&mut kernel, &options(path));
            assert_eq!(size, (1640, 1232), "{name} by {path}");
            let during = kernel.world().boards[0].state();
            assert_ne!(during.1, before.1, "{name}: formats were set");
            drop(camera);
            assert_eq!(kernel.world().boards[0].state(), before, "{name} by {path}: links and formats");
            assert_eq!(kernel.held(), (0, 0), "{name}: all closed");
        }
    }
}

#[test]
fn the_links_of_the_vendors_receiver_are_switched_and_embedded_data_matches() {
    let mut kernel = FakeKernel::new(script(vec![described(CFE, 20)]));
    let (_camera, _) = stream(&mut kernel, &options("imx219"));
    let world = kernel.world();
    let on: Vec<bool> = world.boards[0].state().0.iter().map(|f| f & abi::LINK_ENABLED != 0).collect();
    assert_eq!(on, [true, true, false, true, false, false, true], "ch0 alone waits for buffers");
}

/// In each graph, each pad in turn keeps its size, keeps its code or refuses formats: a pad of the route is named in the error, a pad outside of
/// the route has no effect.
#[test]
fn a_wrong_pad_is_named_with_the_expected_format() {
    for (links, on_route) in [
        (UNICAM, &["imx219 10-0010:0"][..]),
        (CFE, &["imx219 10-0010:0", "csi2:0", "csi2:1", "csi2:4"]),
        (MAINLINE, &["imx219 10-0010:0", "csi2:0", "csi2:1"]),
    ] {
        let ends = |line: &'static str| line.split_once('[').expect("flags").0.split("->").map(str::trim);
        let mut pads: Vec<&'static str> = links.lines().flat_map(ends).collect();
        pads.retain(|pad| !pad.starts_with("rp1") && !pad.starts_with("unicam"));
        pads.sort_unstable();
        pads.dedup();
        for pad in pads {
            for fault in [PadFault::Size, PadFault::Code, PadFault::Refused] {
                let wrong = Described { fault: Some((pad, fault)), ..described(links, 0) };
                let mut kernel = FakeKernel::new(script(vec![wrong]));
                let before = kernel.world().boards[0].state();
                match Camera::open(&mut kernel, &options("imx219")) {
                    Ok(camera) => {
                        assert!(!on_route.contains(&pad), "{pad} {fault:?}: opened");
                        assert_eq!(camera.picture().camera_size(), Size::new(1640, 1232), "{pad} {fault:?}");
                    }
                    Err(error) => assert_names(&error.to_string(), pad, fault, on_route),
                }
                assert_eq!(kernel.world().boards[0].state().0, before.0, "{pad}: links restored");
                assert_eq!(kernel.held(), (0, 0), "{pad}: all closed");
            }
        }
    }
}

/// Checks that an error names the pad, the found format and the expected one.
fn assert_names(line: &str, pad: &str, fault: PadFault, on_route: &[&str]) {
    assert!(on_route.contains(&pad), "{pad} is not on the route: {line}");
    let found = match fault {
        PadFault::Size => "found 640 x 480 of media bus code 0x",
        PadFault::Code => "of media bus code 0x1234",
        PadFault::Refused => "found Invalid argument",
    };
    assert!(line.starts_with(&format!("/dev/media0, pad {pad}: found ")) && line.contains(found), "{line}");
    let expected = if pad == "csi2:1" && on_route.contains(&"csi2:4") { "1640 x 1" } else { "1640 x 1232" };
    assert!(line.contains(&format!("expected {expected} of media bus code 0x")), "{line}");
}

#[test]
fn a_node_that_keeps_another_size_is_named_with_the_expected_size() {
    for (links, node) in [(UNICAM, "unicam-image:0"), (CFE, "rp1-cfe-csi2_ch0:0")] {
        let wrong = Described { fault: Some((node, PadFault::Size)), ..described(links, 0) };
        let mut kernel = FakeKernel::new(script(vec![wrong]));
        let Err(error) = Camera::open(&mut kernel, &options("imx219")) else { panic!("{node} is wrong") };
        let line = error.to_string();
        assert!(
            line.contains("found a node of 640 x 480 pixels, expected 1640 x 1232 as its sensor sends"),
            "{line}"
        );
    }
}

/// The mainline driver has streams: a route that another program left on the second channel is replaced and restored.
#[test]
fn a_route_inside_the_receiver_is_set_and_restored() {
    for (before, during) in
        [(vec![(0, 2)], vec![(0, 1)]), (vec![], vec![(0, 1)]), (vec![(0, 1)], vec![(0, 1)])]
    {
        let graph = Described { routes: Some(before.clone()), ..described(MAINLINE, 0) };
        let mut kernel = FakeKernel::new(script(vec![graph]));
        let state = kernel.world().boards[0].state();
        let (camera, size) = stream(&mut kernel, &options("imx219"));
        assert_eq!(size, (1640, 1232), "{before:?}");
        assert_eq!(kernel.world().boards[0].described.routes, Some(during), "{before:?}");
        drop(camera);
        assert_eq!(kernel.world().boards[0].described.routes, Some(before.clone()), "restored");
        assert_eq!(kernel.world().boards[0].state().0, state.0, "{before:?}: links restored");
    }
}

#[test]
fn the_channel_of_a_fixed_route_is_used() {
    let links = "\
        imx219 10-0010:0 -> csi2:0 [on fixed]
        csi2:1 -> rp1-cfe-csi2-ch0:0 []
        csi2:2 -> rp1-cfe-csi2-ch1:0 []";
    let graph = Described { routes: Some(vec![(0, 2)]), fixed_routes: true, ..described(links, 0) };
    let mut kernel = FakeKernel::new(script(vec![graph]));
    let (_camera, size) = stream(&mut kernel, &options("imx219"));
    assert_eq!(size, (1640, 1232), "through the second channel");
}

#[test]
fn a_route_that_cannot_be_set_is_named() {
    let links = "\
        imx219 10-0010:0 -> csi2:0 [on fixed]
        csi2:1 -> rp1-cfe-csi2-ch0:0 []
        csi2:2 -> pisp-fe:0 [on]";
    let graph = Described { routes: Some(vec![(0, 2)]), fixed_routes: true, ..described(links, 0) };
    let mut kernel = FakeKernel::new(script(vec![graph]));
    let before = kernel.world().boards[0].state();
    let Err(error) = Camera::open(&mut kernel, &options("imx219")) else { panic!("no route") };
    let expected = "/dev/media0, pad csi2:0: found no route to pad csi2:1 (Invalid argument (os error 22)), \
                    expected an active route between these pads";
    assert_eq!(error.to_string(), expected, "one line");
    assert_eq!(kernel.world().boards[0].state(), before, "restored");
    assert_eq!(kernel.held(), (0, 0), "all closed");
}

/// As in the kernel's vimc driver, the sensor also feeds a second node next to the bridge by a fixed link.
#[test]
fn a_branch_that_cannot_be_switched_off_gets_the_format_too() {
    let links = "\
        imx219 10-0010:0 -> csi2:0 [on fixed]
        imx219 10-0010:0 -> rp1-cfe-raw:0 [on fixed]
        csi2:4 -> rp1-cfe-csi2_ch0:0 []";
    let mut kernel = FakeKernel::new(script(vec![described(links, 0)]));
    let before = kernel.world().boards[0].state();
    let graph = {
        let mut topology = Topology::default();
        kernel.world().boards[0].topology(&mut topology);
        Graph::of(&topology)
    };
    let ends = |entity: usize| graph.entities[entity].name == "rp1-cfe-csi2_ch0";
    let route = &routes(&graph, 0, &ends)[0];
    assert_eq!(route.branches(&graph), [1], "the raw node");
    let (camera, size) = stream(&mut kernel, &options("/dev/video3"));
    assert_eq!(size, (1640, 1232), "through the bridge");
    drop(camera);
    assert_eq!(kernel.world().boards[0].state(), before, "restored");
}

#[test]
fn two_sensors_of_one_board_are_separate_cameras() {
    let other = "\
        imx477 4-001a:0 -> csi2:0 [on fixed]
        csi2:4 -> rp1-cfe-csi2_ch0:0 []";
    let second = Described {
        modes: vec![Mode { size: (2028, 1520), crop: [0, 0, 4056, 3040] }],
        native: Some([0, 0, 4056, 3040]),
        ..described(other, 40)
    };
    let of = |path: &str| {
        let mut kernel = FakeKernel::new(script(vec![described(CFE, 0), second.clone()]));
        stream(&mut kernel, &options(path)).1
    };
    assert_eq!([of("imx219"), of("imx477")], [(1640, 1232), (2028, 1520)], "by name");
    assert_eq!([of("/dev/media0"), of("/dev/media1")], [(1640, 1232), (2028, 1520)], "by media device");
    assert_eq!([of("/dev/video3"), of("/dev/video42")], [(1640, 1232), (2028, 1520)], "by node");
    let mut kernel = FakeKernel::new(script(vec![described(CFE, 0), second.clone()]));
    let Err(error) = Camera::open(&mut kernel, &options("imx")) else { panic!("two") };
    let line = error.to_string();
    assert!(
        line.contains("found the sensors imx219 10-0010 and imx477 4-001a, expected sensor=NAME"),
        "{line}"
    );
    let Err(error) = Camera::open(&mut kernel, &options("imx708")) else { panic!("none") };
    assert!(error.to_string().starts_with("imx708: found no such sensor"), "{error}");
}

#[test]
fn devices_lists_one_node_for_each_sensor() {
    let mut kernel = FakeKernel::new(script(vec![described(CFE, 0), described(UNICAM, 30)]));
    let cameras = device::list(&mut kernel).expect("cameras");
    let paths: Vec<_> = cameras.iter().map(|c| c.path.to_str().unwrap_or_default()).collect();
    assert_eq!(paths, ["/dev/video3", "/dev/video31"], "not the nodes of statistics and embedded data");
    assert!(cameras.iter().all(|c| c.sensor_name.as_deref() == Some("imx219 10-0010")), "{cameras:?}");
    let shares: Vec<_> = cameras[0].modes.iter().map(|m| (m.width, m.share)).collect();
    assert_eq!(shares[..2], [(3280, Some(1.0)), (1640, Some(1.0))], "all of the sensor");
    assert!(shares[2].0 == 640 && shares[2].1.is_some_and(|s| (s - 0.152).abs() < 1e-3), "{shares:?}");
    assert_eq!(kernel.held(), (0, 0), "all closed");
}

#[test]
fn the_view_comes_from_the_driver_or_else_from_the_table() {
    for native in [Some([8, 8, 3280, 2464]), None] {
        let graph = Described { native, ..described(UNICAM, 0) };
        let of = |options: &Options| {
            let (camera, _) = stream(&mut FakeKernel::new(script(vec![graph.clone()])), options);
            camera.view().expect("a view")
        };
        let full = of(&options("imx219"));
        assert_eq!((full.crop, full.binning, full.share()), ([0, 0, 3280, 2464], [2, 2], 1.0), "{native:?}");
        let small = of(&Options { size: Size::new(640, 480), full_view: false, ..options("imx219") });
        assert_eq!((small.crop, small.binning), ([1000, 752, 1280, 960], [2, 2]), "{native:?}");
    }
}

/// A driver's topology with unknown numbers, loops, and links in the wrong direction.
#[test]
fn a_hostile_topology_yields_no_false_route() {
    let kernel = FakeKernel::new(script(vec![described(CFE, 0)]));
    let mut topology = Topology::default();
    kernel.world().boards[0].topology(&mut topology);
    let mut random = 1u64;
    let mut next = move |below: u32| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((random >> 33) as u32) % below.max(1)
    };
    for round in 0..3000 {
        let mut mangled = topology.clone();
        for _ in 0..1 + round % 8 {
            let value = if next(2) == 0 { next(1000) } else { u32::MAX - next(4) };
            let (pad, link) = (next(mangled.pads.len() as u32), next(mangled.links.len() as u32));
            let (pad, link) = (pad as usize, link as usize);
            let fields: [&mut u32; 7] = {
                let (p, l) = (&mut mangled.pads[pad], &mut mangled.links[link]);
                [
                    &mut p.id,
                    &mut p.entity,
                    &mut p.flags,
                    &mut p.index,
                    &mut l.source,
                    &mut l.sink,
                    &mut l.flags,
                ]
            };
            *fields.into_iter().nth(next(7) as usize).expect("one") = value;
        }
        let graph = Graph::of(&mangled);
        for link in &graph.links {
            assert!(
                link.source.entity < graph.entities.len() && link.sink.entity < graph.entities.len(),
                "inside"
            );
        }
        for sensor in graph.sensors().collect::<Vec<_>>() {
            let nodes = |entity: usize| graph.entities[entity].is_video();
            for route in routes(&graph, sensor, &nodes) {
                let links: Vec<_> = route.links(&graph).copied().collect();
                assert_eq!(links[0].source.entity, sensor, "from the sensor");
                assert!(links.windows(2).all(|l| l[0].sink.entity == l[1].source.entity), "connected");
                let _ = (route.rivals(&graph, sensor), route.missing(&graph));
            }
        }
    }
}

/// Thirty layers of thirty bridges, each linked to each bridge of the next layer: 30^30 routes.
#[test]
fn the_search_is_bounded_in_a_graph_with_many_branches() {
    let mut topology = Topology::default();
    let wide = 5u32;
    let entity = |id, function| abi::Entity { id, function, ..Default::default() };
    topology.entities.push(entity(1, abi::SENSOR));
    for id in 2..200 {
        topology.entities.push(entity(id, 0));
    }
    for id in 1..200 {
        let both = abi::PAD_SINK | abi::PAD_SOURCE;
        topology.pads.push(abi::Pad { id, entity: id, flags: both, ..Default::default() });
    }
    for from in 1..195u32 {
        let layer = (from + wide - 2) / wide * wide + 2;
        for sink in layer..(layer + wide).min(200) {
            topology.links.push(abi::Link {
                source: from,
                sink,
                flags: abi::LINK_ENABLED,
                ..Default::default()
            });
        }
    }
    let graph = Graph::of(&topology);
    let began = std::time::Instant::now();
    let found = routes(&graph, 0, &|entity| entity > 20);
    assert!(found.len() <= 32 && began.elapsed() < Duration::from_secs(1), "{} routes", found.len());
}

/// The test has a media device without entities, for which no camera is reported.
#[test]
fn a_node_without_a_media_graph_is_opened_directly() {
    let mut kernel = FakeKernel::new(Script::default());
    assert_eq!(kernel.device_of(Path::new("/dev/video0")), None::<Device>, "no media device");
    let camera = Camera::open(&mut kernel, &Options { size: Size::new(64, 48), ..options("/dev/video0") });
    assert!(camera.is_ok(), "a UVC camera");
    let mut node: Box<dyn Node> = kernel.open(Path::new("/dev/video0")).expect("a node");
    assert!(node.call(Call::Topology(&mut Topology::default())).is_err(), "not a media device");
}
