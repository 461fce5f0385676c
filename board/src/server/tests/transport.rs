//! The bytes of answers: compressed files, tags, a compressed stream, small pictures, and other forms of the map.

use super::*;
use crate::maps;
use flate2::read::{GzDecoder, MultiGzDecoder};
use futures_util::StreamExt;
use std::io::{Cursor, Read};

const GZIP: (&str, &str) = ("accept-encoding", "br, gzip");

fn unpacked(bytes: &[u8]) -> Vec<u8> {
    let mut all = Vec::new();
    GzDecoder::new(bytes).read_to_end(&mut all).expect("gzip");
    all
}

#[tokio::test]
async fn files_are_equal_with_and_without_compression_and_cached_by_tag() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    for path in ["/", "/page/app.js", "/page/style.css", "/client.js", "/three.js", "/openapi.json"] {
        let plain = fetch(&app, "GET", path, &[], "").await;
        let packed = fetch(&app, "GET", path, &[GZIP], "").await;
        assert_eq!((plain.status, plain.header("content-encoding")), (200, ""), "{path}");
        assert_eq!((packed.status, packed.header("content-encoding")), (200, "gzip"), "{path}");
        assert_eq!(packed.header("vary"), "accept-encoding", "{path}");
        assert_eq!(unpacked(&packed.body), plain.body, "{path}");
        assert!(2 * packed.body.len() < plain.body.len(), "{path}: {} bytes", packed.body.len());
        let again = fetch(&app, "GET", path, &[("if-none-match", plain.header("etag"))], "").await;
        assert_eq!((again.status, again.body.len()), (304, 0), "{path}");
    }
}

#[tokio::test]
async fn texts_are_those_of_the_source_folder() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    let files = ["index.html", "app.js", "style.css", "icon.svg"].map(|name| format!("page/{name}"));
    for name in files.into_iter().chain(["client.js", "three.js"].map(String::from)) {
        let path = if name == "page/index.html" { "/".into() } else { format!("/{name}") };
        let source = std::fs::read(format!("{}/src/server/{name}", env!("CARGO_MANIFEST_DIR")));
        assert_eq!(fetch(&app, "GET", &path, &[], "").await.body, source.expect("the source"), "{path}");
    }
}

/// Reads `response` until `count` sets have arrived; each part is decoded on arrival.
async fn streamed(response: Response, count: usize) -> (usize, String) {
    let mut body = response.into_body().into_data_stream();
    let (mut bytes, mut text) = (Vec::new(), String::new());
    while text.matches("data: ").count() < count {
        bytes.extend(body.next().await.expect("a part").expect("bytes"));
        let mut read = Vec::new();
        // The stream has no end: the decoder returns the data so far and then an error for the missing end.
        let _ = MultiGzDecoder::new(&bytes[..]).read_to_end(&mut read);
        text = String::from_utf8(read).expect("text");
        assert!(
            text.ends_with("\n\n"),
            "each part is complete: {:?}",
            &text[text.len().saturating_sub(40)..]
        );
    }
    (bytes.len(), text)
}

#[tokio::test]
async fn events_are_compressed_for_clients_that_accept_gzip() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    let request = Request::builder().uri("/v1/events").header("host", "localhost").header(GZIP.0, GZIP.1);
    let response =
        app.clone().oneshot(request.body(Body::empty()).expect("a request")).await.expect("an answer");
    assert_eq!(response.headers()["content-encoding"], "gzip");
    assert_eq!(response.headers()["content-type"], "text/event-stream");
    let (length, text) = streamed(response, 4).await;
    assert!(text.starts_with("retry: 1000\n\nid: "), "{}", &text[..60]);
    let sets: Vec<Value> = text
        .lines()
        .filter_map(|l| l.strip_prefix("data: "))
        .map(|json| serde_json::from_str(json).expect("a set"))
        .collect();
    let frames: Vec<_> = sets.iter().map(|set| set["frame"].as_u64().expect("a frame")).collect();
    assert!(frames.windows(2).all(|f| f[0] < f[1]), "{frames:?}");
    assert!(2 * length < text.len(), "{length} bytes of {}", text.len());
    let request = Request::builder().uri("/v1/events").header("host", "localhost");
    let plain = app.oneshot(request.body(Body::empty()).expect("a request")).await.expect("an answer");
    assert!(plain.headers().get("content-encoding").is_none(), "only where it is accepted");
}

