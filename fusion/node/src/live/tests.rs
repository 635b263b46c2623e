//! A live run over real sockets, with scripted edges.

use std::path::Path;
use std::time::Duration;

use farfield_fusion::export::summary::Summary;
use farfield_fusion::live::tick_time::TickTime;
use farfield_node::clock::VenueClock;
use farfield_node::endpoints::Reach;
use farfield_node::process::Managed;
use farfield_proto::calibration::Calibration;
use farfield_proto::id::SessionId;
use farfield_proto::message::health::NodeHealth;
use farfield_proto::message::live::{BoxEcho, EdgeLink, PatchTiming};
use farfield_proto::message::{BoxSet, Order, PatchSet, PoseSet, Status};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use farfield_proto::wire;
use tokio::time::{sleep, timeout};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use zenoh::Session;
use zenoh::qos::{CongestionControl, Reliability};

use super::super::config::FusionConfig;
use super::*;
use crate::output::progress::{Detail, Reporter};
use crate::output::summary_file::SummaryFile;
use crate::session::interceptor::{Interceptor, Senders};
use crate::session::link::FusionSession;
use crate::session::other_fusion::OtherFusionWatch;
use crate::session::wiretap::WiretapHandle;

/// Far above the time that a loaded machine needs; a longer wait is a failure.
const PATIENCE: Duration = Duration::from_secs(40);
const RATE_HZ: f64 = 30.0;
const TICKS: i64 = 90;
const NAMES: [&str; 4] = ["a", "b", "c", "d"];

pub(crate) fn venue() -> Venue {
    let camera = |name: &&str| {
        format!(
            "[{name}]\nname = \"{name}\"\nsize = [640, 480]\nmatrix = [[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]\n\
             distortions = [0.0, 0.0, 0.0, 0.0, 0.0]\nrotation = [1.5707963, 0.0, 0.0]\ntranslation = [0.0, 1.0, 5.0]\n"
        )
    };
    let viewpoint = |name: &&str| {
        format!(
            "[[viewpoint]]\nname = \"{name}\"\n[[viewpoint.camera]]\nname = \"{name}\"\n\
             source = {{ kind = \"keypoints\", path = \"{name}.jsonl\" }}\n"
        )
    };
    let calibration: String = NAMES.iter().map(camera).collect();
    let viewpoints: String = NAMES.iter().map(viewpoint).collect();
    let head = format!("name = \"live-test\"\nrate_hz = {RATE_HZ:?}\ncalibration = \"c.toml\"\n");
    let calibration = Calibration::parse(&calibration, Path::new("c.toml")).unwrap();
    Venue::parse(&(head + &viewpoints), Path::new("venue.toml"), calibration).unwrap()
}

async fn client(endpoint: &str) -> Session {
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", "\"client\"".to_owned()),
        ("scouting/multicast/enabled", "false".to_owned()),
        ("connect/endpoints", format!("[\"{endpoint}\"]")),
    ] {
        config.insert_json5(key, &value).unwrap();
    }
    zenoh::open(config).await.unwrap()
}

/// An edge without people.
struct Scripted {
    index: u16,
    /// Offset of its clock.
    shift_us: i64,
    calibration_hash: String,
    venue_hash: String,
    /// Sends invalid bytes with every tick.
    sends_invalid: bool,
    clock: VenueClock,
}

