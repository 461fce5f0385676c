//! Pictures on request: one thread renders one picture at a time, at most one per `INTERVAL` for all clients. Each picture answers all requests
//! that arrived before the burst that it shows.

use super::encoder::Encoder;
use super::map_form::MapForm;
use super::memory::{AnswerMemory, KEPT_PICTURE_BYTES, Kept, Reserved, body};
use crate::clock;
use axum::body::Bytes;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::time::Instant;

/// Shortest time between the renderings of two pictures: twenty per second for all clients.
const INTERVAL: Duration = Duration::from_millis(50);

/// Difference of the nice value of the rendering thread from that of the process.
const NICE: i32 = 10;

/// Largest number of cached pictures.
const KEPT: usize = 4;

/// Usual length of a picture, bytes, for which memory is reserved.
const USUAL_BYTES: usize = 1 << 20;

/// The kind of a picture, with the parameters of the rendering.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum PictureKind {
    /// An exposure of a burst, by its index in ascending order of exposure time, and the largest width of the
    /// picture, pixels.
    Exposure(usize, Option<u16>),
    /// The best exposure of a burst whose exposures all began after the request.
    Capture,
    /// The map, tone-mapped to 8 bits.
    Map(MapForm),
    /// The map as JPEG, whose codes span the whole range of radiance.
    MapJpeg,
    /// The map as an OpenEXR file.
    MapExr(MapForm),
    /// The map as a Radiance HDR file.
    MapHdr(MapForm),
    /// The mask of unseen and clipped directions.
    Mask,
    /// The tone-mapped map with the lights, which the server keeps under a name.
    Screenshot,
}

/// The frame or map from which a picture is rendered.
pub(super) enum View<T> {
    /// A frame or map, and the time of the latest request that it answers.
    Of {
        /// The data from which the picture is rendered.
        view: T,
        /// Time of the latest request that the view answers, CLOCK_MONOTONIC, nanoseconds.
        since_ns: u64,
        /// True if the view belongs to a frame after the request.
        is_fresh: bool,
    },
    /// The view is older than this request: another view is requested.
    TooOld,
    /// There is no frame or map for the picture.
    None,
}

/// A property of a picture that a header of the answer states.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Told {
    /// The answer has no header about the picture.
    Nothing,
    /// The exposure that the picture shows.
    Shot(Shot),
    /// The radiance that the middle code of the picture's range stands for.
    Grey(f32),
}

/// The exposure of a burst that a picture shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shot {
    /// Number of exposures of the burst of the picture.
    pub(super) of: usize,
    /// Exposure time times gain of the exposure, seconds.
    pub(super) seconds: f64,
}

/// A picture that the thread has rendered, with its frame number.
pub(super) struct Rendered {
    pub(super) bytes: Vec<u8>,
    pub(super) frame: u64,
    pub(super) told: Told,
}

/// A picture in the cache or new, which can be sent to clients.
#[derive(Clone, Debug)]
pub(super) struct Picture {
    pub(super) bytes: Bytes,
    pub(super) frame: u64,
    pub(super) told: Told,
    pub(super) is_fresh: bool,
}

/// Reasons why a picture cannot be returned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NoPicture {
    /// There is no frame or map to render.
    NoView,
    /// The answers in progress have used up the memory limit.
    Full,
    /// The encoder of the picture returned an error.
    Fault,
}

/// Renders pictures on one thread and caches the newest ones while requests wait that they can answer.
pub(super) struct PictureCache {
    /// Locked while a picture is rendered; contains the time of the last rendering.
    making: tokio::sync::Mutex<Option<Instant>>,
    cached: Mutex<Cached>,
    thread: Encoder<PictureKind>,
    memory: Arc<AnswerMemory>,
}

/// The cached pictures, the newest last: at most one of each kind, at most [`KEPT`] and [`KEPT_PICTURE_BYTES`] in all.
#[derive(Default)]
struct Cached {
    made: Vec<Made>,
    /// Number of requests that wait for a picture. A cached picture answers requests that arrived before its burst: when none waits, the
    /// cache is emptied.
    waiting: usize,
}

/// A request that waits for a picture, counted until it is dropped.
struct Waiting<'a>(&'a PictureCache);

impl Drop for Waiting<'_> {
    fn drop(&mut self) {
        let mut cached = self.0.lock();
        cached.waiting -= 1;
        if cached.waiting == 0 {
            cached.made.clear();
        }
    }
}

struct Made {
    kind: PictureKind,
    since_ns: u64,
    kept: Kept,
    /// The cached picture, without its bytes.
    picture: Picture,
}

impl PictureCache {
    pub(super) fn new(memory: Arc<AnswerMemory>) -> Self {
        let (making, cached) = (tokio::sync::Mutex::default(), Mutex::default());
        Self { making, cached, thread: Encoder::new("hemilux-picture", NICE), memory }
    }

