//! The HTML pages. Text from requests, sources and files is escaped.

use super::Context;
use crate::light_set::OwnedSet;
use crate::probe::settings::{Kind, SETTINGS, Setting};
use crate::probe::{Config, extrapolation_name};
use crate::timing::Timings;
use axum::extract::State;
use axum::http::header::CACHE_CONTROL;
use axum::response::{Html, IntoResponse, Response};
use hemilux_core::color::luminance;
use hemilux_core::wire::Latency;
use std::fmt::Write;

const STYLE: &str = "<style>:root{color-scheme:light dark}body{font:16px/1.5 system-ui,sans-serif;max-width:44rem;\
margin:2rem auto;padding:0 1rem}td,th{text-align:left;padding:.1rem 1rem .1rem 0;vertical-align:top}\
label{display:block;margin:.6rem 0}</style>";

/// Answers with the settings, rates and durations of the probe.
pub(super) async fn info(State(context): State<Context>) -> Response {
    let link = &context.link;
    let config = link.settings().applied().borrow().config.clone();
    let latest = link.sets().latest();
    let mut rows = vec![
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("run", link.run().to_owned()),
        ("source", link.source().to_owned()),
        ("fault", link.status().failure().unwrap_or_else(|| "none".into())),
        ("running for", format!("{} s", link.started().elapsed().as_secs())),
    ];
    rows.extend(settings(&config));
    let exposures = link.settings().exposures().seconds.iter().map(|s| duration(*s)).collect::<Vec<_>>();
    rows.push(("exposures", exposures.join(", ")));
    let timings = link.durations().timings();
    match &latest {
        Some(set) => rows.extend(measured(set, link.staleness(set).age_ms, timings.rate_hz())),
        None => rows.push(("frames", "none yet".into())),
    }
    let times = latest.map_or_else(String::new, |set| times(&set.latency, &timings));
    let body = format!("{}{times}<p><a href=\"/change\">Change the settings</a></p>", table(&rows));
    ([(CACHE_CONTROL, "no-store")], page("info", &body)).into_response()
}

/// Formats a time of `seconds` with three digits in s, ms or us.
fn duration(seconds: f64) -> String {
    let (value, unit) = match seconds {
        s if s >= 1.0 => (s, "s"),
        s if s >= 1e-3 => (1e3 * s, "ms"),
        s => (1e6 * s, "us"),
    };
    let digits = (2 - value.max(1e-9).log10().floor() as i32).clamp(0, 9) as usize;
    let text = format!("{value:.digits$}");
    let short = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    format!("{short} {unit}")
}

