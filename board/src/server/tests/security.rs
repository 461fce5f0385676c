//! Access control: tokens, requests of other sites, Host headers.

use super::*;

const SECRET: &str = "correct-horse-battery";
/// `:correct-horse-battery` and `anybody:correct-horse-battery`, encoded by `base64`.
const BASIC: [&str; 2] =
    ["Basic OmNvcnJlY3QtaG9yc2UtYmF0dGVyeQ==", "Basic YW55Ym9keTpjb3JyZWN0LWhvcnNlLWJhdHRlcnk="];
/// Requests that change state or return pictures.
const PROTECTED: [(&str, &str); 12] = [
    ("GET", "/change?samples=20"),
    ("GET", "/image"),
    ("GET", "/image?0"),
    ("GET", "/capture"),
    ("GET", "/screenshot"),
    ("GET", "/screenshots/x.png"),
    ("GET", "/v1/map.png"),
    ("GET", "/v1/map.exr"),
    ("GET", "/v1/map.hdr"),
    ("GET", "/v1/mask.png"),
    ("GET", "/v1/map.jpg"),
    ("PATCH", "/v1/config"),
];

/// Returns the routes of a probe that requires [`SECRET`].
pub(super) fn locked(probe: &Probe) -> Router {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("token");
    std::fs::write(&file, SECRET).expect("a file");
    let owner_alone = std::os::unix::fs::PermissionsExt::from_mode(0o600);
    std::fs::set_permissions(&file, owner_alone).expect("permissions");
    let token = Token::load_or_make(&file).expect("a token").token;
    let access = Access::with_token(token).expect("random numbers");
    app(probe.link(), Options { access, ..Options::default() }).router()
}

#[tokio::test]
async fn changes_and_pictures_require_the_token_and_other_requests_do_not() {
    let probe = probe(usize::MAX);
    let app = locked(&probe);
    let wrong = [
        "",
        "Bearer",
        "Bearer correct-horse-batterx",
        "Bearer correct-horse-batter",
        "Basic OmNvcnJlY3Q=",
        "Digest x",
    ];
    for (method, uri) in PROTECTED {
        // Each of the requests has its own allowance of wrong tokens.
        let app = locked(&probe);
        for given in wrong {
            let headers = [("authorization", given)];
            let headers = if given.is_empty() { &[][..] } else { &headers[..] };
            let got = fetch(&app, method, uri, headers, "{\"lights\": 20}").await;
            assert_eq!(got.status, 401, "{method} {uri} with {given:?}");
            assert!(
                got.header("www-authenticate").contains("Basic realm"),
                "{uri}: pictures in pages can ask"
            );
            assert_eq!(got.text().lines().count(), 1, "{uri}: {}", got.text());
        }
        let two = [("authorization", "Bearer correct-horse-battery"), ("authorization", "Bearer x")];
        assert_eq!(fetch(&app, method, uri, &two, "{}").await.status, 401, "{uri}: one header or none");
    }
    assert_eq!(probe.link().settings().applied().borrow().config, Config::steady(), "unchanged");
    for uri in [
        "/",
        "/info",
        "/change",
        "/data",
        "/v1/lights",
        "/v1/config",
        "/v1/xr",
        "/metrics",
        "/healthz",
        "/login",
    ] {
        assert_eq!(get(&app, uri).await.0, 200, "{uri}: for all");
    }
    // A token in a URL is ignored.
    assert_eq!(get(&app, &format!("/change?samples=20&token={SECRET}")).await.0, 401, "in a URL");
}

