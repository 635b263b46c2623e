//! Other fusions of the venue, as real sessions on the loopback.

use std::path::Path;

use farfield_proto::calibration::Calibration;
use farfield_proto::message::health::NodeHealth;
use farfield_proto::transport::FusionTransport;
use farfield_proto::venue::VenueHash;

use zenoh::liveliness::LivelinessToken;

use super::*;
use crate::status::own_status;

/// Far above the time that a loaded machine needs; a longer wait is a failure.
const PATIENCE: Duration = Duration::from_secs(20);

fn venue(connect: &[String]) -> Venue {
    let calibration = "[c]\nname = \"c\"\nsize = [640, 480]\nmatrix = [[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]\n\
                       distortions = [0.0, 0.0, 0.0, 0.0, 0.0]\nrotation = [1.5707963, 0.0, 0.0]\ntranslation = [0.0, 1.0, 5.0]\n";
    let text = format!(
        "name = \"two\"\nrate_hz = 30.0\ncalibration = \"c.toml\"\n[fusion]\nconnect = {connect:?}\n[[viewpoint]]\nname = \"a\"\n\
         [[viewpoint.camera]]\nname = \"c\"\nsource = {{ kind = \"keypoints\", path = \"c.jsonl\" }}\n"
    );
    let calibration = Calibration::parse(calibration, Path::new("c.toml")).unwrap();
    Venue::parse(&text, Path::new("venue.toml"), calibration).unwrap()
}

fn reach(listen: &str) -> Reach {
    Reach {
        endpoints: vec![listen.to_owned()],
        identity: None,
        validity: None,
    }
}

/// A node that listens and has not declared its token.
async fn listening() -> (Session, String) {
    let listen = ["tcp/127.0.0.1:0".to_owned()];
    let transport = FusionTransport {
        venue: "two",
        viewpoints: &["a"],
        listen: &listen,
        identity: None,
    };
    let session = session::listen(&transport).await.unwrap();
    let endpoint = session.info().locators().await[0].to_string();
    (session, endpoint)
}

async fn declare_token(session: &Session) -> LivelinessToken {
    let token = session.liveliness().declare_token("two/alive/fusion").await;
    token.unwrap()
}

/// A fusion that listens and has not begun to work.
async fn just_begun() -> (Session, LivelinessToken, String) {
    let (session, endpoint) = listening().await;
    let token = declare_token(&session).await;
    (session, token, endpoint)
}