type Row = (&'static str, String);

fn settings(config: &Config) -> [Row; 5] {
    let s = &config.pipeline;
    let grid = format!("{} x {}", s.grid.width, s.grid.height);
    [
        ("algorithm", s.sampler.to_string()),
        ("samples", s.lights.to_string()),
        ("extrapolation", extrapolation_name(s.extrapolation).into()),
        ("gui", on_off(config.gui).into()),
        ("polar map", grid),
    ]
}

fn measured(set: &OwnedSet, age_ms: u64, rate_hz: f32) -> Vec<Row> {
    let percent = |v: f32| format!("{:.2} % of the hemisphere", 100.0 * v);
    vec![
        ("frames", (set.frame + 1).to_string()),
        ("frame rate", format!("{rate_hz:.2} a second")),
        ("last frame", format!("{age_ms} ms ago")),
        ("lights", set.lights.len().to_string()),
        ("clipped", percent(set.clipped)),
        ("unseen", percent(set.unseen)),
        ("horizontal illuminance", light(set, set.horizontal_irradiance)),
        ("scalar flux, without a cosine", light(set, set.scalar_flux)),
    ]
}

/// Returns the luminance of `rgb` as text: in lux with its uncertainty where the unit is known, else as a
/// relative value.
fn light(set: &OwnedSet, rgb: [f32; 3]) -> String {
    let y = luminance(rgb);
    match set.unit_uncertainty {
        Some(uncertainty) => format!("{y:.1} lux within {:.1} %", 100.0 * uncertainty),
        None => format!("{y:.4} (relative)"),
    }
}

/// Returns an HTML table of the last durations, percentiles and budgets of the stages.
fn times(last: &Latency, timings: &Timings) -> String {
    let head = ["last", "p50", "p95", "p99", "longest", "budget", "over it"].map(|t| format!("<th>{t}</th>"));
    let mut html = format!("<h2>Times, ms</h2><table><tr><th></th>{}</tr>", head.concat());
    for ((name, us), s) in Latency::NAMES.iter().zip(last.all()).zip(timings.stages()) {
        let _ = write!(html, "<tr><th>{name}</th>");
        for us in [us, s.p50, s.p95, s.p99, s.most, s.budget] {
            let _ = write!(html, "<td>{:.3}</td>", f64::from(us) / 1e3);
        }
        let _ = write!(html, "<td>{} of {} frames</td></tr>", s.overruns, timings.frames());
    }
    html + "</table><p>Capture includes the wait for a burst, encode is that of the frame before, total begins with the end of the burst.</p>"
}

/// Returns the page with the form of the settings, and `accepted`: the parameters of `/change` and their
/// values, one per line.
pub(super) fn change_form(config: &Config, accepted: &str) -> Html<String> {
    let fields: String = SETTINGS.iter().map(|setting| form_field(setting, config)).collect();
    let requests: String = accepted.lines().map(|l| format!("<li><code>/change?{l}</code></li>")).collect();
    let body = format!(
        "<form action=\"/change\" method=\"post\">\
         {fields}\
         <button>Change</button></form>\
         <h2>Requests</h2><ul>{requests}</ul>\
         <p>Several parameters may stand in one request, joined by <code>&amp;</code>: all of them are changed, or none. A change \
         takes effect with the next frame, for all clients. <code>gui</code> lets <a href=\"/screenshot\">screenshot</a> draw its \
         picture; it has no effect on the lights.</p>"
    );
    page("change", &body)
}

/// Returns the HTML of the label and the control of `setting`, with its value in `config`.
fn form_field(setting: &Setting, config: &Config) -> String {
    let schema = setting.schema(config);
    let (name, word) = (setting.parameter, setting.word(config));
    let control = match setting.kind {
        Kind::Choice(words) => {
            format!("<select name=\"{name}\">{}</select>", options(words.iter().copied(), &word))
        }
        Kind::Switch => format!("<select name=\"{name}\">{}</select>", options(["on", "off"], &word)),
        Kind::Whole(..) | Kind::Real(..) => {
            let step = if matches!(setting.kind, Kind::Whole(..)) { "1" } else { "any" };
            let (least, most) = (&schema["minimum"], &schema["maximum"]);
            format!(
                "<input name=\"{name}\" type=\"number\" min=\"{least}\" max=\"{most}\" step=\"{step}\" value=\"{word}\">"
            )
        }
        Kind::Optional(..) | Kind::OptionalWhole(..) | Kind::List(..) => {
            format!(
                "<input name=\"{name}\" value=\"{}\"> {}",
                escaped(&word),
                escaped(&setting.expected_word())
            )
        }
    };
    format!("<label>{} {control}</label>", escaped(setting.title))
}

/// Returns a page with a form by which the user confirms a change of settings that the browser sent without proof that a page
/// of this server caused it.
pub(super) fn change_confirm(pairs: &[(String, String)]) -> Html<String> {
    let field = |(name, value): &(String, String)| {
        let (name, value) = (escaped(name), escaped(value));
        format!("<label>{name} <input name=\"{name}\" value=\"{value}\"></label>")
    };
    let fields: String = pairs.iter().map(field).collect();
    let body = format!(
        "<p>Nothing was changed. Any page can make a browser send this request, so please confirm the change:</p>\
         <form action=\"/change\" method=\"post\">{fields}<button>Change</button></form>"
    );
    page("confirm the change", &body)
}

/// Returns the page that confirms a change of settings.
pub(super) fn change_done(config: &Config, pairs: &[(String, String)]) -> Html<String> {
    let body = format!(
        "<p>Changed: {}. In effect from the next frame.</p>{}<p><a href=\"/change\">Change more</a></p>",
        list(pairs),
        table(&settings(config))
    );
    page("changed", &body)
}

/// Returns the page for an accepted change of settings that no processed frame has confirmed yet.
pub(super) fn change_pending(pairs: &[(String, String)]) -> Html<String> {
    let body = format!(
        "<p>Accepted: {}. It takes effect with the next frame, which has not come yet: see \
         <a href=\"/info\">info</a>.</p>",
        list(pairs)
    );
    page("change accepted", &body)
}

/// Returns the page with the log-in form below `text`.
pub(super) fn login(text: &str) -> Html<String> {
    let body = format!(
        "<p>{}</p><form action=\"/login\" method=\"post\"><label>Token <input name=\"token\" type=\"password\" \
         autocomplete=\"current-password\" required></label><button>Log in</button></form>\
         <p>The token is in the file that the probe was started with (<code>--token-file</code>).</p>",
        escaped(text)
    );
    page("log in", &body)
}

/// Returns the page that states the reason for a missing screenshot.
pub(super) fn no_screenshot() -> Html<String> {
    let body =
        "<p>The debug picture is switched off: <a href=\"/change?gui=on\">switch it on</a>, then reload.</p>";
    page("screenshot", body)
}

/// Returns a page with the newest screenshot of `names` and links to the others.
pub(super) fn screenshot(names: &[String]) -> Html<String> {
    let Some((newest, older)) = names.split_first() else { return no_screenshot() };
    let link = |name: &String| format!("<li><a href=\"/screenshots/{0}\">{0}</a></li>", escaped(name));
    let older: String = older.iter().map(link).collect();
    let body = format!(
        "<p><a href=\"/screenshots/{0}\"><img src=\"/screenshots/{0}\" alt=\"The tone-mapped polar map with the lights\" \
         style=\"max-width:100%\"></a></p><p>{0}: the zenith is the upper edge, the horizon the lower one. \
         <a href=\"/screenshot\">Take another</a></p><ul>{older}</ul>",
        escaped(newest)
    );
    page("screenshot", &body)
}

fn list(pairs: &[(String, String)]) -> String {
    let one = |(name, value): &(String, String)| format!("{} = {}", escaped(name), escaped(value));
    pairs.iter().map(one).collect::<Vec<_>>().join(", ")
}

fn on_off(on: bool) -> &'static str {
    if on { "on" } else { "off" }
}

