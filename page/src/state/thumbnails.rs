//! The newest thumbnail of each camera, for people to look at: one slot each, and nothing of the past.

use std::sync::Mutex;
use std::time::Duration;

use axum::body::Bytes;
use farfield_proto::id::CameraIndex;
use farfield_proto::message::thumbnail::Thumbnail;
use farfield_proto::wire;
use tokio::time::Instant;

use super::lock;

/// A thumbnail that is older is not shown any more: it would be taken for what is there now.
const FRESH: Duration = Duration::from_secs(10);

/// The thumbnails of a venue's cameras.
pub(crate) struct Thumbnails(Mutex<Vec<Option<Kept>>>);

struct Kept {
    shown: ShownThumbnail,
    came: Instant,
}

/// A thumbnail as it is served.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ShownThumbnail {
    /// What tells it from any other of its camera, an `ETag`.
    pub(crate) tag: String,
    /// A JPEG file.
    pub(crate) jpeg: Bytes,
}

impl Thumbnails {
    /// Of so many cameras: none yet.
    pub(super) fn new(cameras: usize) -> Self {
        Self(Mutex::new((0..cameras).map(|_| None).collect()))
    }

    /// Takes a message in the place of the one before; whether it was a thumbnail of a camera of the venue.
    pub(super) fn take(&self, bytes: &[u8], now: Instant) -> bool {
        let Ok(thumbnail) = wire::decode::<Thumbnail>(bytes) else {
            return false;
        };
        let mut slots = lock(&self.0);
        let Some(slot) = slots.get_mut(usize::from(thumbnail.camera.0)) else {
            return false;
        };
        let tag = format!("\"{:x}-{}\"", thumbnail.session.0, thumbnail.tick.0);
        *slot = Some(Kept {
            shown: ShownThumbnail {
                tag,
                jpeg: thumbnail.jpeg.into(),
            },
            came: now,
        });
        true
    }

    /// Whether the venue has a camera.
    pub(crate) fn has(&self, camera: CameraIndex) -> bool {
        usize::from(camera.0) < lock(&self.0).len()
    }

    /// The newest of a camera, if it is new.
    pub(crate) fn newest(&self, camera: CameraIndex, now: Instant) -> Option<ShownThumbnail> {
        let slots = lock(&self.0);
        let kept = slots.get(usize::from(camera.0))?.as_ref()?;
        let is_fresh = now.saturating_duration_since(kept.came) <= FRESH;
        is_fresh.then(|| kept.shown.clone())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use farfield_proto::id::{SessionId, ViewpointIndex};
    use farfield_proto::tick::Tick;

    use super::*;

    /// The message of a camera's thumbnail at a tick; its picture is a head only.
    pub(crate) fn message(camera: u16, tick: i64) -> Vec<u8> {
        let jpeg = [
            0xff, 0xd8, 0xff, 0xc0, 0, 11, 8, 0, 180, 1, 64, 1, 1, 0x11, 0, 0xff, 0xd9,
        ];
        wire::encode(&Thumbnail {
            session: SessionId(0xa),
            tick: Tick(tick),
            viewpoint: ViewpointIndex(0),
            camera: CameraIndex(camera),
            jpeg: jpeg.to_vec(),
        })
    }

    #[test]
    fn the_newest_of_each_camera_is_kept_and_shown_while_it_is_new() {
        let (thumbnails, now) = (Thumbnails::new(2), Instant::now());
        let tag = |camera, at| thumbnails.newest(CameraIndex(camera), at).map(|t| t.tag);
        assert_eq!(tag(1, now), None);
        assert!(thumbnails.take(&message(1, 60), now));
        assert!(thumbnails.take(&message(1, 120), now));
        assert_eq!(tag(1, now + FRESH).as_deref(), Some("\"a-120\""));
        assert_eq!(tag(0, now), None);
        assert_eq!(tag(1, now + FRESH + Duration::from_millis(1)), None);
    }

    #[test]
    fn what_is_no_thumbnail_of_the_venue_is_not_kept() {
        let (thumbnails, now) = (Thumbnails::new(2), Instant::now());
        assert!(!thumbnails.take(&message(2, 60), now));
        assert!(!thumbnails.take(b"\x06<svg>", now));
        assert_eq!(thumbnails.newest(CameraIndex(2), now), None);
        assert_eq!(thumbnails.newest(CameraIndex(0), now), None);
    }
}
