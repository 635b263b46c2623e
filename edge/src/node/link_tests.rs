//! Tests of the edge's link with a real Zenoh router on the loopback.

use std::time::Duration;

use farfield_proto::id::{SessionId, ViewpointIndex};
use farfield_proto::message::{BoxSet, Order};
use farfield_proto::tick::Tick;
use farfield_proto::transport::EdgeTransport;
use farfield_proto::wire;
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use super::{EdgeEnds, EdgeIncoming, EdgeOutgoing, EdgeSession};

/// Far longer than a loaded machine needs; a test that waits this long has failed.
const PATIENCE: Duration = Duration::from_secs(20);

async fn router() -> (zenoh::Session, String) {
    let mut config = zenoh::Config::default();
    let settings = [
        ("mode", "\"router\""),
        ("scouting/multicast/enabled", "false"),
        ("listen/endpoints", "[\"tcp/127.0.0.1:0\"]"),
    ];
    for (key, value) in settings {
        config.insert_json5(key, value).unwrap();
    }
    let session = zenoh::open(config).await.unwrap();
    let endpoint = session.info().locators().await[0].to_string();
    (session, endpoint)
}

async fn next(ends: &mut EdgeEnds) -> EdgeIncoming {
    timeout(PATIENCE, ends.incoming.recv())
        .await
        .expect("the edge receives nothing")
        .expect("the subscriptions have ended")
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn boxes_arrive_patches_leave_in_order_and_a_disconnection_is_reported() {
    let (fusion, endpoint) = router().await;
    let patches = fusion
        .declare_subscriber("link-test/patch/*")
        .await
        .unwrap();
    let sightings = fusion
        .declare_subscriber("link-test/sighting/*")
        .await
        .unwrap();
    let transport = EdgeTransport {
        venue: "link-test",
        connect: &[endpoint],
        identity: None,
    };
    let link = timeout(PATIENCE, EdgeSession::open(&transport, "a"))
        .await
        .expect("no connection")
        .unwrap();
    let (tasks, leave) = (TaskTracker::new(), CancellationToken::new());
    let mut ends = link.spawn(&tasks, &leave);

    while !*ends.matched.borrow() {
        ends.outgoing
            .send(EdgeOutgoing::Status(Vec::new()))
            .await
            .unwrap();
        timeout(PATIENCE, ends.matched.changed())
            .await
            .expect("there is no subscriber to patches")
            .unwrap();
    }
    ends.outgoing
        .send(EdgeOutgoing::Sightings(vec![7]))
        .await
        .unwrap();
    for part in 0..3u8 {
        ends.outgoing
            .send(EdgeOutgoing::Patches(vec![part]))
            .await
            .unwrap();
    }
    let sighting = timeout(PATIENCE, sightings.recv_async())
        .await
        .expect("no sighting")
        .unwrap();
    assert_eq!(*sighting.payload().to_bytes(), [7]);
    for part in 0..3u8 {
        let sample = timeout(PATIENCE, patches.recv_async())
            .await
            .expect("no patch")
            .unwrap();
        assert_eq!(
            (sample.key_expr().as_str(), &*sample.payload().to_bytes()),
            ("link-test/patch/a", &[part][..])
        );
    }

    let boxes = BoxSet {
        session: SessionId(1),
        tick: Tick(3),
        viewpoint: ViewpointIndex(0),
        part: 0,
        parts: 1,
        order: Order::Track,
        live: None,
        detection_cameras: Vec::new(),
        persons: Vec::new(),
    };
    let token = fusion
        .liveliness()
        .declare_token("link-test/alive/fusion")
        .await
        .unwrap();
    let publisher = fusion.declare_publisher("link-test/box/a").await.unwrap();
    publisher.put(wire::encode(&boxes)).await.unwrap();
    match next(&mut ends).await {
        EdgeIncoming::Boxes(received) => assert_eq!(received, boxes),
        other => panic!("{other:?}"),
    }
    drop((publisher, token));
    fusion.close().await.unwrap();
    assert!(matches!(next(&mut ends).await, EdgeIncoming::FusionGone));
    timeout(PATIENCE, ends.close(&tasks, &leave))
        .await
        .expect("the tasks do not end");
}
