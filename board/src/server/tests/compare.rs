//! `/v1/compare`: the light sets of two samplers for one frame, their scores, and refused requests.

use super::security::locked;
use super::*;
use crate::probe::compare::MOST_LIGHTS;

/// Repeats a request of `/v1/compare` until the answer has the light sets of both samplers, which may take long on a busy machine.
async fn compare(app: &Router, query: &str) -> Got {
    loop {
        let got = fetch(app, "GET", &format!("/v1/compare?{query}"), &[], "").await;
        if got.status != 503 {
            return got;
        }
    }
}

#[tokio::test]
async fn two_sets_of_the_same_frame_are_returned_with_their_scores() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    let mut last = None;
    for round in 0..4 {
        let after = last.map_or_else(String::new, |frame: u64| format!("&after={frame}"));
        let got = compare(&app, &format!("algorithm=q2tree&lights=40{after}")).await;
        let value = got.json();
        let frame = value["frame"].as_u64().expect("a frame");
        assert!(last.is_none_or(|last| frame > last), "a later one");
        let [first, second] = [0, 1].map(|i| &value["sets"][i]);
        assert_eq!(
            (first["frame"].as_u64(), second["frame"].as_u64()),
            (Some(frame), Some(frame)),
            "one frame"
        );
        assert_eq!((&first["sampler"], &second["sampler"]), (&"adaptive".into(), &"q2tree".into()));
        assert_eq!((&first["requested"], &second["requested"]), (&64.into(), &40.into()));
        assert_eq!(first["scalar_flux"], second["scalar_flux"], "of the same light");
        for (set, score) in [(first, &value["scores"][0]), (second, &value["scores"][1])] {
            assert_eq!(set["lights"].as_array().map(Vec::len), score["lights"].as_u64().map(|n| n as usize));
            assert_eq!(set["latency_us"]["sample"], score["sample_us"], "its own time");
            let ratio = |name: &str| score[name].as_f64().unwrap_or_else(|| panic!("{name}: {score}"));
            assert!(ratio("shadowed") > 1e-4 && ratio("shadowed") < 0.1 && ratio("energy") < 1e-3, "{score}");
            assert_eq!(
                score["flicker"].is_null(),
                last.map(|last| last + 1) != Some(frame),
                "round {round}: {score}"
            );
        }
        last = Some(frame);
    }
    // The comparison has not changed the light set of the probe's own sampler.
    let (_, _, text) = get(&app, "/v1/lights").await;
    assert!(text.contains("\"sampler\":\"adaptive\""), "{text}");
}

#[tokio::test]
async fn another_comparison_is_refused_until_the_first_has_no_requests() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    assert_eq!(compare(&app, "algorithm=q2tree").await.status, 200, "the first");
    let (status, _, text) = get(&app, "/v1/compare?algorithm=pharr&lights=9").await;
    assert!(status == 409 && text.contains("q2tree and 64 lights"), "{status}: {text}");
    assert_eq!(compare(&app, "algorithm=q2tree").await.status, 200, "the client in progress continues");
    tokio::time::sleep(Duration::from_millis(600)).await;
    let got = compare(&app, "algorithm=pharr&lights=9").await;
    assert!(got.status == 200 && got.text().contains("\"sampler\":\"pharr\""), "{}", got.text());
}

#[tokio::test]
async fn discs_are_compared_and_scored_as_discs() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    let value = compare(&app, "algorithm=adaptive&lights=16&soft=1").await.json();
    let ratio = |name: &str| value["scores"][1][name].as_f64().unwrap_or_else(|| panic!("{name}: {value}"));
    assert!(ratio("soft_shadowed") > 1e-4 && ratio("soft_shadowed") < 0.5 * ratio("shadowed"), "{value}");
    assert!(ratio("soft_open") > 1e-5 && ratio("soft_open") < ratio("open"), "{value}");
    let (status, _, text) = get(&app, "/v1/compare?algorithm=adaptive&lights=16").await;
    assert!(status == 409 && text.contains("adaptive and 16 discs"), "{status}: {text}");
}

#[tokio::test]
async fn samplers_that_read_another_map_or_order_are_compared() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    for name in ["hemigon", "hemigon-fir", "pharr", "adaptive", "q2tree-jitter"] {
        let got = compare(&app, &format!("algorithm={name}")).await.json();
        assert_eq!(got["sets"][1]["sampler"], name);
        assert!(got["scores"][1]["shadowed"].as_f64().is_some_and(|e| e < 0.2), "{name}: {}", got["scores"]);
        tokio::time::sleep(Duration::from_millis(520)).await;
    }
    let changed = patch(&app, "/v1/config", "{\"order\": 5}").await;
    assert_eq!(changed.status, 200, "{}", changed.text());
    let got = compare(&app, "algorithm=q2tree").await.json();
    assert!(got["scores"][1]["energy"].as_f64().is_some_and(|e| e < 1e-3), "{}", got["scores"]);
}

#[tokio::test]
async fn wrong_comparisons_and_requests_without_the_token_are_refused() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    let most = format!("algorithm=pharr&lights={}", MOST_LIGHTS + 1);
    for query in [
        "",
        "algorithm=guess",
        "algorithm=q2tree&lights=3",
        &most,
        "algorithm=pharr&lights=0",
        "lights=5",
        "algorithm=pharr&colour=red",
        "algorithm=pharr&algorithm=pharr",
        "algorithm=pharr&after=-1",
        "algorithm=pharr&soft=own",
    ] {
        let (status, _, text) = get(&app, &format!("/v1/compare?{query}")).await;
        assert!(status == 400 && text.contains("algorithm=adaptive|q2tree"), "{query}: {status} {text}");
    }
    let (status, ..) = get(&locked(&probe), "/v1/compare?algorithm=pharr").await;
    assert_eq!(status, 401, "it makes the board work");
}

#[tokio::test]
async fn a_stopped_source_returns_the_last_pair_as_stale() {
    let probe = probe(30);
    let app = routes(&probe);
    let began = std::time::Instant::now();
    loop {
        let got = compare(&app, "algorithm=pharr").await.json();
        let reason = got["sets"][1]["stale"]["reason"].clone();
        if reason == "<unplugged>" {
            return;
        }
        assert!(began.elapsed() < Duration::from_secs(30), "{reason}");
    }
}
