//! The paths of all requests of the server.

/// The paths of all requests, as `/openapi.json` writes them.
pub(super) const PATHS: [&str; 32] = [
    "/",
    "/page/{name}",
    "/info",
    "/change",
    "/data",
    "/xml",
    "/image",
    "/capture",
    "/screenshot",
    "/screenshots/{name}",
    "/login",
    "/lights.json",
    "/healthz",
    "/metrics",
    "/openapi.json",
    "/client.js",
    "/three.js",
    "/v1/lights",
    "/v1/events",
    "/v1/socket",
    "/v1/compare",
    "/v1/config",
    "/v1/calibration",
    "/v1/status",
    "/v1/source",
    "/v1/map.png",
    "/v1/map.jpg",
    "/v1/map.exr",
    "/v1/map.hdr",
    "/v1/mask.png",
    "/v1/xr",
    "/v1/image/{index}",
];

/// Returns the index in [`PATHS`] of the path of a request; `None` for an unknown path.
pub(super) fn index_of(path: &str) -> Option<usize> {
    PATHS.iter().position(|route| *route == path)
}