fn options<'a>(names: impl IntoIterator<Item = &'a str>, chosen: &str) -> String {
    let one = |name: &str| {
        let selected = if name == chosen { " selected" } else { "" };
        format!("<option{selected}>{}</option>", escaped(name))
    };
    names.into_iter().map(one).collect()
}

fn table(rows: &[Row]) -> String {
    rows.iter().fold("<table>".to_owned(), |mut html, (name, value)| {
        let _ = write!(html, "<tr><th>{name}</th><td>{}</td></tr>", escaped(value));
        html
    }) + "</table>"
}

fn page(title: &str, body: &str) -> Html<String> {
    Html(format!(
        "<!DOCTYPE html><html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" \
         content=\"width=device-width\"><title>hemilux: {title}</title>{STYLE}</head><body><h1>{title}</h1>{body}\
         <p><a href=\"/\">hemilux</a> · <a href=\"/info\">info</a> · <a href=\"/change\">change</a> · \
         <a href=\"/screenshot\">screenshot</a></p></body></html>\n"
    ))
}

/// Returns `text` with the special characters of HTML and of its attributes escaped.
fn escaped(text: &str) -> String {
    text.chars().fold(String::with_capacity(text.len()), |mut out, c| {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
        out
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_in_texts_is_escaped() {
        let html = table(&[("source", "replay:<img src=x onerror='a(\"&\")'>".into())]);
        let expected = "<table><tr><th>source</th><td>replay:&lt;img src=x onerror=&#39;a(&quot;&amp;&quot;)&#39;&gt;</td></tr></table>";
        assert_eq!(html, expected, "five characters");
    }

    #[test]
    fn times_have_three_digits_and_the_unit_that_suits_them() {
        let cases = [
            (0.000_926, "926 us"),
            (0.005_555, "5.55 ms"),
            (6.0, "6 s"),
            (0.033_333, "33.3 ms"),
            (0.001, "1 ms"),
            (60.0, "60 s"),
        ];
        for (seconds, expected) in cases {
            assert_eq!(duration(seconds), expected, "{seconds}");
        }
    }
}