impl Scripted {
    fn name(&self) -> &'static str {
        NAMES[usize::from(self.index)]
    }

    fn status(&self) -> Status {
        Status {
            node: self.name().to_owned(),
            process: u64::from(self.index) + 1,
            viewpoint: Some(farfield_proto::id::ViewpointIndex(self.index)),
            release: String::new(),
            ready: true,
            venue_hash: self.venue_hash.clone(),
            calibration_hash: self.calibration_hash.clone(),
            network_hash: String::new(),
            backend: String::new(),
            ticks: Some([Tick(0), Tick(TICKS)]),
            tick: None,
            unreadable: 0,
            failure: None,
            stages: Vec::new(),
            live: None,
            health: NodeHealth::default(),
            agreement: Vec::new(),
        }
    }

    /// Runs until the end order; returns the number of received box sets.
    async fn run(self, endpoint: String) -> u32 {
        let session = client(&endpoint).await;
        let name = self.name();
        let alive = format!("live-test/alive/{name}");
        let token = session.liveliness().declare_token(alive).await.unwrap();
        let boxes = session
            .declare_subscriber(format!("live-test/box/{name}"))
            .await
            .unwrap();
        let patches = session
            .declare_publisher(format!("live-test/patch/{name}"))
            .congestion_control(CongestionControl::Drop)
            .reliability(Reliability::BestEffort)
            .await
            .unwrap();
        let own_us = || self.clock.now_us() + self.shift_us;
        let mut newest: Option<(BoxSet, i64)> = None;
        let (mut last, mut received, mut statuses) = (None, 0, 0u32);
        loop {
            while let Ok(Some(sample)) = boxes.try_recv() {
                let set: BoxSet = wire::decode(&sample.payload().to_bytes()).unwrap();
                if set.order == Order::End {
                    drop(token);
                    session.close().await.unwrap();
                    return received;
                }
                received += 1;
                newest = Some((set, own_us()));
            }
            statuses += 1;
            if statuses % 100 == 1 {
                let key = format!("live-test/status/{name}");
                session
                    .put(key, wire::encode(&self.status()))
                    .await
                    .unwrap();
            }
            if let Some((set, received_us)) = &newest {
                let live = set.live.unwrap();
                let time = TickTime::new(live.epoch_us, RATE_HZ);
                let correction_us = live.clock_correction_us.unwrap_or(0);
                let now_us = own_us() + i64::from(correction_us);
                let tick = time.first_from(now_us) + -1;
                if tick >= Tick(0) && last.is_none_or(|last| tick > last) {
                    last = Some(tick);
                    let timing = PatchTiming {
                        sent_after_us: (now_us - time.at(tick)) as i32,
                        clock_correction_us: correction_us,
                        echo: Some(BoxEcho {
                            sequence: live.sequence,
                            held_us: (own_us() - received_us) as u32,
                        }),
                    };
                    let set = PatchSet {
                        session: set.session,
                        tick,
                        viewpoint: set.viewpoint,
                        part: 0,
                        parts: 1,
                        sighting_parts: 0,
                        timing: Some(timing),
                        persons: Vec::new(),
                    };
                    patches.put(wire::encode(&set)).await.unwrap();
                    if self.sends_invalid {
                        patches.put(vec![0xff; 30]).await.unwrap();
                    }
                }
            }
            sleep(Duration::from_millis(2)).await;
        }
    }
}

/// Subscribes to poses and fusion's status; returns the ticks, and the last status with edges.
async fn listen(endpoint: String, stop: CancellationToken) -> (Vec<i64>, Option<Status>) {
    let session = client(&endpoint).await;
    let poses = session.declare_subscriber("live-test/pose").await.unwrap();
    let status = session
        .declare_subscriber("live-test/status/fusion")
        .await
        .unwrap();
    let (mut ticks, mut newest) = (Vec::new(), None);
    loop {
        tokio::select! {
            () = stop.cancelled() => break,
            sample = poses.recv_async() => {
                let set: PoseSet = wire::decode(&sample.unwrap().payload().to_bytes()).unwrap();
                ticks.push(set.tick.0);
            }
            sample = status.recv_async() => {
                let status: Status = wire::decode(&sample.unwrap().payload().to_bytes()).unwrap();
                if status.live.as_ref().is_some_and(|live| !live.edges.is_empty()) {
                    newest = Some(status);
                }
            }
        }
    }
    session.close().await.unwrap();
    (ticks, newest)
}

