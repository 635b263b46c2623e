//! Thumbnails leave an edge only if the venue allows them and there is a subscriber.

use std::ops::Range;

use farfield_proto::message::thumbnail::Thumbnail;
use farfield_proto::venue::VenueCamera;
use image::{Rgb, RgbImage};

use super::*;
use crate::source::{Frame, FrameContent, FrameSource, SourceError, SourceInfo, Sources};

const TICKS: Range<Tick> = Tick(0)..Tick(2000);
const ALLOWED: &str = "[security]\npictures = true\n";

/// A camera with pictures of noise, in place of the test's camera.
#[derive(Debug)]
struct Noise;

struct NoisyFrames(Tick);

impl Sources for Noise {
    fn probe(&self, _: &VenueCamera, _: &Venue) -> Result<SourceInfo, SourceError> {
        Ok(SourceInfo {
            ticks: Some(TICKS),
            ..SourceInfo::default()
        })
    }

    fn open(
        &self,
        _: &VenueCamera,
        _: &Venue,
        from: Tick,
    ) -> Result<Box<dyn FrameSource>, SourceError> {
        Ok(Box::new(NoisyFrames(from)))
    }
}

impl FrameSource for NoisyFrames {
    fn next_frame(&mut self) -> Result<Option<Frame>, SourceError> {
        let tick = self.0;
        self.0 = tick + 1;
        let picture = RgbImage::from_fn(640, 480, |x, y| {
            Rgb([
                (tick.0 as u32 * 37 + x * y) as u8,
                x as u8,
                128 + (y as u8 >> 1),
            ])
        });
        Ok(TICKS.contains(&tick).then_some(Frame {
            tick,
            capture_offset_us: 0,
            content: FrameContent::Image(picture.into()),
        }))
    }
}

/// Runs `work` with an edge whose venue file begins with `more`, and a fusion without tracked
/// people.
async fn with_edge(more: &str, work: impl AsyncFnOnce(&mut Script)) {
    let folder = tempfile::tempdir().unwrap();
    let venue = venue(folder.path());
    let text = std::fs::read_to_string(&venue).unwrap();
    std::fs::write(
        &venue,
        text.replacen("[[viewpoint]]", &format!("{more}[[viewpoint]]"), 1),
    )
    .unwrap();
    let mut fusion = Script::open(&venue, "tcp/127.0.0.1:0", 1, None).await;
    let edge = start_edge_with(&venue, &fusion.endpoint.clone(), Arc::new(Noise));
    work(&mut fusion).await;
    // It ends on its own at its first detection pass, because its venue has a keypoint camera.
    edge.abort();
}

/// Sends boxes until `thumbnails` and `patches` messages have come; returns both.
async fn hear(
    fusion: &mut Script,
    heard: &Subscribed,
    thumbnails: usize,
    patches: usize,
) -> Vec<Thumbnail> {
    let mut found = Vec::new();
    let mut n_patches = 0;
    let enough = async {
        while found.len() < thumbnails || n_patches < patches {
            fusion.say_boxes(0, false, Order::Track).await;
            tokio::time::sleep(Duration::from_millis(20)).await;
            while let Ok(Some(sample)) = heard.try_recv() {
                found.push(wire::decode(&sample.payload().to_bytes()).unwrap());
            }
            while let Ok(Some(_)) = fusion.patches.try_recv() {
                n_patches += 1;
            }
        }
    };
    timeout(PATIENCE, enough).await.expect("nothing comes");
    found
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_allowed_thumbnail_is_sent_while_there_is_a_subscriber() {
    with_edge(ALLOWED, async |fusion: &mut Script| {
        let session = fusion.session.clone();
        let heard = session
            .declare_subscriber("live-test/thumbnail/a")
            .await
            .unwrap();
        let thumbnails = hear(fusion, &heard, 2, 10).await;
        let first = &thumbnails[0];
        assert_eq!(
            (first.session, first.camera),
            (SessionId(1), CameraIndex(0))
        );
        let apart = thumbnails[1].tick - first.tick;
        assert!(apart >= RATE_HZ / 2, "one a second: {apart} ticks");
        let shown = image::load_from_memory(&first.jpeg).unwrap();
        // Noise within the fewest bytes that an unknown link may have.
        assert_eq!((shown.width(), shown.height()), (160, 120));
    })
    .await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_picture_leaves_the_edge_without_permission_of_the_venue() {
    with_edge("", async |fusion: &mut Script| {
        let session = fusion.session.clone();
        let heard = session
            .declare_subscriber("live-test/thumbnail/**")
            .await
            .unwrap();
        let mut thumbnails = hear(fusion, &heard, 0, 10).await;
        // Longer than the first thumbnail takes.
        tokio::time::sleep(Duration::from_secs(3)).await;
        while let Ok(Some(sample)) = heard.try_recv() {
            thumbnails.push(wire::decode(&sample.payload().to_bytes()).unwrap());
        }
        assert!(thumbnails.is_empty());
    })
    .await;
}

#[test]
fn without_keys_no_picture_is_sent_to_another_machine() {
    let folder = tempfile::tempdir().unwrap();
    let path = venue(folder.path());
    std::fs::write(
        &path,
        VENUE.replacen("[[viewpoint]]", &format!("{ALLOWED}[[viewpoint]]"), 1),
    )
    .unwrap();
    let sends = |endpoint: &str| {
        let args = EdgeArgs {
            allow_plaintext: true,
            ..args(&path, endpoint)
        };
        EdgeConfig::load(args, Arc::new(Noise))
            .unwrap()
            .sends_pictures()
    };
    assert!(sends("tcp/127.0.0.1:7447"));
    assert!(!sends("tcp/10.0.0.1:7447"));
}
