//! Fusion's fillers with an edge on a real Zenoh link.

use std::path::Path;
use std::time::Duration;

use farfield_fusion::align::TickGroup;
use farfield_proto::calibration::Calibration;
use farfield_proto::message::decision::Decision;
use zenoh::query::Query;

use super::super::queue::Note;
use super::*;

const SESSION: SessionId = SessionId(7);
/// Far above the time that a loaded machine needs.
const PATIENCE: Duration = Duration::from_secs(20);

fn venue() -> Venue {
    let calibration = "[c]\nname = \"c\"\nsize = [640, 480]\nmatrix = [[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]\n\
                       distortions = [0.0, 0.0, 0.0, 0.0, 0.0]\nrotation = [1.5707963, 0.0, 0.0]\ntranslation = [0.0, 1.0, 5.0]\n";
    let text = "name = \"fill-test\"\nrate_hz = 30.0\ncalibration = \"c.toml\"\n[[viewpoint]]\nname = \"a\"\n[[viewpoint.camera]]\n\
                name = \"c\"\nsource = { kind = \"keypoints\", path = \"c.jsonl\" }\n[recording]\nfill_share = 1.0\n";
    let calibration = Calibration::parse(calibration, Path::new("c.toml")).unwrap();
    Venue::parse(text, Path::new("venue.toml"), calibration).unwrap()
}

async fn open(settings: &[(&str, String)]) -> Session {
    let mut config = zenoh::Config::default();
    config
        .insert_json5("scouting/multicast/enabled", "false")
        .unwrap();
    for (key, value) in settings {
        config.insert_json5(key, value).unwrap();
    }
    zenoh::open(config).await.unwrap()
}

fn patches(session: SessionId, tick: i64) -> PatchSet {
    PatchSet {
        session,
        tick: Tick(tick),
        viewpoint: ViewpointIndex(0),
        part: 0,
        parts: 1,
        sighting_parts: 0,
        timing: None,
        persons: Vec::new(),
    }
}

/// A tick missing from the edge's ring.
const LOST: i64 = 14;

/// Answers with two ticks at a time and with unrequested sets; the first answer is empty.
fn answer(request: &FillRequest, n_before: usize) -> Filled {
    let to = request.to.min(request.from + 2);
    let stored = (request.from.0..to.0).filter(|tick| *tick != LOST);
    let ticks = stored.map(|tick| patches(SESSION, tick));
    let foreign = patches(SessionId(9), request.from.0);
    let far = patches(SESSION, request.from.0 - 100);
    let stored = ticks.chain([foreign, far]).map(|set| StoredSet {
        kind: SetKind::Patches,
        bytes: wire::encode(&set),
    });
    let invalid = StoredSet {
        kind: SetKind::Sightings,
        bytes: b"invalid".to_vec(),
    };
    if n_before == 0 {
        return Filled {
            to: request.from,
            stored: Vec::new(),
        };
    }
    Filled {
        to,
        stored: stored.chain([invalid]).collect(),
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn only_missing_sets_are_fetched_and_recorded() {
    let fusion = open(&[
        ("mode", "\"router\"".to_owned()),
        ("listen/endpoints", "[\"tcp/127.0.0.1:0\"]".to_owned()),
    ])
    .await;
    let endpoint = fusion.info().locators().await[0].to_string();
    let edge = open(&[
        ("mode", "\"client\"".to_owned()),
        ("connect/endpoints", format!("[\"{endpoint}\"]")),
    ])
    .await;
    let requests = edge.declare_queryable("fill-test/fill/a").await.unwrap();
    let (tasks, stop) = (TaskTracker::new(), CancellationToken::new());
    tasks.spawn(async move {
        let mut n = 0;
        while let Ok(query) = requests.recv_async().await {
            let query: Query = query;
            let request = query.payload().unwrap().to_bytes();
            let request = wire::decode::<FillRequest>(&request).unwrap();
            let answer = wire::encode(&answer(&request, n));
            query.reply("fill-test/fill/a", answer).await.unwrap();
            n += 1;
        }
    });

    let (queue, notes) = RecordingQueue::open("fill-test", SESSION);
    let fillers = Fillers {
        session: SESSION,
        queue: Arc::new(queue),
        holes: SharedHoles::new(Holes::new(SESSION, 1, 10)),
        clock: VenueClock::start(),
    };
    let group = |tick| TickGroup {
        tick: Tick(tick),
        ..TickGroup::default()
    };
    for tick in 0..30 {
        if !(10..17).contains(&tick) {
            fillers.holes.lock().patches(&patches(SESSION, tick));
        }
        let decision: Decision = group(tick).decision(SESSION, Tick(0));
        fillers.holes.lock().worked_on(decision.tick);
    }
    assert_eq!(fillers.holes.lock().left(), 7);
    fillers.spawn(&fusion, &venue(), &tasks, &stop);
    fillers.finish(PATIENCE).await;
    stop.cancel();
    assert_eq!(fillers.holes.lock().left(), 7, "nothing is written yet");
    let sets: Vec<PatchSet> = notes
        .try_iter()
        .filter_map(|note| match note {
            Note::Passed(passed) => {
                assert_eq!(passed.topic, "fill-test/fill/a/patch");
                let set = wire::decode::<PatchSet>(&passed.bytes).unwrap();
                assert_eq!(set.session, SESSION);
                Some(set)
            }
            Note::End => None,
        })
        .collect();
    let ticks: Vec<i64> = sets.iter().map(|set| set.tick.0).collect();
    assert_eq!(ticks, [10, 11, 12, 13, 15, 16]);
    for set in &sets {
        fillers.holes.lock().patches(set);
    }
    assert_eq!(fillers.holes.lock().left(), 1, "the ring has lost one");
}
