//! `/v1/compare`: the probe's own light set and that of a second sampler for the same frame. The request requires the token, since a second
//! sampler costs processing time; one second sampler runs at a time for all clients.

use super::access::Allowed;
use super::answer::{Answer, LONGEST_WAIT};
use super::lights::no_frame_yet;
use super::sets::thin;
use super::{Context, line};
use crate::judge::{Judge, Lit, Score};
use crate::light_set::OwnedSet;
use crate::probe::compare::{Contender, MOST_LIGHTS, Pair};
use crate::probe::settings::short;
use crate::samplers;
use axum::extract::{Query, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE, RETRY_AFTER};
use axum::http::{HeaderValue, StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use hemilux_core::SamplerKind;
use hemilux_core::healpix::Domain;
use hemilux_core::wire::{self, Coordinates, LightSet, Stale};
use serde_json::json;
use std::sync::Arc;

/// Computes the scores of each pair of light sets once for all requests; locked during the computation.
#[derive(Default)]
pub(super) struct ComparisonScores(Arc<tokio::sync::Mutex<ScoreState>>);

#[derive(Default)]
struct ScoreState {
    judge: Judge<2>,
    /// The second sampler and the frame number to which `scores` belong.
    key: Option<(Contender, u64)>,
    scores: [Score; 2],
}

impl ScoreState {
    fn scores(&mut self, pair: &Pair) -> [Score; 2] {
        let key = Some((pair.contender, pair.first.frame));
        if self.key != key {
            if self.key.is_some_and(|(contender, _)| contender != pair.contender) {
                self.judge = Judge::default();
            }
            let sets = [lit(&pair.first), lit(&pair.second.set)];
            self.scores = self.judge.judge(pair.first.frame, &pair.second.sketch, sets);
            self.key = key;
        }
        self.scores
    }
}

fn lit(set: &OwnedSet) -> Lit<'_> {
    Lit { lights: &set.lights, ambient: set.ambient_sh.as_ref() }
}

/// The query parameters of `/v1/compare`.
struct ComparisonQuery {
    contender: Contender,
    coordinates: Coordinates,
    after: Option<u64>,
}

/// Lists the query parameters of `/v1/compare` and their permitted values, one per line.
fn accepted() -> String {
    let coordinates = Coordinates::names().collect::<Vec<_>>().join("|");
    let names = SamplerKind::NAMES.join("|");
    format!("algorithm={names}\nlights=1..{MOST_LIGHTS}\nsoft=0|1\ncoordinates={coordinates}\nafter=FRAME")
}

fn wanted(uri: &Uri) -> Result<ComparisonQuery, String> {
    let Ok(Query(pairs)) = Query::<Vec<(String, String)>>::try_from_uri(uri) else {
        return Err("a query that cannot be parsed".into());
    };
    let (mut sampler, mut lights, mut soft) = (None, 64, false);
    let (mut coordinates, mut after) = (Coordinates::Probe, None);
    for (i, (name, value)) in pairs.iter().enumerate() {
        if pairs[..i].iter().any(|(n, _)| n == name) {
            return Err(format!("parameter '{}' twice", short(name)));
        }
        let known = match name.as_str() {
            "algorithm" => value.parse().ok().map(|kind| sampler = Some(kind)),
            "lights" => value.parse().ok().filter(|n| (1..=MOST_LIGHTS).contains(n)).map(|n| lights = n),
            "soft" => ["0", "1"].iter().position(|v| v == value).map(|i| soft = i == 1),
            "coordinates" => Coordinates::from_name(value).map(|c| coordinates = c),
            "after" => value.parse().ok().map(|n| after = Some(n)),
            _ => return Err(format!("unknown parameter '{}'", short(name))),
        };
        known.ok_or_else(|| format!("{name} '{}'", short(value)))?;
    }
    let sampler = sampler.ok_or("no algorithm")?;
    let contender = Contender { sampler, lights, soft };
    samplers::check(sampler, Domain::Hemisphere, &contender.request()).map_err(|e| e.to_string())?;
    Ok(ComparisonQuery { contender, coordinates, after })
}

