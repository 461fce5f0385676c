//! `/screenshot`: the debug picture under a unique name. The server keeps the last sixteen pictures, of at most 4 MB in all,
//! and always the newest one, in memory and writes no file.

use super::access::Allowed;
use super::map_form::MapForm;
use super::picture_cache::{PictureKind, Rendered, Told};
use super::pictures::{no_picture, png, view};
use super::{Context, line, pages};
use crate::probe::MapView;
use axum::body::Bytes;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::response::{IntoResponse, Response};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Form of a screenshot: the map of the hemisphere, with the lights drawn on it.
const MARKED: MapForm = MapForm { hemisphere: true, width: None, marks: true };

/// Largest number of screenshots that the server keeps.
const KEPT: usize = 16;

/// Largest total length of two or more screenshots that the server keeps, bytes.
const KEPT_BYTES: usize = 4 << 20;

/// The kept screenshots with their names, the newest first.
#[derive(Debug, Default)]
pub(super) struct Screenshots {
    pictures: Mutex<(u64, VecDeque<(String, Bytes)>)>,
}

impl Screenshots {
    /// Stores a copy of a screenshot as PNG; returns the names of all kept screenshots, the newest first. The memory of `png` counts among
    /// the answers in progress, that of the copy does not.
    fn keep(&self, run: &str, frame: u64, png: &[u8]) -> Vec<String> {
        let mut guard = self.lock();
        let (count, pictures) = &mut *guard;
        *count += 1;
        pictures.truncate(KEPT - 1);
        pictures.push_front((format!("{run}-{frame:06}-{count}.png"), Bytes::copy_from_slice(png)));
        while pictures.len() > 1 && pictures.iter().map(|(_, png)| png.len()).sum::<usize>() > KEPT_BYTES {
            pictures.pop_back();
        }
        pictures.iter().map(|(name, _)| name.clone()).collect()
    }

    fn find(&self, name: &str) -> Option<Bytes> {
        self.lock().1.iter().find(|(n, _)| n == name).map(|(_, png)| png.clone())
    }

    fn lock(&self) -> MutexGuard<'_, (u64, VecDeque<(String, Bytes)>)> {
        self.pictures.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Answers with a page that shows a new screenshot.
pub(super) async fn take(State(context): State<Context>, _: Allowed) -> Response {
    if !context.link.settings().applied().borrow().config.gui {
        return (StatusCode::CONFLICT, pages::no_screenshot()).into_response();
    }
    let link = &context.link;
    let look = |_| view(link, &link.views().maps);
    let render = |map: Arc<MapView>| {
        Some(Rendered { bytes: png(&map, MARKED)?, frame: map.frame, told: Told::Nothing })
    };
    let picture = match context.answers.pictures.picture(PictureKind::Screenshot, look, render).await {
        Ok(picture) => picture,
        Err(why) => return no_picture(&context, why),
    };
    let names = context.answers.screenshots.keep(link.run(), picture.frame, &picture.bytes);
    ([(CACHE_CONTROL, "no-store")], pages::screenshot(&names)).into_response()
}

/// Answers with the kept screenshot called `name`.
pub(super) async fn kept(State(context): State<Context>, _: Allowed, Path(name): Path<String>) -> Response {
    match context.answers.screenshots.find(&name) {
        // Names of screenshots are never reused, so that clients may cache a screenshot.
        Some(png) => {
            ([(CONTENT_TYPE, "image/png"), (CACHE_CONTROL, "private, max-age=86400, immutable")], png)
                .into_response()
        }
        None => line(
            StatusCode::NOT_FOUND,
            "no such screenshot: the last sixteen are kept, as far as they fit in 4 MB",
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_sixteen_screenshots_are_kept_under_unique_names() {
        let screenshots = Screenshots::default();
        let mut all = Vec::new();
        for i in 0..20 {
            all = screenshots.keep("k3v9", 7, &[i]);
        }
        assert_eq!(
            (all.len(), all[0].as_str(), all[15].as_str()),
            (16, "k3v9-000007-20.png", "k3v9-000007-5.png"),
            "{all:?}"
        );
        assert_eq!(screenshots.find(&all[15]), Some(Bytes::from_static(&[4])), "the oldest that stays");
        assert_eq!(screenshots.find("k3v9-000007-4.png"), None, "gone");
    }

    #[test]
    fn large_screenshots_are_kept_up_to_four_megabytes() {
        let screenshots = Screenshots::default();
        let mut kept = Vec::new();
        for _ in 0..6 {
            kept.push(screenshots.keep("k3v9", 7, &vec![0; 1 << 20]).len());
        }
        kept.push(screenshots.keep("k3v9", 7, &vec![0; 5 << 20]).len());
        assert_eq!(kept, [1, 2, 3, 4, 4, 4, 1], "the newest one always");
    }
}
