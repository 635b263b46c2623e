//! Fusion's link with a real Zenoh client on the loopback.

use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use farfield_node::clock::VenueClock;
use farfield_node::endpoints::Reach;
use farfield_proto::calibration::Calibration;
use farfield_proto::id::{CameraIndex, SessionId, ViewpointIndex};
use farfield_proto::message::thumbnail::Thumbnail;
use farfield_proto::message::{PatchSet, Status};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use farfield_proto::wire;
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use super::{FusionEnds, FusionIncoming, FusionOutgoing, FusionSession, Interceptor, Senders};
use crate::recording::RecordingQueue;
use crate::session::messages::{Liveliness, RunMode};
use crate::session::wiretap::{CopiedMessage, CopiedStep, Wiretap, WiretapHandle};
use crate::status::own_status;

/// Stores the keys of all messages.
#[derive(Default)]
struct Observed {
    received: Mutex<Vec<String>>,
    published: Mutex<Vec<String>>,
    /// Whether it wants thumbnails.
    wants_thumbnails: bool,
    shown: Mutex<Vec<Vec<u8>>>,
}

impl Wiretap for Observed {
    fn received(&self, message: CopiedMessage<'_>) {
        self.received.lock().unwrap().push(message.key.to_owned());
    }

    fn published(&self, message: CopiedMessage<'_>) {
        self.published.lock().unwrap().push(message.key.to_owned());
    }