/// Answers with the two light sets of the next frame and their scores.
pub(super) async fn compare(State(context): State<Context>, _: Allowed, uri: Uri) -> Response {
    let ComparisonQuery { contender, coordinates, after } = match wanted(&uri) {
        Ok(wanted) => wanted,
        Err(found) => {
            return line(StatusCode::BAD_REQUEST, &format!("found {found}. Accepted:\n{}", accepted()));
        }
    };
    let link = &context.link;
    let _permit = match link.comparison().ask(contender) {
        Ok(permit) => permit,
        Err(other) => return taken(other),
    };
    let mut pairs = link.comparison().pairs();
    let begun = pairs.borrow_and_update().as_ref().map(|pair| pair.first.frame).filter(|_| after.is_none());
    let fits = |pair: &Option<Pair>| {
        let frame = pair.as_ref().filter(|p| p.contender == contender).map(|p| p.first.frame);
        frame.is_some_and(|frame| Some(frame) != after && Some(frame) != begun)
    };
    let waited = tokio::time::timeout(LONGEST_WAIT, pairs.wait_for(fits)).await;
    let is_late = !matches!(waited, Ok(Ok(_)));
    drop(waited);
    let pair = pairs.borrow().clone().filter(|pair| pair.contender == contender);
    let Some(pair) = pair else { return no_pair_yet(&context) };
    let answer = Answer::of(link, Arc::clone(&pair.first), is_late);
    let bench = Arc::clone(&context.answers.scores.0).lock_owned().await;
    let work = move || written(bench, &pair, answer.stale.as_ref(), coordinates);
    match tokio::task::spawn_blocking(work).await {
        Ok(Some(text)) => {
            let head = [
                (CONTENT_TYPE, HeaderValue::from_static("application/json")),
                (CACHE_CONTROL, HeaderValue::from_static("no-store")),
            ];
            (head, text).into_response()
        }
        _ => line(StatusCode::INTERNAL_SERVER_ERROR, "the light sets could not be encoded"),
    }
}

fn no_pair_yet(context: &Context) -> Response {
    if context.link.sets().latest().is_none() {
        return no_frame_yet(&context.link);
    }
    let mut response = line(StatusCode::SERVICE_UNAVAILABLE, "no pair yet: no frame since the request");
    response.headers_mut().insert(RETRY_AFTER, HeaderValue::from_static("1"));
    response
}

/// Returns the refusal of a comparison while clients compare with `other`.
fn taken(other: Contender) -> Response {
    let Contender { sampler, lights, soft } = other;
    let lights = if soft { format!("{lights} discs") } else { format!("{lights} lights") };
    let text = format!("found a comparison with {sampler} and {lights}, expected none: one at a time");
    let mut response = line(StatusCode::CONFLICT, &text);
    response.headers_mut().insert(RETRY_AFTER, HeaderValue::from_static("1"));
    response
}

/// Returns the text of the answer to `/v1/compare`; `None` only for a programming error.
fn written(
    mut bench: tokio::sync::OwnedMutexGuard<ScoreState>,
    pair: &Pair,
    stale: Option<&Stale<String>>,
    coordinates: Coordinates,
) -> Option<Vec<u8>> {
    let scores = bench.scores(pair);
    drop(bench);
    let sets = [&*pair.first, &pair.second.set];
    let OwnedSet { run, frame, .. } = &*pair.first;
    let mut text = format!("{{\"version\":1,\"run\":\"{run}\",\"frame\":{frame},\"sets\":[").into_bytes();
    for (i, set) in sets.into_iter().enumerate() {
        let mut on_wire = LightSet { stale: stale.map(Stale::view), coordinates, ..set.view() };
        let thinned;
        if set.lights.len() > MOST_LIGHTS {
            thinned = thin(&set.lights, MOST_LIGHTS)?;
            on_wire.lights = &thinned;
        }
        text.extend_from_slice(if i == 0 { b"" } else { b"," });
        wire::json(&on_wire, &mut text).ok()?;
    }
    let score = |(score, set): (Score, &OwnedSet)| {
        let Score { open, shadowed, soft_open, soft_shadowed, energy, flicker } = score;
        json!({"lights": set.lights.len(), "open": open, "shadowed": shadowed, "soft_open": soft_open,
            "soft_shadowed": soft_shadowed, "energy": energy, "flicker": flicker,
            "estimated_error": set.estimated_error, "sample_us": set.latency.sample})
    };
    let scores: Vec<_> = scores.into_iter().zip(sets).map(score).collect();
    text.extend_from_slice(format!("],\"scores\":{}}}\n", json!(scores)).as_bytes());
    Some(text)
}
