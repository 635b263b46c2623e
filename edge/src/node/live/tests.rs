//! A live edge from start to end, over a real Zenoh router, with a scripted fusion.

mod thumbnails;

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use farfield_node::clock::VenueClock;
use farfield_node::files::load_venue;
use farfield_node::process::{Ending, NodeError};
use farfield_proto::bounding_box::{BoundingBox, BoxRate};
use farfield_proto::id::{CameraIndex, PersonId, SessionId, ViewpointIndex};
use farfield_proto::message::health::NodeHealth;
use farfield_proto::message::live::{EdgeLink, LiveBoxes, LiveStatus};
use farfield_proto::message::{
    BoxSet, CameraBox, Order, PatchSet, PersonBoxes, SightingSet, Status,
};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use farfield_proto::wire::{self, Message};
use tokio::task::JoinHandle;
use tokio::time::timeout;
use zenoh::Session;
use zenoh::handlers::FifoChannelHandler;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::sample::Sample;

use crate::node::config::{EdgeArgs, EdgeConfig};
use crate::node::run::run;
use crate::source::{RecordedSources, Sources};

/// Far longer than a loaded machine needs; a test that waits this long has failed.
const PATIENCE: Duration = Duration::from_secs(30);
const RATE_HZ: i64 = 30;

const VENUE: &str = "name = \"live-test\"\nrate_hz = 30.0\ncalibration = \"c.toml\"\n[[viewpoint]]\nname = \"a\"\n\
    [[viewpoint.camera]]\nname = \"c0\"\nsource = { kind = \"keypoints\", path = \"c0.jsonl\" }\n";
const CALIBRATION: &str = "[c0]\nname = \"c0\"\nsize = [640, 480]\n\
    matrix = [[640.0, 0.0, 319.5], [0.0, 640.0, 239.5], [0.0, 0.0, 1.0]]\n\
    distortions = [0.0, 0.0, 0.0, 0.0, 0.0]\nrotation = [0.0, 0.0, 0.0]\ntranslation = [0.0, 0.0, 0.0]\n";

/// A venue whose camera shows a standing person in the middle of its picture.
fn venue(folder: &Path) -> std::path::PathBuf {
    std::fs::write(folder.join("c.toml"), CALIBRATION).unwrap();
    let keypoints: Vec<String> = (0..17)
        .map(|k| format!("[{}.0, {}.0, 0.9]", 300 + 2 * k, 150 + 10 * k))
        .collect();
    let keypoints = keypoints.join(", ");
    let line =
        |tick| format!("{{\"tick\": {tick}, \"persons\": [{{\"keypoints\": [{keypoints}]}}]}}\n");
    let lines: String = (0..2000).map(line).collect();
    std::fs::write(folder.join("c0.jsonl"), lines).unwrap();
    let path = folder.join("venue.toml");
    std::fs::write(&path, VENUE).unwrap();
    path
}

type Subscribed = Subscriber<FifoChannelHandler<Sample>>;

/// The messages of fusion that an edge uses.
struct Script {
    session: Session,
    boxes: Publisher<'static>,
    status: Publisher<'static>,
    patches: Subscribed,
    sightings: Subscribed,
    statuses: Subscribed,
    clock: VenueClock,
    endpoint: String,
    venue: Venue,
    life: SessionId,
    sequence: u32,
    epoch_us: i64,
}

impl Script {
    /// Listens on `endpoint`; tick 0 is at `epoch_us`, or in half a second.
    async fn open(venue: &Path, endpoint: &str, life: u64, epoch_us: Option<i64>) -> Self {
        let mut config = zenoh::Config::default();
        for (key, value) in [
            ("mode", "\"router\"".to_owned()),
            ("scouting/multicast/enabled", "false".to_owned()),
            ("listen/endpoints", format!("[\"{endpoint}\"]")),
        ] {
            config.insert_json5(key, &value).unwrap();
        }
        let session = zenoh::open(config).await.unwrap();
        let endpoint = session.info().locators().await[0].to_string();
        let subscribe = |key: &'static str| session.declare_subscriber(key);
        let publish = |key: &'static str| session.declare_publisher(key);
        let clock = VenueClock::start();
        Self {
            boxes: publish("live-test/box/a").await.unwrap(),
            status: publish("live-test/status/fusion").await.unwrap(),
            patches: subscribe("live-test/patch/a").await.unwrap(),
            sightings: subscribe("live-test/sighting/a").await.unwrap(),
            statuses: subscribe("live-test/status/a").await.unwrap(),
            epoch_us: epoch_us.unwrap_or(clock.now_us() + 500_000),
            session,
            clock,
            endpoint,
            venue: load_venue(venue).unwrap(),
            life: SessionId(life),
            sequence: 0,
        }
    }