    fn decided(&self, _: CopiedStep<'_>) {}

    fn wants_thumbnails(&self) -> bool {
        self.wants_thumbnails
    }

    fn thumbnail(&self, message: CopiedMessage<'_>) {
        self.shown.lock().unwrap().push(message.bytes.to_vec());
    }
}

/// Far above the time that a loaded machine needs; a longer wait is a failure.
const PATIENCE: Duration = Duration::from_secs(20);

fn venue() -> Venue {
    let calibration = "[c]\nname = \"c\"\nsize = [640, 480]\nmatrix = [[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]\n\
                       distortions = [0.0, 0.0, 0.0, 0.0, 0.0]\nrotation = [1.5707963, 0.0, 0.0]\ntranslation = [0.0, 1.0, 5.0]\n";
    let text = "name = \"link-test\"\nrate_hz = 30.0\ncalibration = \"c.toml\"\n[[viewpoint]]\nname = \"a\"\n[[viewpoint.camera]]\n\
                name = \"c\"\nsource = { kind = \"keypoints\", path = \"c.jsonl\" }\n";
    let calibration = Calibration::parse(calibration, Path::new("c.toml")).unwrap();
    Venue::parse(text, Path::new("venue.toml"), calibration).unwrap()
}

async fn next(ends: &mut FusionEnds) -> FusionIncoming {
    timeout(PATIENCE, ends.incoming.recv())
        .await
        .expect("fusion receives nothing")
        .expect("the subscriptions have ended")
}

async fn client(endpoint: &str) -> zenoh::Session {
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

async fn check_unusable_messages(edge: &zenoh::Session, ends: &mut FusionEnds, set: PatchSet) {
    let of_another = wire::encode(&PatchSet {
        viewpoint: ViewpointIndex(1),
        ..set
    });
    for bytes in [of_another, vec![0xff; 40]] {
        edge.put("link-test/patch/a", bytes).await.unwrap();
        match next(ends).await {
            FusionIncoming::Unreadable(key, _) => assert_eq!(key, "link-test/patch/a"),
            other => panic!("{other:?}"),
        }
    }
}

/// Fusion's open link, its interceptor and its tasks.
struct OpenLink {
    ends: FusionEnds,
    interceptor: Interceptor,
    endpoint: String,
    tasks: TaskTracker,
    leave: CancellationToken,
}

impl OpenLink {
    async fn open(wiretap: WiretapHandle) -> Self {
        Self::open_in(wiretap, RunMode::LockStep).await
    }

    async fn open_in(wiretap: WiretapHandle, mode: RunMode) -> Self {
        let reach = Reach {
            endpoints: vec!["tcp/127.0.0.1:0".to_owned()],
            identity: None,
            validity: None,
        };
        let senders = Senders::new(&venue(), VenueClock::start());
        let session = FusionSession::listen(&venue(), &reach).await.unwrap();
        let mut link = FusionSession::open(session, &venue(), mode, &senders)
            .await
            .unwrap();
        if mode == RunMode::Live && wiretap.wants_thumbnails() {
            link.accept_thumbnails(&venue(), &senders).await.unwrap();
        }
        let interceptor = Interceptor::new(&venue(), senders, wiretap);
        let endpoint = link.locators().await[0].clone();
        let (tasks, leave) = (TaskTracker::new(), CancellationToken::new());
        Self {
            ends: link.spawn(&tasks, &leave, &interceptor),
            interceptor,
            endpoint,
            tasks,
            leave,
        }
    }

    async fn close(self) {
        timeout(PATIENCE, self.ends.close(&self.tasks, &self.leave))
            .await
            .expect("the tasks do not end");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn messages_and_departure_of_an_edge_are_received_and_boxes_sent() {
    let observed = Arc::new(Observed::default());
    let wiretap = WiretapHandle::new([Arc::clone(&observed) as Arc<dyn Wiretap>]);
    let mut link = OpenLink::open(wiretap).await;
    let edge = client(&link.endpoint).await;
    let token = edge
        .liveliness()
        .declare_token("link-test/alive/a")
        .await
        .unwrap();
    let boxes = edge.declare_subscriber("link-test/box/a").await.unwrap();
    loop {
        // Fusion also receives its own token.
        if matches!(next(&mut link.ends).await, FusionIncoming::Alive(node, Liveliness::There) if node == "a")
        {
            break;
        }
    }

    let set = PatchSet {
        session: SessionId(1 << 63),
        tick: Tick(4),
        viewpoint: ViewpointIndex(0),
        part: 0,
        parts: 1,
        sighting_parts: 0,
        timing: None,
        persons: Vec::new(),
    };
    let bytes = wire::encode(&set);
    edge.put("link-test/patch/a", bytes.clone()).await.unwrap();
    match next(&mut link.ends).await {
        FusionIncoming::Patches(received_set, arrival) => {
            assert_eq!((&received_set, arrival.bytes), (&set, bytes.len() as u64));
            let received = observed.received.lock().unwrap().clone();
            assert_eq!(received, ["link-test/patch/a"]);
        }
        other => panic!("{other:?}"),
    }
    check_unusable_messages(&edge, &mut link.ends, set).await;

    while !*link.ends.matched.borrow() {
        let status = Box::new(own_status(&venue().hashes));
        let status = FusionOutgoing::Status(status);
        link.ends.outgoing.send(status).await.unwrap();
        timeout(PATIENCE, link.ends.matched.changed())
            .await
            .expect("the boxes have no subscriber")
            .unwrap();
    }
    link.ends
        .outgoing
        .send(FusionOutgoing::Boxes(0, vec![1, 2, 3]))
        .await
        .unwrap();
    let sample = timeout(PATIENCE, boxes.recv_async())
        .await
        .expect("the boxes do not come")
        .unwrap();
    assert_eq!(*sample.payload().to_bytes(), [1, 2, 3]);
    let published = observed.published.lock().unwrap().clone();
    assert_eq!(published.last().unwrap(), "link-test/box/a");

    drop(token);
    edge.close().await.unwrap();
    loop {
        if matches!(next(&mut link.ends).await, FusionIncoming::Alive(node, Liveliness::Gone) if node == "a")
        {
            break;
        }
    }
    link.close().await;
}

/// A thumbnail of a camera, as the edge of a viewpoint sends it; `jpeg` is the head of its file.
fn thumbnail(viewpoint: u16, camera: u16, jpeg: &[u8]) -> Vec<u8> {
    wire::encode(&Thumbnail {
        session: SessionId(3),
        tick: Tick(4),
        viewpoint: ViewpointIndex(viewpoint),
        camera: CameraIndex(camera),
        jpeg: jpeg.to_vec(),
    })
}

/// The key of the next unreadable message.
async fn next_unreadable(ends: &mut FusionEnds) -> String {
    loop {
        match next(ends).await {
            FusionIncoming::Unreadable(key, _) => return key,
            FusionIncoming::Alive(..) => {}
            other => panic!("{other:?}"),
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn thumbnails_go_unchanged_to_observers_that_want_them_and_to_no_recorder() {
    const JPEG: [u8; 15] = [
        0xff, 0xd8, 0xff, 0xc0, 0, 11, 8, 0, 180, 1, 64, 1, 1, 0x11, 0,
    ];
    let page = Arc::new(Observed {
        wants_thumbnails: true,
        ..Observed::default()
    });
    let (recorder, notes) = RecordingQueue::open("link-test", SessionId(3));
    let wiretaps: [Arc<dyn Wiretap>; 2] = [Arc::clone(&page) as _, Arc::new(recorder)];
    let mut link = OpenLink::open_in(WiretapHandle::new(wiretaps), RunMode::Live).await;
    let edge = client(&link.endpoint).await;
    let whole = thumbnail(0, 0, &JPEG);
    edge.put("link-test/thumbnail/a", whole.clone())
        .await
        .unwrap();
    // Of another viewpoint, of an unknown camera, under another name, no picture, and a huge picture.
    let huge = [&JPEG[..7], &[0xff, 0xff, 0xff, 0xff, 1, 1, 0x11, 0]].concat();
    for (key, bytes) in [
        ("link-test/thumbnail/a", thumbnail(1, 0, &JPEG)),
        ("link-test/thumbnail/a", thumbnail(0, 1, &JPEG)),
        ("link-test/thumbnail/b", whole.clone()),
        ("link-test/thumbnail/a", thumbnail(0, 0, b"<svg/>")),
        ("link-test/thumbnail/a", thumbnail(0, 0, &huge)),
        ("link-test/thumbnail/a", vec![0xff; 40]),
    ] {
        edge.put(key, bytes).await.unwrap();
        assert_eq!(next_unreadable(&mut link.ends).await, key);
    }
    assert_eq!(*page.shown.lock().unwrap(), [whole]);
    assert!(page.received.lock().unwrap().is_empty());
    assert!(notes.try_iter().next().is_none(), "a picture is recorded");
    edge.close().await.unwrap();
    link.close().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn without_observers_there_is_no_subscriber_for_thumbnails() {
    let observed = Arc::new(Observed::default());
    let wiretaps = [Arc::clone(&observed) as Arc<dyn Wiretap>];
    let mut link = OpenLink::open_in(WiretapHandle::new(wiretaps), RunMode::Live).await;
    let edge = client(&link.endpoint).await;
    let pictures = edge
        .declare_publisher("link-test/thumbnail/a")
        .await
        .unwrap();
    let patches = edge.declare_publisher("link-test/patch/a").await.unwrap();
    let is_subscribed = async {
        while !farfield_node::session::has_listener(&patches) {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    timeout(PATIENCE, is_subscribed)
        .await
        .expect("no subscriber");
    assert!(!farfield_node::session::has_listener(&pictures));
    pictures.put(thumbnail(0, 0, b"x")).await.unwrap();
    patches.put(vec![0xff; 40]).await.unwrap();
    assert_eq!(next_unreadable(&mut link.ends).await, "link-test/patch/a");
    assert!(observed.shown.lock().unwrap().is_empty());
    edge.close().await.unwrap();
    link.close().await;
}

#[test]
fn a_node_may_send_under_its_own_name_only() {
    // Symptom to prevent: with a status under its own key, edge a replaced the process of b.
    let venue = venue();
    let interceptor = Interceptor::new(
        &venue,
        Senders::new(&venue, VenueClock::start()),
        WiretapHandle::default(),
    );
    let status = |node: &str, viewpoint: Option<u16>| Status {
        node: node.to_owned(),
        viewpoint: viewpoint.map(ViewpointIndex),
        ..own_status(&venue.hashes)
    };
    assert!(interceptor.may_send_status("link-test/status/a", &status("a", Some(0))));
    assert!(interceptor.may_send_status("link-test/status/fusion", &status("fusion", None)));
    assert!(interceptor.may_send_status("link-test/status/screen", &status("screen", None)));
    for (node, viewpoint) in [("b", None), ("a", None), ("a", Some(1)), ("fusion", None)] {
        assert!(
            !interceptor.may_send_status("link-test/status/a", &status(node, viewpoint)),
            "{node} {viewpoint:?}"
        );
    }
    assert!(!interceptor.may_send_status("link-test/status/screen", &status("screen", Some(0))));
    // In another venue file the edge has another index: the difference of the files is reported, not an unreadable message.
    let elsewhere = Status {
        venue_hash: "another".to_owned(),
        ..status("a", Some(1))
    };
    assert!(interceptor.may_send_status("link-test/status/a", &elsewhere));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_older_edge_gets_messages_of_its_version_until_it_is_updated() {
    let mut link = OpenLink::open(WiretapHandle::default()).await;
    let edge = client(&link.endpoint).await;
    let statuses = edge
        .declare_subscriber("link-test/status/fusion")
        .await
        .unwrap();
    let own = Status {
        node: "a".to_owned(),
        viewpoint: Some(ViewpointIndex(0)),
        ..own_status(&venue().hashes)
    };
    // The version of the status, and of the attachment: an old node has none.
    for (written, reads, expected) in [
        (wire::OLDEST_WRITTEN, None, wire::OLDEST_WRITTEN),
        (wire::OLDEST_WRITTEN, Some(wire::VERSION), wire::VERSION),
        (wire::VERSION, Some(wire::VERSION + 1), wire::VERSION),
    ] {
        let put = edge.put("link-test/status/a", wire::encode_as(&own, written));
        put.attachment(reads.map(|version| vec![version]))
            .await
            .unwrap();
        loop {
            if matches!(next(&mut link.ends).await, FusionIncoming::Status(status) if status.node == "a")
            {
                break;
            }
        }
        assert_eq!(link.interceptor.version_for(0), expected);
        let status = FusionOutgoing::Status(Box::new(own_status(&venue().hashes)));
        link.ends.outgoing.send(status).await.unwrap();
        let sample = timeout(PATIENCE, statuses.recv_async()).await;
        let sample = sample.expect("fusion sends no status").unwrap();
        assert_eq!(sample.payload().to_bytes()[0], expected);
        assert_eq!(
            farfield_node::session::reads_at_most(&sample),
            Some(wire::VERSION)
        );
    }
    edge.close().await.unwrap();
    link.close().await;
}
