//! What pages get, now and of the past, also those that do not read.

use super::*;
use crate::state::thumbnails::tests::message;

#[tokio::test]
async fn a_page_that_follows_gets_what_is_new() {
    let running = Running::live().await;
    let mut socket = running.open("/ws").await;
    running.pass_and_wait([0, 40]).await;
    let last = tick_at(&mut socket, 39).await;
    assert!(last.is_live && last.persons.len() == 3);
    let mut json = running.open("/ws/json").await;
    let told = text(&mut json, "tick", |_| true).await;
    assert_eq!((&told["tick"], &told["live"]), (&39.into(), &true.into()));
    assert_eq!(told["persons"][0]["joints_m"].as_array().unwrap().len(), 29);
    assert_eq!(told["persons"][0]["angles"].as_array().unwrap().len(), 40);
    running.end().await;
}

#[tokio::test]
async fn a_page_that_does_not_read_costs_nobody_anything_and_skips_to_what_is_new() {
    let running = Running::live().await;
    let mut stalled = Vec::new();
    for _ in 0..10 {
        stalled.push(running.open("/ws").await);
    }
    // More than all buffers of the network together would hold.
    for from in (0..6000).step_by(100) {
        running.pass_and_wait([from, from + 100]).await;
        // Clients are other tasks of this test's one thread.
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    assert_eq!(running.state.dropped(), 0);
    for socket in &mut stalled {
        let mut old = 0;
        while tick(socket).await.tick != Tick(5999) {
            old += 1;
        }
        assert!(old <= 3 * 16, "{old} old ticks waited for it");
    }
    running.end().await;
}

#[tokio::test]
async fn every_page_goes_through_the_past_for_itself() {
    let running = Running::live().await;
    running.pass_and_wait([0, 200]).await;
    let [mut socket, mut other] = [running.open("/ws").await, running.open("/ws").await];
    tick_at(&mut socket, 199).await;
    say(&mut socket, r#"{"do": "seek", "tick": 100}"#).await;
    assert!(!tick_at(&mut socket, 100).await.is_live);
    let playback = text(&mut socket, "playback", |message| message["tick"] == 100).await;
    assert_eq!(
        (&playback["state"], &playback["first"], &playback["last"]),
        (&"paused".into(), &0.into(), &199.into())
    );
    say(&mut socket, r#"{"do": "step", "ticks": -1}"#).await;
    tick_at(&mut socket, 99).await;
    say(&mut socket, r#"{"do": "seek", "tick": 1000000}"#).await;
    tick_at(&mut socket, 199).await;
    say(
        &mut socket,
        r#"{"do": "play", "speed": 8, "loop": [50, 53]}"#,
    )
    .await;
    for at in [50, 53, 50, 53] {
        tick_at(&mut socket, at).await;
    }
    say(&mut socket, r#"{"do": "live"}"#).await;
    text(&mut socket, "playback", |message| {
        message["state"] == "live"
    })
    .await;
    running.pass_and_wait([200, 201]).await;
    assert!(tick_at(&mut socket, 200).await.is_live);
    assert!(tick_at(&mut other, 200).await.is_live);
    running.end().await;
}

#[tokio::test]
async fn who_stays_at_a_tick_hears_every_second_that_the_server_is_there() {
    let running = Running::live().await;
    running.pass_and_wait([0, 40]).await;
    let mut socket = running.open("/ws").await;
    say(&mut socket, r#"{"do": "seek", "tick": 10}"#).await;
    text(&mut socket, "playback", |message| message["tick"] == 10).await;
    for _ in 0..3 {
        // A page gives a server up that is silent for five.
        let told = timeout(Duration::from_secs(4), next(&mut socket)).await;
        assert!(told.is_ok(), "silent");
    }
    running.end().await;
}

#[tokio::test]
async fn who_chooses_a_camera_in_the_past_stays_there() {
    let running = Running::live().await;
    running.pass_and_wait([0, 40]).await;
    let mut socket = running.open("/ws").await;
    say(&mut socket, r#"{"do": "seek", "tick": 10}"#).await;
    tick_at(&mut socket, 10).await;
    // Both are heard before the tick is sent again.
    for request in [
        r#"{"do": "camera", "camera": 1}"#,
        r#"{"do": "step", "ticks": 1}"#,
    ] {
        socket.feed(Message::text(request)).await.unwrap();
    }
    socket.flush().await.unwrap();
    loop {
        let at = tick(&mut socket).await.tick;
        assert!(at <= Tick(11), "{at}");
        if at == Tick(11) {
            break;
        }
    }
    running.end().await;
}

#[tokio::test]
async fn who_plays_into_the_newest_tick_follows() {
    let running = Running::live().await;
    running.pass_and_wait([0, 200]).await;
    let mut socket = running.open("/ws").await;
    say(&mut socket, r#"{"do": "seek", "tick": 190}"#).await;
    tick_at(&mut socket, 190).await;
    say(&mut socket, r#"{"do": "play"}"#).await;
    text(&mut socket, "playback", |message| {
        message["state"] == "playing"
    })
    .await;
    text(&mut socket, "playback", |message| {
        message["state"] == "live"
    })
    .await;
    running.end().await;
}

#[tokio::test]
async fn a_chosen_camera_and_chosen_angles_come_with_their_tick() {
    let running = Running::live().await;
    running.pass_and_wait([0, 30]).await;
    let mut socket = running.open("/ws").await;
    say(&mut socket, r#"{"do": "camera", "camera": 1}"#).await;
    say(
        &mut socket,
        r#"{"do": "angles", "persons": [2], "angles": [19, 22]}"#,
    )
    .await;
    say(
        &mut socket,
        r#"{"do": "camera", "camera": 99, "request": 5}"#,
    )
    .await;
    text(&mut socket, "answer", |answer| {
        answer["request"] == 5 && answer["ok"] == false
    })
    .await;
    running.pass_and_wait([30, 31]).await;
    tick_at(&mut socket, 30).await;
    let Message::Binary(view) = next(&mut socket).await else {
        panic!("no view")
    };
    assert_eq!(CameraView::decode(&view).unwrap().tick, Tick(30));
    let Message::Binary(angles) = next(&mut socket).await else {
        panic!("no angles")
    };
    assert_eq!(ChosenAngles::decode(&angles).unwrap().persons.len(), 1);
    running.end().await;
}

#[tokio::test]
async fn a_page_that_wants_fewer_ticks_gets_fewer() {
    let running = Running::live().await;
    running.pass_and_wait([0, 1]).await;
    let mut socket = running.open("/ws").await;
    tick_at(&mut socket, 0).await;
    say(&mut socket, r#"{"do": "rate", "hz": 20, "request": 1}"#).await;
    text(&mut socket, "answer", |_| true).await;
    let mut got = Vec::new();
    for t in 1..31 {
        running.pass_and_wait([t, t + 1]).await;
        tokio::time::sleep(Duration::from_millis(3)).await;
    }
    say(&mut socket, r#"{"do": "rate", "hz": null, "request": 2}"#).await;
    loop {
        match next(&mut socket).await {
            Message::Binary(bytes) => got.push(TickMessage::decode(&bytes).unwrap().tick.0),
            Message::Text(text) if text.contains("answer") => break,
            _ => {}
        }
    }
    assert_eq!(got, [1, 4, 7, 10, 13, 16, 19, 22, 25, 28]);
    running.end().await;
}

#[tokio::test]
async fn the_past_of_an_angle_is_told() {
    let running = Running::live().await;
    running.pass_and_wait([0, 30]).await;
    let answer = running
        .get("/api/series?person=2&angles=19,25&from=10&to=12", "")
        .await;
    let (_, body) = answer.split_once("\r\n\r\n").unwrap();
    let series: Value = serde_json::from_str(body.trim()).unwrap();
    assert_eq!(series["ticks"], serde_json::json!([10, 11, 12]));
    assert_eq!(series["unobserved"][0], serde_json::json!([25]));
    assert_eq!(code(&running.get("/api/series?person=2", "").await), "400");
    running.end().await;
}

#[tokio::test]
async fn the_newest_thumbnail_of_a_camera_is_given_once_to_who_has_it() {
    let running = Running::live().await;
    let path = "/api/thumbnail/1";
    assert_eq!(code(&running.get(path, "").await), "204");
    running.state.thumbnail(&message(1, 60));
    running.state.thumbnail(&message(1, 120));
    let answer = running.get(path, "").await;
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    assert_eq!(code(head), "200");
    for said in [
        "content-type: image/jpeg",
        "cache-control: no-store",
        "etag: \"a-120\"",
        "x-content-type-options: nosniff",
    ] {
        assert!(head.contains(said), "{said}: {head}");
    }
    assert!(!body.is_empty());
    let again = running.get(path, "If-None-Match: \"a-120\"\r\n").await;
    assert_eq!(code(&again), "304");
    let newer = running.get(path, "If-None-Match: \"a-60\"\r\n").await;
    assert_eq!(code(&newer), "200");
    for (path, expected) in [
        ("/api/thumbnail/0", "204"),
        ("/api/thumbnail/65535", "404"),
        ("/api/thumbnail/x", "400"),
        ("/api/thumbnail/", "404"),
    ] {
        assert_eq!(code(&running.get(path, "").await), expected, "{path}");
    }
    let abroad = running.get(path, "Host: evil.example\r\n").await;
    assert_eq!(code(&abroad), "421");
    running.end().await;
}

#[tokio::test]
async fn a_tick_is_made_json_once_for_all_who_want_it() {
    let running = Running::live().await;
    let shared = running.state.shared();
    running.pass_and_wait([0, 2]).await;
    let newest = || shared.newest.borrow().clone().unwrap();
    let first = shared.live_json(&newest());
    assert!(Arc::ptr_eq(&first, &shared.live_json(&newest())));
    running.pass_and_wait([2, 3]).await;
    let told: Value = serde_json::from_str(&shared.live_json(&newest())).unwrap();
    assert_eq!(told["tick"], 2);
    running.end().await;
}

#[tokio::test]
async fn a_server_that_stops_says_so() {
    let running = Running::live().await;
    let mut socket = running.open("/ws").await;
    text(&mut socket, "hello", |_| true).await;
    running.stop.cancel();
    assert_eq!(closed(&mut socket).await, 1001);
    running.end().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_recording_plays_from_its_beginning_and_is_gone_through() {
    let made_up = MadeUp::new(synthetic(2), 60 * 20);
    let state = PageState::recording(
        venue::venue(),
        venue::skeleton(),
        Box::new(made_up),
        PageOptions::default(),
    );
    let running = Running::serve(state.unwrap()).await;
    let mut socket = running.open("/ws").await;
    assert_eq!(
        text(&mut socket, "hello", |_| true).await["mode"],
        "recording"
    );
    let first = tick(&mut socket).await;
    assert!(!first.is_live && first.tick.0 < 60, "{first:?}");
    text(&mut socket, "playback", |message| message["last"] == 1200).await;
    say(&mut socket, r#"{"do": "seek", "tick": 1000}"#).await;
    tick_at(&mut socket, 1000).await;
    text(&mut socket, "status", |status| {
        status["tick"].as_i64().unwrap() > 900
    })
    .await;
    say(&mut socket, r#"{"do": "live"}"#).await;
    tick_at(&mut socket, 1200).await;
    running.end().await;
}

/// Symptom: a recording that was solved again was shown as if it happened now, with links and cameras that nobody hears of.
#[tokio::test]
async fn a_replay_says_what_it_is_and_is_followed_like_a_run() {
    let options = PageOptions::default();
    let state = PageState::replay(venue::venue(), venue::skeleton(), options).unwrap();
    let running = Running::serve(state).await;
    let venue = running.get("/api/venue", "").await;
    assert!(venue.contains("\"mode\":\"replay\""), "{venue}");
    running.pass_and_wait([0, 40]).await;
    let mut socket = running.open("/ws").await;
    let hello = text(&mut socket, "hello", |_| true).await;
    assert_eq!(hello["mode"], "replay");
    assert!(tick_at(&mut socket, 39).await.is_live);
    running.end().await;
}
