//! One HTTP request for one light set.

use super::set::Set;
use super::{ClientError, Options};
use hemilux_core::wire::BinarySet;
use std::io;
use ureq::Agent;
use ureq::http::Uri;

/// Longest answer of a probe that is read, bytes: 50,000 lights take two million.
const LONGEST_ANSWER: u64 = 16 << 20;

/// Requests the light sets of a probe on one connection.
pub(super) struct Fetcher {
    agent: Agent,
    url: String,
}

/// Reasons why a request returned no light set.
pub(super) enum Trouble {
    /// The probe did not answer within the time limit.
    Silence,
    /// The request has failed otherwise, as described.
    Other(String),
}

impl Fetcher {
    pub(super) fn try_new(options: &Options) -> Result<Self, ClientError> {
        let bad = || ClientError::BadUrl(options.url.clone());
        let uri: Uri = options.url.parse().map_err(|_| bad())?;
        let is_root = uri.path_and_query().is_none_or(|p| p.as_str() == "/");
        if uri.scheme_str() != Some("http") || uri.host().is_none() || !is_root {
            return Err(bad());
        }
        let base = options.url.trim_end_matches('/');
        let mut url = format!("{base}/v1/lights?format=binary&coordinates={}", options.coordinates.name());
        if let Some(lights) = options.lights {
            url += &format!("&lights={lights}");
        }
        if options.ambient {
            url += "&ambient=1";
        }
        if let Some(soft) = options.soft {
            url += &format!("&soft={}", u8::from(soft));
        }
        let config = Agent::config_builder().timeout_global(Some(options.timeout)).max_redirects(0);
        Ok(Self { agent: config.build().into(), url })
    }

    /// Requests the light set after frame `after` and returns it in the memory of `set`.
    pub(super) fn next(&mut self, after: Option<u64>, mut set: Set) -> Result<Set, Trouble> {
        let url = after.map_or_else(|| self.url.clone(), |frame| format!("{}&after={frame}", self.url));
        let mut answer = self.agent.get(&url).call().map_err(trouble)?;
        let body = answer.body_mut().with_config().limit(LONGEST_ANSWER);
        let bytes = body.read_to_vec().map_err(trouble)?;
        let read = BinarySet::try_new(&bytes).map_err(|e| Trouble::Other(format!("found {e}")))?;
        set.read(&read);
        Ok(set)
    }
}

fn trouble(error: ureq::Error) -> Trouble {
    match error {
        ureq::Error::Timeout(_) => Trouble::Silence,
        ureq::Error::Io(e) if matches!(e.kind(), io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock) => {
            Trouble::Silence
        }
        other => Trouble::Other(other.to_string()),
    }
}
