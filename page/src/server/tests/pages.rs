//! Tests: what pages receive, live and of the past, including pages that do not read.

use serde_json::json;

use super::*;
use crate::calibration::{CalibrationSheet, ShownCalibration};
use crate::state::thumbnails::tests::message;

#[tokio::test]
async fn a_following_page_receives_new_ticks() {
    let running = TestServer::live().await;
    let mut socket = running.open("/ws").await;
    running.feed_and_wait([0, 40]).await;
    let last = tick_at(&mut socket, 39).await;
    assert!(last.is_live && last.persons.len() == 3);
    let mut json = running.open("/ws/json").await;
    let received = text(&mut json, "tick", |_| true).await;
    assert_eq!(
        (&received["tick"], &received["live"]),
        (&39.into(), &true.into())
    );
    assert_eq!(
        received["persons"][0]["joints_m"].as_array().unwrap().len(),
        29
    );
    assert_eq!(
        received["persons"][0]["angles"].as_array().unwrap().len(),
        40
    );
    running.end().await;
}

#[tokio::test]
async fn a_stalled_page_delays_nothing_and_skips_to_the_newest_tick() {
    let running = TestServer::live().await;
    let mut stalled = Vec::new();
    for _ in 0..10 {
        stalled.push(running.open("/ws").await);
    }
    // More than all network buffers together hold.
    for from in (0..6000).step_by(100) {
        running.feed_and_wait([from, from + 100]).await;
        // Clients are other tasks on this test's only thread.
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
async fn every_page_has_its_own_playback_position() {
    let running = TestServer::live().await;
    running.feed_and_wait([0, 200]).await;
    let [mut socket, mut other] = [running.open("/ws").await, running.open("/ws").await];
    tick_at(&mut socket, 199).await;
    send_text(&mut socket, r#"{"do": "seek", "tick": 100}"#).await;
    assert!(!tick_at(&mut socket, 100).await.is_live);
    let playback = text(&mut socket, "playback", |message| message["tick"] == 100).await;
    assert_eq!(
        (&playback["state"], &playback["first"], &playback["last"]),
        (&"paused".into(), &0.into(), &199.into())
    );
    send_text(&mut socket, r#"{"do": "step", "ticks": -1}"#).await;
    tick_at(&mut socket, 99).await;
    send_text(&mut socket, r#"{"do": "seek", "tick": 1000000}"#).await;
    tick_at(&mut socket, 199).await;
    send_text(
        &mut socket,
        r#"{"do": "play", "speed": 8, "loop": [50, 53]}"#,
    )
    .await;
    for at in [50, 53, 50, 53] {
        tick_at(&mut socket, at).await;
    }
    send_text(&mut socket, r#"{"do": "live"}"#).await;
    text(&mut socket, "playback", |message| {
        message["state"] == "live"
    })
    .await;
    running.feed_and_wait([200, 201]).await;
    assert!(tick_at(&mut socket, 200).await.is_live);
    assert!(tick_at(&mut other, 200).await.is_live);
    running.end().await;
}

#[tokio::test]
async fn a_paused_page_receives_a_message_every_second() {
    let running = TestServer::live().await;
    running.feed_and_wait([0, 40]).await;
    let mut socket = running.open("/ws").await;
    send_text(&mut socket, r#"{"do": "seek", "tick": 10}"#).await;
    text(&mut socket, "playback", |message| message["tick"] == 10).await;
    for _ in 0..3 {
        // A page gives up on a server that is silent for five seconds.
        let received = timeout(Duration::from_secs(4), next(&mut socket)).await;
        assert!(received.is_ok(), "silent");
    }
    running.end().await;
}

#[tokio::test]
async fn choosing_a_camera_keeps_the_playback_position() {
    let running = TestServer::live().await;
    running.feed_and_wait([0, 40]).await;
    let mut socket = running.open("/ws").await;
    send_text(&mut socket, r#"{"do": "seek", "tick": 10}"#).await;
    tick_at(&mut socket, 10).await;
    // Both requests are processed before the tick is sent again.
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
async fn playing_to_the_newest_tick_follows_it() {
    let running = TestServer::live().await;
    running.feed_and_wait([0, 200]).await;
    let mut socket = running.open("/ws").await;
    send_text(&mut socket, r#"{"do": "seek", "tick": 190}"#).await;
    tick_at(&mut socket, 190).await;
    send_text(&mut socket, r#"{"do": "play"}"#).await;
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
async fn the_selected_camera_and_angles_arrive_with_their_tick() {
    let running = TestServer::live().await;
    running.feed_and_wait([0, 30]).await;
    let mut socket = running.open("/ws").await;
    send_text(&mut socket, r#"{"do": "camera", "camera": 1}"#).await;
    send_text(
        &mut socket,
        r#"{"do": "angles", "persons": [2], "angles": [19, 22]}"#,
    )
    .await;
    send_text(
        &mut socket,
        r#"{"do": "camera", "camera": 99, "request": 5}"#,
    )
    .await;
    text(&mut socket, "answer", |answer| {
        answer["request"] == 5 && answer["ok"] == false
    })
    .await;
    running.feed_and_wait([30, 31]).await;
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
async fn the_tick_rate_can_be_limited() {
    let running = TestServer::live().await;
    running.feed_and_wait([0, 1]).await;
    let mut socket = running.open("/ws").await;
    tick_at(&mut socket, 0).await;
    send_text(&mut socket, r#"{"do": "rate", "hz": 20, "request": 1}"#).await;
    text(&mut socket, "answer", |_| true).await;
    let mut got = Vec::new();
    for t in 1..31 {
        running.feed_and_wait([t, t + 1]).await;
        tokio::time::sleep(Duration::from_millis(3)).await;
    }
    send_text(&mut socket, r#"{"do": "rate", "hz": null, "request": 2}"#).await;
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
async fn past_values_of_an_angle_are_served() {
    let running = TestServer::live().await;
    running.feed_and_wait([0, 30]).await;
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
async fn the_newest_thumbnail_is_served_with_an_etag() {
    let running = TestServer::live().await;
    let path = "/api/thumbnail/1";
    assert_eq!(code(&running.get(path, "").await), "204");
    running.state.thumbnail(&message(1, 60));
    running.state.thumbnail(&message(1, 120));
    let answer = running.get(path, "").await;
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    assert_eq!(code(head), "200");
    for header in [
        "content-type: image/jpeg",
        "cache-control: no-store",
        "etag: \"a-120\"",
        "x-content-type-options: nosniff",
    ] {
        assert!(head.contains(header), "{header}: {head}");
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
async fn a_tick_is_encoded_as_json_once() {
    let running = TestServer::live().await;
    let shared = running.state.shared();
    running.feed_and_wait([0, 2]).await;
    let newest = || shared.newest.borrow().clone().unwrap();
    let first = shared.live_json(&newest());
    assert!(Arc::ptr_eq(&first, &shared.live_json(&newest())));
    running.feed_and_wait([2, 3]).await;
    let received: Value = serde_json::from_str(&shared.live_json(&newest())).unwrap();
    assert_eq!(received["tick"], 2);
    running.end().await;
}

#[tokio::test]
async fn a_stopping_server_closes_with_a_code() {
    let running = TestServer::live().await;
    let mut socket = running.open("/ws").await;
    text(&mut socket, "hello", |_| true).await;
    running.stop.cancel();
    assert_eq!(closed(&mut socket).await, 1001);
    running.end().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_recording_plays_from_its_beginning_and_can_be_sought() {
    let recording = SyntheticRecording::new(synthetic(2), 60 * 20);
    let state = PageState::recording(
        venue::venue(),
        venue::skeleton(),
        Box::new(recording),
        PageOptions::default(),
    );
    let running = TestServer::serve(state.unwrap()).await;
    let mut socket = running.open("/ws").await;
    assert_eq!(
        text(&mut socket, "hello", |_| true).await["mode"],
        "recording"
    );
    let first = tick(&mut socket).await;
    assert!(!first.is_live && first.tick.0 < 60, "{first:?}");
    text(&mut socket, "playback", |message| message["last"] == 1200).await;
    send_text(&mut socket, r#"{"do": "seek", "tick": 1000}"#).await;
    tick_at(&mut socket, 1000).await;
    text(&mut socket, "status", |status| {
        status["tick"].as_i64().unwrap() > 900
    })
    .await;
    send_text(&mut socket, r#"{"do": "live"}"#).await;
    tick_at(&mut socket, 1200).await;
    running.end().await;
}

/// Regression: a replay was shown as if it happened now, with links and cameras without data.
#[tokio::test]
async fn a_replay_reports_its_mode_and_can_be_followed() {
    let options = PageOptions::default();
    let state = PageState::replay(venue::venue(), venue::skeleton(), options).unwrap();
    let running = TestServer::serve(state).await;
    let venue = running.get("/api/venue", "").await;
    assert!(venue.contains("\"mode\":\"replay\""), "{venue}");
    running.feed_and_wait([0, 40]).await;
    let mut socket = running.open("/ws").await;
    let hello = text(&mut socket, "hello", |_| true).await;
    assert_eq!(hello["mode"], "replay");
    assert!(tick_at(&mut socket, 39).await.is_live);
    running.end().await;
}

const HTML: &str = "<!doctype html><title>Calibration</title><script>alert(1)</script>";

async fn with_sheet() -> TestServer {
    let sheet = CalibrationSheet {
        file: "calibration.html".to_owned(),
        fingerprint: Some("ab".repeat(8)),
        is_of_this: Some(false),
        html: HTML.as_bytes().into(),
    };
    let options = PageOptions {
        calibration: ShownCalibration {
            file: "calibration.toml".to_owned(),
            fingerprint: "cd".repeat(8),
            text: "of ANOTHER calibration".to_owned(),
            sheet: Some(sheet),
        },
        ..PageOptions::default()
    };
    TestServer::serve(PageState::live(venue::venue(), venue::skeleton(), options).unwrap()).await
}

fn body(answer: &str) -> &str {
    answer.split_once("\r\n\r\n").map_or("", |(_, body)| body)
}

#[tokio::test]
async fn the_sheet_is_served_by_its_key_without_active_content() {
    let running = with_sheet().await;
    let document: Value =
        serde_json::from_str(body(&running.get("/api/calibration", "").await)).unwrap();
    assert_eq!(document["sheet"]["is_of_this"], json!(false));
    assert_eq!(document["text"], "of ANOTHER calibration");
    let path = document["sheet"]["path"].as_str().unwrap();
    assert!(!path.contains(&running.token), "the key is not the token");
    let sheet = running.get(path, "").await;
    assert_eq!(code(&sheet), "200");
    assert_eq!(body(&sheet), HTML);
    let head = sheet.to_ascii_lowercase();
    assert!(head.contains("content-type: text/html"), "{head}");
    assert!(
        head.contains("default-src 'none'") && head.contains("; sandbox"),
        "{head}"
    );
    assert_eq!(head.matches("content-security-policy").count(), 1, "{head}");
    running.end().await;
}

#[tokio::test]
async fn without_the_key_there_is_no_sheet() {
    let running = with_sheet().await;
    let document: Value =
        serde_json::from_str(body(&running.get("/api/calibration", "").await)).unwrap();
    let path = document["sheet"]["path"].as_str().unwrap().to_owned();
    let wrong = "0".repeat(32);
    for path in [
        format!("/calibration/{wrong}"),
        "/calibration/".to_owned(),
        format!("/calibration/{}", running.token),
    ] {
        assert_eq!(code(&running.get(&path, "").await), "404", "{path}");
    }
    for path in ["/api/calibration", &path] {
        let stranger = running.get(path, "Host: stranger.example\r\n").await;
        assert_eq!(code(&stranger), "421", "{path}");
        let foreign = running
            .get(path, "Origin: http://stranger.example\r\n")
            .await;
        assert_eq!(code(&foreign), "403", "{path}");
    }
    running.end().await;
}

#[tokio::test]
async fn a_run_without_a_sheet_reports_none() {
    let running = TestServer::live().await;
    let document: Value =
        serde_json::from_str(body(&running.get("/api/calibration", "").await)).unwrap();
    assert!(document["sheet"].is_null(), "{document}");
    assert_eq!(code(&running.get("/calibration/x", "").await), "404");
    running.end().await;
}