#[tokio::test]
async fn the_token_is_accepted_in_each_of_its_forms() {
    let probe = probe(usize::MAX);
    let app = locked(&probe);
    for given in ["Bearer correct-horse-battery", "bearer correct-horse-battery", BASIC[0], BASIC[1]] {
        for (method, uri) in PROTECTED.iter().filter(|(_, uri)| !uri.contains("screenshot")) {
            let got = fetch(&app, method, uri, &[("authorization", given)], "{\"lights\": 20}").await;
            assert_eq!(got.status, 200, "{method} {uri} with {given}");
        }
    }
    let form = [("content-type", "application/x-www-form-urlencoded"), ("origin", "http://localhost:8080")];
    for body in ["token=wrong", "token=", "", "token=correct-horse-battery&more=1", "%ff"] {
        let got = fetch(&app, "POST", "/login", &form, body).await;
        assert!(
            matches!(got.status, 400 | 401) && got.header("set-cookie").is_empty(),
            "{body:?}: {}",
            got.status
        );
    }
    let got = fetch(&app, "POST", "/login", &form, "token=correct-horse-battery").await;
    let cookie = got.header("set-cookie");
    assert_eq!((got.status, got.header("location")), (303, "/"), "logged in");
    assert!(cookie.contains("; HttpOnly") && cookie.contains("; SameSite=Strict"), "{cookie}");
    let pair = cookie.split(';').next().expect("a pair");
    assert!(!cookie.contains(SECRET) && pair.len() > 40, "the cookie is a secret of its own");
    let both = format!("other=1; {pair}");
    assert_eq!(ask(&app, "GET", "/v1/map.png", &[("cookie", &both)]).await.0, 200, "with the cookie");
    for wrong in ["hemilux=", &format!("hemilux={SECRET}"), &format!("x{pair}"), &pair[..pair.len() - 1]] {
        assert_eq!(ask(&app, "GET", "/v1/map.png", &[("cookie", wrong)]).await.0, 401, "{wrong}");
    }
    let foreign = [("cookie", pair), ("sec-fetch-site", "cross-site")];
    assert_eq!(
        ask(&app, "GET", "/v1/map.png", &foreign).await.0,
        403,
        "a page of another site has the cookie sent"
    );
    let elsewhere = [form[0], ("origin", "http://evil.example")];
    assert_eq!(
        fetch(&app, "POST", "/login", &elsewhere, "token=correct-horse-battery").await.status,
        403,
        "log-in"
    );
}

#[tokio::test]
async fn navigations_get_the_form_and_programs_get_a_challenge() {
    let probe = probe(usize::MAX);
    let app = locked(&probe);
    let got = fetch(&app, "GET", "/screenshot", &[("accept", "text/html,*/*;q=0.8")], "").await;
    assert_eq!(got.status, 401, "still refused");
    assert!(got.text().contains("<form action=\"/login\" method=\"post\">"), "{}", got.text());
    assert!(!got.header("www-authenticate").contains("Basic"), "no browser's box before the form");
}

#[tokio::test]
async fn other_sites_cannot_change_settings_or_get_pictures() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    for header in [
        ("origin", "http://evil.example"),
        ("referer", "http://evil.example/a"),
        ("sec-fetch-site", "cross-site"),
    ] {
        for (method, uri) in PROTECTED {
            assert_eq!(
                fetch(&app, method, uri, &[header], "{}").await.status,
                403,
                "{method} {uri} {header:?}"
            );
        }
        assert_eq!(ask(&app, "GET", "/change", &[header]).await.0, 200, "{header:?}: the form is shown");
    }
    let socket = [("origin", "http://evil.example"), ("upgrade", "websocket"), ("connection", "upgrade")];
    assert_eq!(ask(&app, "GET", "/v1/socket", &socket).await.0, 403, "a WebSocket");
    assert_eq!(probe.link().settings().applied().borrow().config, Config::steady(), "unchanged");
    assert_eq!(
        ask(&app, "GET", "/change?samples=20", &[("origin", "http://localhost:8080")]).await.0,
        200,
        "our own page"
    );
}