/// A live run on any free port.
fn live_config() -> FusionConfig {
    FusionConfig {
        mode: RunMode::Live,
        reach: Reach {
            endpoints: vec!["tcp/127.0.0.1:0".to_owned()],
            identity: None,
            validity: None,
        },
        ..FusionConfig::with_venue(venue())
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_run_continues_despite_faulty_edges() {
    let out = tempfile::tempdir().unwrap();
    let config = live_config();
    let clock = VenueClock::start();
    let senders = Senders::new(&config.venue, clock.clone());
    let session = FusionSession::listen(&config.venue, &config.reach).await;
    let link = FusionSession::open(session.unwrap(), &config.venue, config.mode, &senders)
        .await
        .unwrap();
    let endpoint = link.locators().await[0].clone();
    let tasks = TaskTracker::new();
    let [leave, stop] = [CancellationToken::new(), CancellationToken::new()];
    let interceptor = Interceptor::new(&config.venue, senders, WiretapHandle::default());
    let mut ends = link.spawn(&tasks, &leave, &interceptor);
    let edge = |index: u16, shift_ms: i64| Scripted {
        index,
        shift_us: shift_ms * 1000,
        calibration_hash: config.venue.hashes.calibration.clone(),
        venue_hash: config.venue.hashes.venue.clone(),
        sends_invalid: false,
        clock: clock.clone(),
    };
    let edges = [
        Scripted {
            sends_invalid: true,
            ..edge(0, 0)
        },
        edge(1, 20),
        edge(2, 500),
        Scripted {
            calibration_hash: "another".to_owned(),
            ..edge(3, 0)
        },
    ];
    let listener = tasks.spawn(listen(endpoint.clone(), leave.clone()));
    let edges: Vec<_> = edges
        .map(|edge| tasks.spawn(edge.run(endpoint.clone())))
        .into();
    let session = SessionId(1 << 63);
    let pipeline = Pipeline::new(&config.venue, None, session);
    let mut reporter = Reporter::new(Managed::No, Detail::Counts);
    let mut summary = SummaryFile::in_folder(out.path());
    let context = LiveContext {
        config: &config,
        session,
        out: out.path(),
        summary: &mut summary,
        recording: None,
        on_demand: None,
        interceptor: &interceptor,
        ends: &mut ends,
        reporter: &mut reporter,
        stop: &stop,
        others: OtherFusionWatch::nowhere(),
    };
    let ending = timeout(PATIENCE, Box::pin(live(context, pipeline)))
        .await
        .unwrap();
    assert_eq!(ending.unwrap(), Ending::Done);
    summary.finish(None).unwrap();
    for edge in edges {
        let received = timeout(PATIENCE, edge).await.unwrap().unwrap();
        assert!(
            received > TICKS as u32 / 2,
            "boxes are sent at every tick: {received}"
        );
    }
    timeout(PATIENCE, ends.close(&tasks, &leave)).await.unwrap();
    let (ticks, newest) = timeout(PATIENCE, listener).await.unwrap().unwrap();
    assert!(ticks.is_sorted_by(|a, b| a < b), "{ticks:?}");
    let newest = newest.unwrap();
    for stage in ["capture_to_pose", "pose_out", "patch_arrived"] {
        let time = newest.stages.iter().find(|time| time.stage == stage);
        assert!(time.is_some_and(|time| time.count > 10), "{stage}");
    }
    assert!(!newest.ready, "its last status announces the end");
    check_links(&newest.live.unwrap().edges);
    check_summary(out.path());
}

fn check_links(links: &[EdgeLink]) {
    let [a, b, c, d] = links else {
        panic!("{links:?}");
    };
    assert!(a.live && a.refused.is_none() && a.unreadable > 10, "{a:?}");
    assert!(b.live && b.refused.is_none(), "{b:?}");
    let off_us = |link: &EdgeLink| link.clock_offset_us.unwrap();
    // The round trip over loopback bounds the error.
    assert!((off_us(a)).abs() < 10_000 && (off_us(b) - 20_000).abs() < 10_000);
    let refused = c.refused.as_deref().unwrap();
    assert!(!c.live && refused.contains("clock_bound_ms"), "{c:?}");
    let refused = d.refused.as_deref().unwrap();
    assert!(!d.live && refused.contains("calibration"), "{d:?}");
}

fn check_summary(out: &Path) {
    let text = std::fs::read_to_string(out.join("summary.json")).unwrap();
    let summary: Summary = serde_json::from_str(&text).unwrap();
    assert!(summary.complete);
    assert_eq!((summary.ticks.first, summary.ticks.done), (Tick(0), 90));
    assert!(summary.drops.unreadable > 10 && summary.drops.refused > 10);
    for stage in [
        "fusion/capture_to_pose",
        "fusion/pose_out",
        "a/patch_arrived",
    ] {
        let time = summary.timing.stages.get(stage).unwrap();
        assert!(time.p50_us > 0.0 && time.p999_us <= time.max_us, "{stage}");
    }
}