    fn now(&self) -> Tick {
        Tick((self.clock.now_us() - self.epoch_us) * RATE_HZ / 1_000_000)
    }

    /// Sends the position of the person for the tick after next.
    async fn say_boxes(&mut self, persons: u32, detect: bool, order: Order) {
        self.sequence += 1;
        let boxes = self.boxes(persons, detect, order);
        self.boxes.put(wire::encode(&boxes)).await.unwrap();
    }

    fn boxes(&self, persons: u32, detect: bool, order: Order) -> BoxSet {
        let camera_box = CameraBox {
            camera: CameraIndex(0),
            bounding_box: BoundingBox {
                center_px: [316.0, 230.0],
                size_px: [180.0, 240.0],
                rotation_rad: 0.0,
            },
            rate: BoxRate::default(),
            torso_px: [316.0, 230.0],
            neck_px: [316.0, 180.0],
        };
        let person = |id| PersonBoxes {
            person: PersonId(id),
            cameras: vec![camera_box],
        };
        BoxSet {
            session: self.life,
            tick: self.now() + 2,
            viewpoint: ViewpointIndex(0),
            part: 0,
            parts: 1,
            order,
            live: Some(LiveBoxes {
                sequence: self.sequence,
                epoch_us: self.epoch_us as u64,
                clock_correction_us: None,
                heard: None,
                every_nth_tick: 0,
            }),
            detection_cameras: if detect {
                vec![CameraIndex(0)]
            } else {
                Vec::new()
            },
            persons: (1..=persons).map(person).collect(),
        }
    }

    async fn say_status(&self, calibration_hash: &str, edges: Vec<EdgeLink>) {
        let status = self.status(calibration_hash, edges);
        self.status.put(wire::encode(&status)).await.unwrap();
    }

    fn status(&self, calibration_hash: &str, edges: Vec<EdgeLink>) -> Status {
        Status {
            node: "fusion".to_owned(),
            process: 0,
            viewpoint: None,
            release: String::new(),
            ready: true,
            venue_hash: self.venue.hashes.venue.clone(),
            calibration_hash: calibration_hash.to_owned(),
            network_hash: String::new(),
            backend: String::new(),
            ticks: None,
            tick: None,
            unreadable: 0,
            failure: None,
            stages: Vec::new(),
            live: Some(LiveStatus {
                every_nth_tick: 1,
                edges,
                ..LiveStatus::default()
            }),
            health: NodeHealth::default(),
            agreement: Vec::new(),
        }
    }

    fn own_calibration(&self) -> String {
        self.venue.hashes.calibration.clone()
    }

    /// Sends boxes every tick until a message matches `is_it`.
    async fn until<M: Message>(
        &mut self,
        persons: u32,
        subscription: impl Fn(&Self) -> &Subscribed,
        is_it: impl Fn(&M) -> bool,
    ) -> M {
        let found = async {
            loop {
                self.say_boxes(persons, true, Order::Track).await;
                let pause = tokio::time::sleep(Duration::from_millis(20));
                tokio::pin!(pause);
                loop {
                    tokio::select! {
                        () = &mut pause => break,
                        sample = subscription(self).recv_async() => {
                            let message = wire::decode(&sample.unwrap().payload().to_bytes()).unwrap();
                            if is_it(&message) {
                                return message;
                            }
                        }
                    }
                }
            }
        };
        timeout(PATIENCE, found)
            .await
            .expect("the edge does not say it")
    }