    /// Returns a picture of `kind`: a cached one whose view is later than this request, or one that `render` makes from the frame or map
    /// that `look` returns.
    pub(super) async fn picture<T, F>(
        &self,
        kind: PictureKind,
        look: impl Fn(u64) -> F,
        render: impl FnOnce(T) -> Option<Rendered> + Send + 'static,
    ) -> Result<Picture, NoPicture>
    where
        T: Send + 'static,
        F: Future<Output = View<T>>,
    {
        let asked_ns = clock::monotonic_ns();
        let _waiting = self.wait();
        loop {
            let mut last = self.making.lock().await;
            if let Some(picture) = self.find(kind, asked_ns) {
                return Ok(picture);
            }
            if let Some(last) = *last {
                tokio::time::sleep_until(last + INTERVAL).await;
            }
            let reserved = self.memory.reserve(USUAL_BYTES).await.ok_or(NoPicture::Full)?;
            *last = Some(Instant::now());
            let (view, since_ns, is_fresh) = match look(asked_ns).await {
                View::Of { view, since_ns, is_fresh } => (view, since_ns, is_fresh),
                View::TooOld => continue,
                View::None => return Err(NoPicture::NoView),
            };
            let rendered =
                self.thread.run(kind, move || render(view)).await.flatten().ok_or(NoPicture::Fault)?;
            return Ok(self.keep(kind, since_ns, is_fresh, rendered, reserved));
        }
    }

    fn wait(&self) -> Waiting<'_> {
        self.lock().waiting += 1;
        Waiting(self)
    }

    fn keep(
        &self,
        kind: PictureKind,
        since_ns: u64,
        is_fresh: bool,
        rendered: Rendered,
        reserved: Reserved,
    ) -> Picture {
        let Rendered { bytes, frame, told } = rendered;
        let is_small = bytes.len() <= KEPT_PICTURE_BYTES;
        let held = reserved.hold(bytes);
        let mut kept = Kept::new(&held);
        if !is_small {
            kept.release();
        }
        let picture = Picture { bytes: Bytes::new(), frame, told, is_fresh };
        let made = &mut self.lock().made;
        made.retain(|made| made.kind != kind);
        let total = |made: &[Made]| made.iter().map(|made| made.kept.len()).sum::<usize>();
        while made.len() == KEPT || !made.is_empty() && total(made) + kept.len() > KEPT_PICTURE_BYTES {
            made.remove(0);
        }
        made.push(Made { kind, since_ns, kept, picture: picture.clone() });
        Picture { bytes: body(&held), ..picture }
    }

    fn find(&self, kind: PictureKind, asked_ns: u64) -> Option<Picture> {
        let cached = self.lock();
        let made = cached.made.iter().find(|made| made.kind == kind && made.since_ns >= asked_ns)?;
        Some(Picture { bytes: made.kept.find()?, ..made.picture.clone() })
    }

    fn lock(&self) -> MutexGuard<'_, Cached> {
        self.cached.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

    #[tokio::test]
    async fn requests_that_wait_together_share_a_picture_and_later_ones_get_another() {
        let cache = PictureCache::new(Arc::default());
        let looks = AtomicU64::new(0);
        let ask = || {
            let look = |_| {
                let frame = looks.fetch_add(1, Relaxed);
                async move {
                    // Further requests arrive while the picture is rendered.
                    tokio::task::yield_now().await;
                    View::Of { view: frame, since_ns: clock::monotonic_ns(), is_fresh: true }
                }
            };
            let render = |frame| Some(Rendered { bytes: vec![1], frame, told: Told::Nothing });
            cache.picture(PictureKind::Mask, look, render)
        };
        let (a, b, c) = tokio::join!(ask(), ask(), ask());
        let frames = [a, b, c].map(|picture| picture.expect("a picture").frame);
        assert_eq!((frames, looks.load(Relaxed)), ([0; 3], 1), "one for three");
        assert_eq!(ask().await.expect("a picture").frame, 1, "a later request");
    }

    /// Requests pictures of `length` bytes in 16 forms, one after another; returns true if all requests were answered.
    async fn ask_in_16_forms(cache: &PictureCache, length: usize) -> bool {
        for width in 0..16 {
            let look = |_| async { View::Of { view: 0, since_ns: clock::monotonic_ns(), is_fresh: true } };
            let render = move |frame| Some(Rendered { bytes: vec![1; length], frame, told: Told::Nothing });
            if cache.picture(PictureKind::Exposure(0, Some(width)), look, render).await.is_err() {
                return false;
            }
        }
        true
    }

    #[tokio::test]
    async fn pictures_in_many_forms_do_not_use_up_the_memory() {
        let memory: Arc<AnswerMemory> = Arc::default();
        let cache = PictureCache::new(Arc::clone(&memory));
        assert!(ask_in_16_forms(&cache, KEPT_PICTURE_BYTES).await, "one request at a time");
        let _waiting = cache.wait();
        assert!(ask_in_16_forms(&cache, KEPT_PICTURE_BYTES).await, "while another request waits");
    }

    #[tokio::test]
    async fn no_picture_stays_cached_when_no_request_waits() {
        let cache = PictureCache::new(Arc::default());
        let waiting = cache.wait();
        assert!(ask_in_16_forms(&cache, 1).await);
        assert_eq!(cache.lock().made.len(), KEPT, "while a request waits");
        drop(waiting);
        assert_eq!(cache.lock().made.len(), 0, "afterwards");
    }

    #[tokio::test]
    async fn pictures_are_made_at_a_bounded_rate() {
        let cache = PictureCache::new(Arc::default());
        let began = Instant::now();
        for frame in 0..4 {
            let look = |_| async move { View::Of { view: frame, since_ns: 0, is_fresh: true } };
            let render = |frame| Some(Rendered { bytes: vec![1], frame, told: Told::Nothing });
            cache.picture(PictureKind::Mask, look, render).await.expect("a picture");
        }
        assert!(began.elapsed() >= 3 * INTERVAL, "{:?}", began.elapsed());
    }
}
