//! Opens every source, all at the same time: first frames show what no header does.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};

use farfield_edge::source::{FrameContent, SourceError, SourceInfo, Sources};
use farfield_proto::tick::Tick;
use farfield_proto::venue::{Venue, VenueCamera};

/// Frames of a video that are compared between cameras: the first may be black in both.
const FRAMES: usize = 3;
/// Frames of keypoints that are compared: the first may have no people.
const KEYPOINT_FRAMES: usize = 60;
/// Sources opened at the same time: each may be a decoder process.
const TOGETHER: usize = 16;

/// The result of opening a camera's source.
pub(super) struct OpenedSource {
    /// Facts from its headers.
    pub(super) info: Result<SourceInfo, SourceError>,
    /// Its first frame; `None` if the headers are wrong already.
    pub(super) first: Option<Result<FrameContent, String>>,
    /// Hash of its first frames; `None` if these are too similar in any camera: no people, or one colour.
    pub(super) content: Option<u64>,
    /// The brightest value of its first images, 0 to 255; `None` without images.
    pub(super) brightest: Option<u8>,
}

/// Opens the sources of all cameras, in the order of the venue.
pub(super) fn open_all(sources: &dyn Sources, venue: &Venue) -> Vec<OpenedSource> {
    let mut opened = Vec::new();
    for cameras in venue.cameras.chunks(TOGETHER) {
        std::thread::scope(|scope| {
            let threads: Vec<_> = cameras
                .iter()
                .map(|camera| scope.spawn(move || open(sources, venue, camera)))
                .collect();
            let failed = || OpenedSource {
                info: Ok(SourceInfo::default()),
                first: Some(Err(
                    "an internal error of this program while reading it".to_owned()
                )),
                content: None,
                brightest: None,
            };
            let ends = threads
                .into_iter()
                .map(|it| it.join().unwrap_or_else(|_| failed()));
            opened.extend(ends);
        });
    }
    opened
}

fn open(sources: &dyn Sources, venue: &Venue, camera: &VenueCamera) -> OpenedSource {
    let info = match sources.probe(camera, venue) {
        Ok(info) => info,
        Err(error) => {
            return OpenedSource {
                info: Err(error),
                first: None,
                content: None,
                brightest: None,
            };
        }
    };
    let from = info.ticks.as_ref().map_or(Tick(0), |ticks| ticks.start);
    match frames(sources, venue, camera, from) {
        Ok(seen) => OpenedSource {
            info: Ok(info),
            first: Some(Ok(seen.first)),
            content: seen.content,
            brightest: seen.brightest,
        },
        Err(problem) => OpenedSource {
            info: Ok(info),
            first: Some(Err(problem)),
            content: None,
            brightest: None,
        },
    }
}

/// The first frames of a source.
struct SeenFrames {
    first: FrameContent,
    content: Option<u64>,
    brightest: Option<u8>,
}

fn frames(
    sources: &dyn Sources,
    venue: &Venue,
    camera: &VenueCamera,
    from: Tick,
) -> Result<SeenFrames, String> {
    let mut source = sources
        .open(camera, venue, from)
        .map_err(|it| it.to_string())?;
    let mut first = None;
    let mut hash = DefaultHasher::new();
    let mut is_distinct = false;
    let mut brightest = None;
    for read in 0..KEYPOINT_FRAMES {
        let frame = match source.next_frame() {
            Ok(Some(frame)) => frame,
            Err(error) if first.is_none() => return Err(error.to_string()),
            // The end; an error of a later frame is left to the run.
            Ok(None) | Err(_) => break,
        };
        let is_done = match &frame.content {
            FrameContent::Image(picture) => {
                let image = picture.clone().into_rgb();
                image.as_raw().hash(&mut hash);
                brightest = brightest.max(image.as_raw().iter().copied().max());
                is_distinct |= image.pixels().any(|it| it != image.get_pixel(0, 0));
                read + 1 >= FRAMES || camera.source.is_live()
            }
            FrameContent::Keypoints(keypoints) => {
                format!("{keypoints:?}").hash(&mut hash);
                is_distinct |= keypoints.peaks.iter().any(|peaks| !peaks.is_empty());
                false
            }
            FrameContent::Painted(_) => true,
        };
        first.get_or_insert(frame.content);
        if is_done {
            break;
        }
    }
    let first = first.ok_or_else(|| "it has no frame".to_owned())?;
    Ok(SeenFrames {
        first,
        content: is_distinct.then(|| hash.finish()),
        brightest,
    })
}