#[tokio::test]
async fn allowed_origins_are_served_and_others_are_refused() {
    let probe = probe(usize::MAX);
    let origins = vec!["http://studio.example:8000".to_owned()];
    let app = app(probe.link(), Options { origins, ..Options::default() }).router();
    let studio = ("origin", "http://studio.example:8000");
    let got = fetch(&app, "GET", "/v1/lights", &[studio, ("sec-fetch-site", "cross-site")], "").await;
    assert_eq!((got.status, got.header("access-control-allow-origin")), (200, studio.1), "may read");
    let vary = got.headers.get_all("vary").iter().filter_map(|v| v.to_str().ok());
    assert!(vary.flat_map(|v| v.split(", ")).any(|v| v.eq_ignore_ascii_case("origin")), "caches are told");
    let got = fetch(&app, "PATCH", "/v1/config", &[studio], "{\"lights\": 20}").await;
    assert_eq!(got.status, 200, "may change: {}", got.text());
    let preflight = [studio, ("access-control-request-method", "PATCH")];
    let got = fetch(&app, "OPTIONS", "/v1/config", &preflight, "").await;
    assert_eq!(
        (got.status, got.header("access-control-allow-methods")),
        (200, "GET,POST,PATCH"),
        "preflight"
    );
    let allowed = got.header("access-control-allow-headers").to_owned();
    for name in ["authorization", "content-type", "last-event-id"] {
        assert!(allowed.split(',').any(|given| given == name), "{name}: {allowed}");
    }
    for other in [
        "http://studio.example:8001",
        "http://studio.example",
        "null",
        "http://studio.example:8000.evil.example",
    ] {
        let got = fetch(&app, "GET", "/v1/lights", &[("origin", other)], "").await;
        assert_eq!(got.header("access-control-allow-origin"), "", "{other}");
        assert_eq!(got.header("cross-origin-resource-policy"), "same-origin", "{other}");
        let preflight = [("origin", other), ("access-control-request-method", "PATCH")];
        let got = fetch(&app, "OPTIONS", "/v1/config", &preflight, "").await;
        assert_eq!(got.header("access-control-allow-origin"), "", "{other}: the browser goes no further");
    }
}

#[tokio::test]
async fn guesses_of_the_token_are_limited_also_by_way_of_the_status() {
    let probe = probe(usize::MAX);
    let app = locked(&probe);
    let wrong = [("authorization", "Bearer correct-horse-batterx")];
    let right = [("authorization", "Bearer correct-horse-battery")];
    assert_eq!(fetch(&app, "GET", "/v1/status", &right, "").await.json()["allowed"], true, "at first");
    for _ in 0..5 {
        assert_eq!(fetch(&app, "GET", "/v1/map.png", &wrong, "").await.status, 401, "looked at");
        assert_eq!(
            fetch(&app, "GET", "/v1/status", &wrong, "").await.json()["allowed"],
            false,
            "counts as well"
        );
    }
    let got = fetch(&app, "GET", "/v1/map.png", &right, "").await;
    let wait: u64 = got.header("retry-after").parse().expect("seconds");
    assert!(got.status == 429 && (1..=3).contains(&wait), "not looked at: {} {wait}", got.status);
    assert_eq!(fetch(&app, "GET", "/v1/status", &right, "").await.json()["allowed"], false, "no oracle");
    let form = [("content-type", "application/x-www-form-urlencoded"), ("origin", "http://localhost:8080")];
    let got = fetch(&app, "POST", "/login", &form, "token=correct-horse-battery").await;
    assert_eq!(got.status, 429, "nor is the log-in");
    let (_, _, metrics) = get(&app, "/metrics").await;
    assert!(metrics.contains("hemilux_refused_total{reason=\"guessing\"} 2\n"), "{metrics}");
}

/// Headers of Chromium's requests over plain HTTP, to which it adds no Sec-Fetch-Site.
const BROWSER: [(&str, &str); 2] =
    [("user-agent", "Mozilla/5.0 (X11; Linux x86_64)"), ("accept", "text/html,*/*;q=0.8")];