    async fn end(&mut self, edge: JoinHandle<Result<Ending, NodeError>>) {
        let end = async {
            while !edge.is_finished() {
                self.say_boxes(0, false, Order::End).await;
                tokio::time::sleep(Duration::from_millis(50)).await;
            }
            edge.await.unwrap()
        };
        let ending = timeout(PATIENCE, end).await.expect("the edge does not end");
        assert_eq!(ending.unwrap(), Ending::Done);
    }
}

fn args(venue: &Path, endpoint: &str) -> EdgeArgs {
    EdgeArgs {
        venue: venue.to_owned(),
        viewpoint: "a".to_owned(),
        connect: vec![endpoint.to_owned()],
        allow_plaintext: false,
        from_fusion: false,
        venue_name: None,
        accept_older: false,
        certificates: None,
        ticks: None,
        managed: false,
        lines_for_parent: false,
        #[cfg(feature = "study")]
        clock_fault: crate::node::config::ClockFaultArgs::default(),
        ring: Some(venue.with_file_name("ring")),
    }
}

fn start_edge(venue: &Path, endpoint: &str) -> JoinHandle<Result<Ending, NodeError>> {
    start_edge_with(venue, endpoint, Arc::new(RecordedSources))
}

fn start_edge_with(
    venue: &Path,
    endpoint: &str,
    sources: Arc<dyn Sources>,
) -> JoinHandle<Result<Ending, NodeError>> {
    let config = Arc::new(EdgeConfig::load(args(venue, endpoint), sources).unwrap());
    #[expect(clippy::disallowed_methods, reason = "the test waits for its end")]
    tokio::spawn(async move { Box::pin(run(&config)).await })
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_edge_survives_a_restart_of_fusion_in_live_mode() {
    let folder = tempfile::tempdir().unwrap();
    let venue = venue(folder.path());
    let mut fusion = Script::open(&venue, "tcp/127.0.0.1:0", 1, None).await;
    let endpoint = fusion.endpoint.clone();
    let edge = start_edge(&venue, &endpoint);

    let patches: PatchSet = fusion
        .until(1, |f| &f.patches, |set: &PatchSet| !set.persons.is_empty())
        .await;
    assert_eq!(patches.session, SessionId(1));
    assert!(
        (patches.tick - fusion.now()).abs() <= 15,
        "{} at {}",
        patches.tick,
        fusion.now()
    );
    let timing = patches.timing.unwrap();
    assert!((0..1_000_000).contains(&timing.sent_after_us), "{timing:?}");
    assert!(timing.echo.unwrap().held_us < 1_000_000, "{timing:?}");
    let sightings: SightingSet = fusion
        .until(
            1,
            |f| &f.sightings,
            |set: &SightingSet| !set.sightings.is_empty(),
        )
        .await;
    assert_eq!(sightings.sightings[0].keypoints.len(), 17);
    let status: Status = fusion
        .until(
            1,
            |f| &f.statuses,
            |status: &Status| {
                status
                    .live
                    .as_ref()
                    .is_some_and(|live| live.cameras.first().is_some_and(|c| c.frames_per_s > 1.0))
            },
        )
        .await;
    let live = status.live.unwrap();
    assert_eq!(live.epoch_us, Some(fusion.epoch_us as u64));
    assert!(live.bytes_per_s > 0 && status.stages.iter().any(|s| s.stage == "capture to sent"));

    // A new process with the same place and ticks.
    let epoch_us = fusion.epoch_us;
    drop(fusion);
    let mut fusion = Script::open(&venue, &endpoint, 2, Some(epoch_us)).await;
    let patches: PatchSet = fusion
        .until(
            2,
            |f| &f.patches,
            |set: &PatchSet| set.session == SessionId(2) && set.persons.len() == 2,
        )
        .await;
    assert_eq!(
        patches.timing.unwrap().echo.map(|echo| echo.sequence > 0),
        Some(true)
    );
    fusion.end(edge).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_refused_edge_waits_but_ends_if_files_differ() {
    let folder = tempfile::tempdir().unwrap();
    let venue = venue(folder.path());
    let mut fusion = Script::open(&venue, "tcp/127.0.0.1:0", 1, None).await;
    let edge = start_edge(&venue, &fusion.endpoint.clone());
    fusion.until(0, |f| &f.patches, |_: &PatchSet| true).await;
    let refused = link(false, "its clock is 500 ms off");
    let calibration = fusion.own_calibration();
    fusion.say_status(&calibration, vec![refused]).await;
    let status: Status = fusion
        .until(
            0,
            |f| &f.statuses,
            |status: &Status| status.failure.is_some(),
        )
        .await;
    assert!(status.failure.unwrap().contains("500 ms off") && !status.ready);
    fusion.say_status(&calibration, Vec::new()).await;
    fusion
        .until(
            0,
            |f| &f.statuses,
            |status: &Status| status.failure.is_none() && status.ready,
        )
        .await;
    let ended = async {
        while !edge.is_finished() {
            fusion.say_status("another", Vec::new()).await;
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    };
    timeout(PATIENCE, ended).await.expect("the edge goes on");
    let ending = edge.await;
    let error = ending.unwrap().unwrap_err();
    assert!(matches!(&error, NodeError::Refused(_)));
    assert!(error.to_string().contains("calibration"), "{error}");
}

fn link(live: bool, refused: &str) -> EdgeLink {
    EdgeLink {
        viewpoint: "a".to_owned(),
        live,
        refused: Some(refused.to_owned()),
        round_trip_us: None,
        clock_offset_us: None,
        horizon_ticks: 1.0,
        bytes_per_s: 0,
        late: 0,
        missing: 0,
        unreadable: 0,
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_single_message_ends_or_silences_an_edge() {
    let folder = tempfile::tempdir().unwrap();
    let venue = venue(folder.path());
    let mut fusion = Script::open(&venue, "tcp/127.0.0.1:0", 1, None).await;
    let edge = start_edge(&venue, &fusion.endpoint.clone());
    let with_person = |set: &PatchSet| !set.persons.is_empty();
    fusion.until(1, |f| &f.patches, with_person).await;
    let hello: Status = fusion.until(1, |f| &f.statuses, |_: &Status| true).await;

    let track = |f: &Script| f.boxes(0, false, Order::Track);
    let forged = [
        BoxSet {
            session: SessionId(77),
            ..fusion.boxes(0, false, Order::End)
        },
        BoxSet {
            viewpoint: ViewpointIndex(9),
            ..fusion.boxes(0, false, Order::End)
        },
        BoxSet {
            live: None,
            ..track(&fusion)
        },
        BoxSet {
            session: SessionId(78),
            ..track(&fusion)
        },
    ];
    for lie in &forged {
        fusion.boxes.put(wire::encode(lie)).await.unwrap();
    }
    let calibration = fusion.own_calibration();
    let second = format!("process {} is refused", hello.process);
    let lies = [
        fusion.status(&calibration, vec![link(true, &second)]),
        fusion.status("another", Vec::new()),
        Status {
            live: None,
            ..fusion.status(&calibration, Vec::new())
        },
    ];
    for lie in &lies {
        fusion.status.put(wire::encode(lie)).await.unwrap();
        fusion.say_status(&calibration, Vec::new()).await;
    }

    // On a machine that stalls, the foreign sessions are followed for a while.
    let counted = |status: &Status| status.unreadable >= 5 && status.failure.is_none();
    fusion.until(1, |f| &f.statuses, counted).await;
    fusion.until(1, |f| &f.patches, with_person).await;
    // A session with a far higher sequence number also has no effect.
    let now = fusion.now();
    fusion.sequence += 1 << 30;
    fusion
        .boxes
        .put(wire::encode(&track(&fusion)))
        .await
        .unwrap();
    fusion.sequence -= 1 << 30;
    let again = |set: &PatchSet| set.tick > now + 2 * RATE_HZ && !set.persons.is_empty();
    fusion.until(1, |f| &f.patches, again).await;
    fusion.end(edge).await;
}