/// A fusion that repeats its status, and its endpoint.
async fn first_fusion() -> (Session, String) {
    let (session, token, endpoint) = just_begun().await;
    let speaker = session.clone();
    TaskTracker::new().spawn(async move {
        let _token = token;
        let hashes = VenueHash {
            venue: "v".to_owned(),
            calibration: "c".to_owned(),
        };
        let status = Status {
            tick: Some(Tick(77)),
            health: NodeHealth {
                follows: Some(SessionId(0xabc)),
                ..NodeHealth::default()
            },
            ..own_status(&hashes)
        };
        loop {
            if speaker
                .put("two/status/fusion", wire::encode(&status))
                .await
                .is_err()
            {
                return;
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    });
    (session, endpoint)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_second_fusion_is_refused_in_lock_step_and_waits_live() {
    let (first, endpoint) = first_fusion().await;
    let (tasks, leave, stop) = <(TaskTracker, CancellationToken, CancellationToken)>::default();
    let venue = venue(std::slice::from_ref(&endpoint));
    let others = OtherFusionWatch::start(&venue, &reach("tcp/127.0.0.1:0"), &tasks, &leave).await;
    let refused = others.wait_until_alone(RunMode::LockStep, &stop).await;
    let refused = refused.unwrap_err();
    assert!(matches!(refused, NodeError::Refused(_)));
    let refused = refused.to_string();
    for word in [&endpoint, "venue two", "session abc", "tick 77", "end it"] {
        assert!(refused.contains(word), "{word}: {refused}");
    }
    let live = others.wait_until_alone(RunMode::Live, &stop);
    let end = async {
        tokio::time::sleep(Duration::from_millis(200)).await;
        first.close().await.unwrap();
    };
    let waited = async { tokio::join!(live, end).0 };
    let waited = tokio::time::timeout(PATIENCE, waited).await;
    let place = waited.expect("the wait does not end").unwrap();
    assert_eq!(place, Some(Place::Inherited));
    assert_eq!(others.described(), None);
    leave.cancel();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_single_fusion_begins_and_does_not_detect_itself() {
    let (own, endpoint) = first_fusion().await;
    let (tasks, leave, stop) = <(TaskTracker, CancellationToken, CancellationToken)>::default();
    let venue = venue(&["tcp/127.0.0.1:9".to_owned(), endpoint.clone()]);
    // It listens there itself, so no other fusion can.
    let others = OtherFusionWatch::start(&venue, &reach(&endpoint), &tasks, &leave).await;
    assert_eq!(others.endpoints, ["tcp/127.0.0.1:9"]);
    let place = others.wait_until_alone(RunMode::LockStep, &stop).await;
    assert_eq!(place.unwrap(), Some(Place::Free));
    // Over an indirect route it answers itself.
    let indirect = OtherFusionWatch::at(
        "two",
        vec![endpoint],
        &reach("tcp/10.0.0.1:1"),
        &tasks,
        &leave,
    );
    indirect.set_own(own.zid());
    assert_eq!(indirect.first().await, None);
    leave.cancel();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_session_set_before_its_token_is_never_detected() {
    // Symptom to prevent: over an indirect route a fusion detected its own token before it had set its session.
    let (own, endpoint) = listening().await;
    let (tasks, leave) = <(TaskTracker, CancellationToken)>::default();
    let elsewhere = reach("tcp/10.0.0.1:1");
    let indirect = OtherFusionWatch::at("two", vec![endpoint], &elsewhere, &tasks, &leave);
    assert_eq!(indirect.first().await, None, "there is no token yet");
    indirect.set_own(own.zid());
    let _token = declare_token(&own).await;
    assert_eq!(indirect.first().await, None);
    leave.cancel();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn one_of_two_simultaneous_fusions_steps_back() {
    let (one, _one_token, at_one) = just_begun().await;
    let (other, _other_token, at_other) = just_begun().await;
    let (tasks, leave) = <(TaskTracker, CancellationToken)>::default();
    let places = [at_one, at_other];
    let elsewhere = reach("tcp/10.0.0.1:1");
    // Each also detects itself over an indirect route.
    let watch = || OtherFusionWatch::at("two", places.to_vec(), &elsewhere, &tasks, &leave);
    let [of_one, of_other] = [watch(), watch()];
    of_one.set_own(one.zid());
    of_other.set_own(other.zid());
    let steps_back = tokio::join!(
        of_one.must_step_back(one.zid()),
        of_other.must_step_back(other.zid())
    );
    assert_ne!(steps_back.0, steps_back.1);
    leave.cancel();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_starting_fusion_steps_back_for_one_at_work() {
    let (_at_work, endpoint) = first_fusion().await;
    let (own, _token, _) = just_begun().await;
    let (tasks, leave) = <(TaskTracker, CancellationToken)>::default();
    let others = OtherFusionWatch::at(
        "two",
        vec![endpoint],
        &reach("tcp/10.0.0.1:1"),
        &tasks,
        &leave,
    );
    others.set_own(own.zid());
    // With this lowest id it would continue if both were starting.
    let lowest: ZenohId = "1".parse().unwrap();
    assert!(others.must_step_back(lowest).await);
    leave.cancel();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_lower_id_continues_unless_the_other_is_at_work() {
    let (one, _, _) = just_begun().await;
    let (other, _, _) = just_begun().await;
    let mut ids = [one.zid(), other.zid()];
    ids.sort_by_key(|id| id.to_le_bytes());
    let [low, high] = ids;
    let begun = OtherFusion::unknown;
    assert!(begun(Some(low)).comes_before(high));
    assert!(!begun(Some(high)).comes_before(low));
    assert!(!begun(None).comes_before(low));
    let hashes = VenueHash {
        venue: "v".to_owned(),
        calibration: "c".to_owned(),
    };
    let at_work = begun(Some(high)).with_status(&own_status(&hashes));
    assert!(at_work.comes_before(low));
}

#[test]
fn a_taken_endpoint_is_watched_at_an_address_that_answers() {
    assert_eq!(reachable("quic/0.0.0.0:7447"), "quic/127.0.0.1:7447");
    assert_eq!(reachable("tcp/[::]:7447?a=b"), "tcp/[::1]:7447?a=b");
    assert_eq!(reachable("tcp/10.0.0.7:7447"), "tcp/10.0.0.7:7447");
}