#[tokio::test]
async fn a_browser_without_proof_gets_a_form_and_programs_are_served() {
    let probe = probe(usize::MAX);
    let config = || probe.link().settings().applied().borrow().config.clone();
    for app in [routes(&probe), locked(&probe)] {
        let got = fetch(&app, "GET", "/change?samples=20&gui=on", &BROWSER, "").await;
        assert_eq!(got.status, 403, "to be confirmed");
        for part in ["method=\"post\"", "name=\"samples\" value=\"20\"", "name=\"gui\" value=\"on\""] {
            assert!(got.text().contains(part), "{part}: {}", got.text());
        }
    }
    let app = locked(&probe);
    let remembered =
        [&BROWSER[..], &[("authorization", BASIC[0]), ("referer", "http://localhost:8080/")]].concat();
    assert_eq!(
        fetch(&app, "GET", "/change?samples=20", &remembered, "").await.status,
        403,
        "a link with Basic"
    );
    assert_eq!(config(), Config::steady(), "unchanged");
    let form = ("content-type", "application/x-www-form-urlencoded");
    for origin in ["http://evil.example", "null"] {
        let headers = [&remembered[..2], &[("authorization", BASIC[0]), form, ("origin", origin)]].concat();
        assert_eq!(fetch(&app, "POST", "/change", &headers, "samples=20").await.status, 403, "{origin}");
    }
    let own =
        [&BROWSER[..], &[("authorization", BASIC[0]), form, ("origin", "http://localhost:8080")]].concat();
    assert_eq!(fetch(&app, "POST", "/change", &own, "samples=20").await.status, 200, "confirmed");
    assert_eq!(config().pipeline.lights, 20, "changed");
    let curl = [("user-agent", "curl/8.14.1"), ("accept", "*/*"), ("authorization", BASIC[0])];
    assert_eq!(fetch(&app, "GET", "/change?samples=21", &curl, "").await.status, 200, "a program");
    let bearer = [&BROWSER[..], &[("authorization", "Bearer correct-horse-battery")]].concat();
    assert_eq!(
        fetch(&app, "GET", "/change?samples=22", &bearer, "").await.status,
        200,
        "calls itself Mozilla"
    );
    assert_eq!(config().pipeline.lights, 22, "changed");
}

#[tokio::test]
async fn unknown_hosts_are_refused() {
    let probe = probe(usize::MAX);
    let routes = routes(&probe);
    for uri in ["/", "/lights.json", "/change?samples=20", "/nothing", "/v1/config"] {
        assert_eq!(ask(&routes, "GET", uri, &[("host", "evil.example")]).await.0, 421, "{uri}");
        assert_eq!(ask(&routes, "GET", uri, &[("host", "10.0.0.1")]).await.0, 421, "{uri}");
        let two = [("host", "localhost"), ("host", "localhost")];
        assert_eq!(ask(&routes, "GET", uri, &two).await.0, 400, "{uri}");
    }
    let hosts = KnownHosts::of(([0, 0, 0, 0], 8080).into(), &["probe.lan".to_owned()]);
    let reachable = app(probe.link(), Options { hosts, ..Options::default() }).router();
    for (host, expected) in [("10.0.0.1:8080", 200), ("probe.lan", 200), ("evil.example", 421)] {
        assert_eq!(ask(&reachable, "GET", "/lights.json", &[("host", host)]).await.0, expected, "{host}");
    }
}

#[tokio::test]
async fn large_bodies_are_refused() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    let large = format!("{{\"lights\": {}20}}", " ".repeat(20_000));
    let told = large.len().to_string();
    let told = [("content-length", told.as_str())];
    assert_eq!(fetch(&app, "PATCH", "/v1/config", &told, &large).await.status, 413, "with its length");
    assert_eq!(fetch(&app, "POST", "/login", &told, &large).await.status, 413, "a form");
    assert_eq!(fetch(&app, "PATCH", "/v1/config", &[], &large).await.status, 400, "in pieces");
}