#[tokio::test]
async fn exposures_are_reduced_to_the_requested_width() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    for (query, width) in [("", 640), ("?width=320", 320), ("?width=160", 160)] {
        let got = fetch(&app, "GET", &format!("/v1/image/2{query}"), &[], "").await;
        let picture = image::load_from_memory(&got.body).expect("a picture");
        assert_eq!((picture.width(), picture.height()), (width, width * 3 / 4), "{query}");
        assert_eq!(got.header("hemilux-exposures"), "3");
    }
    let (status, _, text) = get(&app, "/v1/image/2?width=161").await;
    assert_eq!((status, text.contains("160|320|640")), (400, true), "{text}");
}

fn read(bytes: Vec<u8>) -> maps::DecodedMap {
    let length = bytes.len() as u64;
    maps::read_from(Cursor::new(bytes), length, &maps::ReadOptions::default()).expect("a map")
}

/// Returns the irradiance, green channel, of a horizontal surface under a decoded map.
fn ground(map: &maps::DecodedMap) -> f64 {
    let lowest =
        if map.covers == maps::Covers::Sphere { std::f64::consts::PI } else { std::f64::consts::FRAC_PI_2 };
    let edge =
        |row: usize| (row as f64 * lowest / map.height as f64).min(std::f64::consts::FRAC_PI_2).sin().powi(2);
    let part =
        |i: usize| (edge(i / map.width + 1) - edge(i / map.width)) * std::f64::consts::PI / map.width as f64;
    map.texels.iter().enumerate().map(|(i, texel)| f64::from(texel[1]) * part(i)).sum()
}

#[tokio::test]
async fn maps_have_the_requested_form_and_the_irradiance_of_the_set() {
    // The lamps of the scene switch on and off: the source ends after one frame, so that all maps are of that
    // frame.
    let probe = probe(1);
    let app = routes(&probe);
    let set = loop {
        let (status, _, text) = get(&app, "/v1/lights").await;
        if status == 200 {
            break serde_json::from_str::<Value>(&text).expect("a set");
        }
    };
    let expected = set["horizontal_irradiance"][1].as_f64().expect("a number");
    let forms = [
        ("/v1/map.exr", 360, 180),
        ("/v1/map.hdr?covers=hemisphere", 360, 90),
        ("/v1/map.exr?width=512", 512, 256),
        ("/v1/map.hdr?width=128&covers=sphere", 128, 64),
        ("/v1/map.exr?width=1024&covers=hemisphere", 1024, 256),
    ];
    for (path, width, height) in forms {
        let got = fetch(&app, "GET", path, &[], "").await;
        assert_eq!(got.status, 200, "{path}: {}", String::from_utf8_lossy(&got.body));
        let map = read(got.body);
        assert_eq!((map.width, map.height), (width, height), "{path}");
        let found = ground(&map);
        assert!((found / expected - 1.0).abs() < 0.02, "{path}: {found}, expected {expected}");
    }
    for (path, width, height) in
        [("/v1/map.png?width=1024", 1024, 256), ("/v1/map.png?covers=sphere", 720, 360)]
    {
        let picture =
            image::load_from_memory(&fetch(&app, "GET", path, &[], "").await.body).expect("a picture");
        assert_eq!((picture.width(), picture.height()), (width, height), "{path}");
    }
}

#[tokio::test]
async fn the_map_as_jpeg_has_the_radiance_in_a_fifth_of_the_bytes() {
    let probe = probe(1);
    let app = routes(&probe);
    let (small, full) = loop {
        let small = fetch(&app, "GET", "/v1/map.jpg", &[], "").await;
        let full = fetch(&app, "GET", "/v1/map.hdr?covers=hemisphere", &[], "").await;
        if (small.status, full.status) == (200, 200) {
            break (small, full);
        }
    };
    assert!(5 * small.body.len() < full.body.len(), "{} of {} bytes", small.body.len(), full.body.len());
    let grey: f64 = small.header("hemilux-grey").parse().expect("a radiance");
    let picture = image::load_from_memory(&small.body).expect("a picture").into_rgb8();
    let map = read(full.body);
    let mut sums = [0.0, 0.0];
    for (texel, pixel) in map.texels.iter().zip(picture.pixels()) {
        let code = f64::from(pixel[1]);
        let found = grey * (code / (255.0 - code).max(0.5)).powi(2);
        let expected = f64::from(texel[1]);
        sums[0] += ((1.0 + found / grey).ln() - (1.0 + expected / grey).ln()).abs();
        sums[1] += 1.0;
    }
    assert!(sums[0] / sums[1] < 0.05, "off by {} in the mean", sums[0] / sums[1]);
}
