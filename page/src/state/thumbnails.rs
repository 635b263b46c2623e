//! The newest thumbnail of each camera: one slot each, without history.

use std::sync::Mutex;
use std::time::Duration;

use axum::body::Bytes;
use farfield_proto::id::CameraIndex;
use farfield_proto::message::thumbnail::Thumbnail;
use farfield_proto::wire;
use tokio::time::Instant;

use super::lock;

/// Older thumbnails are not shown, since they would be mistaken for the current view.
const FRESH: Duration = Duration::from_secs(10);

/// The thumbnails of a venue's cameras.
pub(crate) struct Thumbnails(Mutex<Vec<Option<Stored>>>);

struct Stored {
    shown: ShownThumbnail,
    came: Instant,
}

/// A thumbnail as it is served.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ShownThumbnail {
    /// `ETag` that distinguishes it from other thumbnails of the camera.
    pub(crate) tag: String,
    /// A JPEG file.
    pub(crate) jpeg: Bytes,
}

impl Thumbnails {
    /// Empty slots for this many cameras.
    pub(super) fn new(cameras: usize) -> Self {
        Self(Mutex::new((0..cameras).map(|_| None).collect()))
    }

    /// Stores the thumbnail of a message; returns whether it was one of a camera of the venue.
    pub(super) fn take(&self, bytes: &[u8], now: Instant) -> bool {
        let Ok(thumbnail) = wire::decode::<Thumbnail>(bytes) else {
            return false;
        };
        let mut slots = lock(&self.0);
        let Some(slot) = slots.get_mut(usize::from(thumbnail.camera.0)) else {
            return false;
        };
        let tag = format!("\"{:x}-{}\"", thumbnail.session.0, thumbnail.tick.0);
        *slot = Some(Stored {
            shown: ShownThumbnail {
                tag,
                jpeg: thumbnail.jpeg.into(),
            },
            came: now,
        });
        true
    }

    /// Whether the venue has this camera.
    pub(crate) fn has(&self, camera: CameraIndex) -> bool {
        usize::from(camera.0) < lock(&self.0).len()
    }

    /// The newest thumbnail of a camera, if it is recent.
    pub(crate) fn newest(&self, camera: CameraIndex, now: Instant) -> Option<ShownThumbnail> {
        let slots = lock(&self.0);
        let stored = slots.get(usize::from(camera.0))?.as_ref()?;
        let is_fresh = now.saturating_duration_since(stored.came) <= FRESH;
        is_fresh.then(|| stored.shown.clone())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use farfield_proto::id::{SessionId, ViewpointIndex};
    use farfield_proto::tick::Tick;

    use super::*;

    /// Thumbnail message of a camera at a tick; its image is only a JPEG header.
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
    fn the_newest_thumbnail_is_shown_while_it_is_recent() {
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
    fn invalid_thumbnails_are_dropped() {
        let (thumbnails, now) = (Thumbnails::new(2), Instant::now());
        assert!(!thumbnails.take(&message(2, 60), now));
        assert!(!thumbnails.take(b"\x06<svg>", now));
        assert_eq!(thumbnails.newest(CameraIndex(2), now), None);
        assert_eq!(thumbnails.newest(CameraIndex(0), now), None);
    }
}
