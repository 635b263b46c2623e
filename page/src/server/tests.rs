//! What a stranger, a page and the operator's own browser get.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use farfield_proto::tick::Tick;
use futures_util::{SinkExt as _, StreamExt as _};
use rustls_pki_types::{CertificateDer, ServerName};
use serde_json::Value;
use tokio::io::{AsyncRead, AsyncReadExt as _, AsyncWrite, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::task::JoinHandle;
use tokio::time::timeout;
use tokio_rustls::TlsConnector;
use tokio_rustls::rustls::{ClientConfig, RootCertStore};
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
use tokio_tungstenite::tungstenite::{self, Message};
use tokio_tungstenite::{WebSocketStream, client_async};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use super::{Keys, MAX_CLIENTS, Server, ServerError, ServerOptions};
use crate::actions::{Action, ActionKind, PageActions};
use crate::protocol::camera_view::CameraView;
use crate::protocol::chosen_angles::ChosenAngles;
use crate::protocol::tick::TickMessage;
use crate::state::fixture::made_up::MadeUp;
use crate::state::fixture::messages::Synthetic;
use crate::state::fixture::{synthetic, venue};
use crate::state::{PageOptions, PageState};

/// Longer than anything takes on a busy machine.
const PATIENCE: Duration = Duration::from_secs(20);

type Socket = WebSocketStream<TcpStream>;

/// Notes what it is asked to do.
#[derive(Default)]
struct Asked(Mutex<Vec<Action>>);

impl PageActions for Asked {
    fn kinds(&self) -> Vec<ActionKind> {
        vec![ActionKind::NamePerson]
    }

    fn act(&self, action: &Action) -> Result<(), String> {
        self.0.lock().unwrap().push(action.clone());
        match action {
            Action::NamePerson { person: 13, .. } => Err("nobody is called so".to_owned()),
            _ => Ok(()),
        }
    }
}

/// A server on a free port of the loopback.
struct Running {
    state: Arc<PageState>,
    synthetic: Synthetic,
    address: SocketAddr,
    token: String,
    stop: CancellationToken,
    serving: JoinHandle<()>,
}

/// Serves beside the test.
fn serving(server: Server, stop: &CancellationToken) -> JoinHandle<()> {
    TaskTracker::new().spawn(server.serve(stop.clone()))
}

impl Running {
    async fn serve(state: Arc<PageState>) -> Self {
        let options = ServerOptions {
            address: SocketAddr::from(([127, 0, 0, 1], 0)),
            ..ServerOptions::default()
        };
        let server = Server::bind(Arc::clone(&state), options).await.unwrap();
        let stop = CancellationToken::new();
        Self {
            state,
            synthetic: synthetic(3),
            address: server.address(),
            token: server.token().text().to_owned(),
            serving: serving(server, &stop),
            stop,
        }
    }

    async fn live() -> Self {
        let options = PageOptions {
            actions: Some(Arc::new(Asked::default())),
            ..PageOptions::default()
        };
        Self::serve(PageState::live(venue::venue(), venue::skeleton(), options).unwrap()).await
    }

    /// Lets ticks pass, all at once.
    fn pass(&self, ticks: impl IntoIterator<Item = i64>) {
        for (key, bytes, at_us) in ticks
            .into_iter()
            .flat_map(|t| self.synthetic.messages(Tick(t)))
        {
            self.state.message(&key, &bytes, at_us);
        }
    }

    /// Lets ticks pass, and waits until pages can have them.
    async fn pass_and_wait(&self, [from, to]: [i64; 2]) {
        self.pass(from..to);
        let mut newest = self.state.shared().newest.subscribe();
        let is_there =
            newest.wait_for(|frame| frame.as_ref().is_some_and(|f| f.tick == Tick(to - 1)));
        timeout(PATIENCE, is_there).await.unwrap().unwrap();
    }

    /// The answer to a request with these further headers, as text.
    async fn get(&self, path: &str, headers: &str) -> String {
        let host = if headers.contains("Host:") {
            ""
        } else {
            "Host: localhost\r\n"
        };
        let request = format!("GET {path} HTTP/1.1\r\n{host}{headers}Connection: close\r\n\r\n");
        exchange(TcpStream::connect(self.address).await.unwrap(), &request).await
    }

    async fn try_open(
        &self,
        path: &str,
        token: Option<&str>,
    ) -> Result<Socket, tungstenite::Error> {
        let mut request =
            format!("ws://localhost:{}{path}", self.address.port()).into_client_request()?;
        let offered = match token {
            Some(token) => format!("farfield.page.v1, token.{token}"),
            None => "farfield.page.v1".to_owned(),
        };
        request
            .headers_mut()
            .insert("sec-websocket-protocol", offered.parse().unwrap());
        let stream = TcpStream::connect(self.address).await?;
        client_async(request, stream)
            .await
            .map(|(socket, _)| socket)
    }

    async fn open(&self, path: &str) -> Socket {
        self.try_open(path, None).await.unwrap()
    }

    async fn end(self) {
        self.stop.cancel();
        timeout(PATIENCE, self.serving).await.unwrap().unwrap();
    }
}

async fn exchange(mut stream: impl AsyncRead + AsyncWrite + Unpin, request: &str) -> String {
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut answer = Vec::new();
    // An end without a farewell is an end, too.
    let _n = stream.read_to_end(&mut answer).await;
    String::from_utf8_lossy(&answer).into_owned()
}

fn code(answer: &str) -> &str {
    answer.split(' ').nth(1).unwrap_or_default()
}

async fn next(socket: &mut Socket) -> Message {
    timeout(PATIENCE, socket.next())
        .await
        .expect("a message in time")
        .unwrap()
        .unwrap()
}

/// The next tick.
async fn tick(socket: &mut Socket) -> TickMessage {
    loop {
        if let Message::Binary(bytes) = next(socket).await
            && let Ok(tick) = TickMessage::decode(&bytes)
        {
            return tick;
        }
    }
}

async fn tick_at(socket: &mut Socket, at: i64) -> TickMessage {
    loop {
        let found = tick(socket).await;
        if found.tick == Tick(at) {
            return found;
        }
    }
}

/// The next text message of a type that `is` it.
async fn text(socket: &mut Socket, kind: &str, is: impl Fn(&Value) -> bool) -> Value {
    loop {
        if let Message::Text(text) = next(socket).await {
            let value: Value = serde_json::from_str(&text).unwrap();
            if value["type"] == kind && is(&value) {
                return value;
            }
        }
    }
}

async fn say(socket: &mut Socket, text: &str) {
    socket.send(Message::text(text)).await.unwrap();
}

/// With which code a socket is closed.
async fn closed(socket: &mut Socket) -> u16 {
    loop {
        match timeout(PATIENCE, socket.next()).await.unwrap() {
            Some(Ok(Message::Close(Some(frame)))) => return frame.code.into(),
            Some(Ok(_)) => {}
            other => panic!("{other:?}"),
        }
    }
}

#[tokio::test]
async fn another_host_and_another_origin_are_refused() {
    let running = Running::live().await;
    for path in ["/", "/api/venue", "/ws"] {
        let answer = running.get(path, "Host: evil.example\r\n").await;
        assert_eq!(code(&answer), "421", "{answer}");
        let answer = running.get(path, "Origin: http://evil.example\r\n").await;
        assert_eq!(code(&answer), "403", "{answer}");
    }
    running.end().await;
}

#[tokio::test]
async fn every_answer_keeps_browsers_from_harm() {
    let running = Running::live().await;
    for (path, headers) in [
        ("/", ""),
        ("/api/venue", ""),
        ("/none", ""),
        ("/", "Host: x\r\n"),
    ] {
        let answer = running.get(path, headers).await;
        assert!(
            answer.contains("content-security-policy: default-src 'self';"),
            "{answer}"
        );
        assert!(
            answer.contains("x-content-type-options: nosniff"),
            "{answer}"
        );
    }
    running.end().await;
}

#[tokio::test]
async fn the_page_is_small_and_asked_for_once() {
    let running = Running::live().await;
    let plain = running.get("/page.js", "").await;
    let small = running
        .get("/page.js", "Accept-Encoding: gzip, br\r\n")
        .await;
    assert!(small.contains("content-encoding: gzip") && small.len() < plain.len());
    let tag = plain
        .lines()
        .find_map(|line| line.strip_prefix("etag: "))
        .unwrap();
    let again = running
        .get("/page.js", &format!("If-None-Match: {tag}\r\n"))
        .await;
    assert_eq!(code(&again), "304");
    running.end().await;
}

#[tokio::test]
async fn on_the_loopback_one_reads_without_a_token_and_does_nothing() {
    let running = Running::live().await;
    running.pass_and_wait([0, 61]).await;
    assert_eq!(code(&running.get("/api/venue", "").await), "200");
    assert_eq!(
        code(
            &running
                .get("/api/venue", "Authorization: Bearer x\r\n")
                .await
        ),
        "401"
    );
    let mut socket = running.open("/ws").await;
    let hello = text(&mut socket, "hello", |_| true).await;
    assert_eq!(hello["may_act"], false);
    say(
        &mut socket,
        r#"{"do": "name_person", "person": 3, "name": "Anna", "request": 12}"#,
    )
    .await;
    let answer = text(&mut socket, "answer", |_| true).await;
    assert_eq!(
        (&answer["request"], &answer["ok"]),
        (&12.into(), &false.into())
    );
    assert!(
        answer["error"]
            .as_str()
            .unwrap()
            .contains("needs the token"),
        "{answer}"
    );
    assert!(running.try_open("/ws", Some("x")).await.is_err());
    running.end().await;
}

#[tokio::test]
async fn who_has_the_token_names_people_and_all_pages_are_told() {
    let running = Running::live().await;
    let mut other = running.open("/ws").await;
    let mut socket = running.try_open("/ws", Some(&running.token)).await.unwrap();
    assert_eq!(text(&mut socket, "hello", |_| true).await["may_act"], true);
    say(
        &mut socket,
        r#"{"do": "name_person", "person": 3, "name": "Anna", "request": 1}"#,
    )
    .await;
    assert_eq!(text(&mut socket, "answer", |_| true).await["ok"], true);
    text(&mut other, "names", |message| {
        message["names"]["3"] == "Anna"
    })
    .await;
    say(
        &mut socket,
        r#"{"do": "name_person", "person": 13, "name": "x", "request": 2}"#,
    )
    .await;
    assert_eq!(
        text(&mut socket, "answer", |_| true).await["error"],
        "nobody is called so"
    );
    say(&mut socket, r#"{"do": "start_recording"}"#).await;
    assert_eq!(
        text(&mut socket, "answer", |_| true).await["error"],
        "this server cannot do that"
    );
    running.state.set_names(BTreeMap::new());
    text(&mut other, "names", |message| {
        message["names"] == serde_json::json!({})
    })
    .await;
    running.end().await;
}

#[tokio::test]
async fn beyond_the_loopback_there_is_no_server_without_keys_and_a_name() {
    let state = PageState::live(venue::venue(), venue::skeleton(), PageOptions::default()).unwrap();
    let options = |keys| ServerOptions {
        address: SocketAddr::from(([0, 0, 0, 0], 0)),
        names: Vec::new(),
        keys,
    };
    let refused = Server::bind(Arc::clone(&state), options(None))
        .await
        .err()
        .unwrap();
    assert!(
        matches!(refused, ServerError::NoKeys { .. })
            && refused.to_string().contains("farfield certs")
    );
    let (keys, _) = keys();
    let refused = Server::bind(Arc::clone(&state), options(Some(keys)))
        .await
        .err()
        .unwrap();
    assert!(matches!(refused, ServerError::NoName { .. }));
    for keys in [[&b""[..], b""], [b"-----BEGIN CERTIFICATE-----\nx\n", b""]] {
        let [certificate_pem, key_pem] = keys.map(<[u8]>::to_vec);
        let options = ServerOptions {
            keys: Some(Keys {
                certificate_pem,
                key_pem,
            }),
            address: SocketAddr::from(([127, 0, 0, 1], 0)),
            ..ServerOptions::default()
        };
        let refused = Server::bind(Arc::clone(&state), options)
            .await
            .err()
            .unwrap();
        assert!(matches!(refused, ServerError::Keys(_)), "{refused}");
    }
}

/// Keys of a machine that is called `hall.local`, and the certificate alone.
fn keys() -> (Keys, CertificateDer<'static>) {
    let made = rcgen::generate_simple_self_signed(["hall.local".to_owned()]).unwrap();
    let keys = Keys {
        certificate_pem: made.cert.pem().into_bytes(),
        key_pem: made.signing_key.serialize_pem().into_bytes(),
    };
    (keys, made.cert.der().clone())
}

#[tokio::test]
async fn beyond_the_loopback_everything_is_secret_and_nothing_is_told_without_the_token() {
    let state = PageState::live(venue::venue(), venue::skeleton(), PageOptions::default()).unwrap();
    let (keys, certificate) = keys();
    let options = ServerOptions {
        address: SocketAddr::from(([0, 0, 0, 0], 0)),
        names: vec!["hall.local".to_owned()],
        keys: Some(keys),
    };
    let server = Server::bind(state, options).await.unwrap();
    let (port, token) = (server.address().port(), server.token().text().to_owned());
    assert_eq!(
        server.url(),
        format!("https://hall.local:{port}/#token={token}")
    );
    let stop = CancellationToken::new();
    let serving = serving(server, &stop);
    let mut roots = RootCertStore::empty();
    roots.add(certificate).unwrap();
    let provider = Arc::new(tokio_rustls::rustls::crypto::ring::default_provider());
    let config = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .unwrap()
        .with_root_certificates(roots)
        .with_no_client_auth();
    let connector = TlsConnector::from(Arc::new(config));
    let get = async |path: &str, headers: &str| {
        let stream = TcpStream::connect(("127.0.0.1", port)).await.unwrap();
        let name = ServerName::try_from("hall.local").unwrap();
        let stream = connector.connect(name, stream).await.unwrap();
        let request = format!(
            "GET {path} HTTP/1.1\r\nHost: hall.local:{port}\r\n{headers}Connection: close\r\n\r\n"
        );
        exchange(stream, &request).await
    };
    let bearer = format!("Authorization: Bearer {token}\r\n");
    assert_eq!(code(&get("/", "").await), "200");
    for path in ["/api/venue", "/api/status", "/api/series?person=1&angles=1"] {
        assert_eq!(code(&get(path, "").await), "401", "{path}");
    }
    assert_eq!(code(&get("/api/venue", &bearer).await), "200");
    let upgrade = "Connection: upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n";
    assert_eq!(code(&get("/ws", upgrade).await), "401");
    let plain = TcpStream::connect(("127.0.0.1", port)).await.unwrap();
    let answer = exchange(plain, "GET / HTTP/1.1\r\nHost: hall.local\r\n\r\n").await;
    assert!(!answer.contains("HTTP/1.1 200"), "{answer}");
    stop.cancel();
    timeout(PATIENCE, serving).await.unwrap().unwrap();
}

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
async fn what_is_not_understood_is_answered_and_a_flood_is_ended() {
    let running = Running::live().await;
    let mut socket = running.open("/ws").await;
    say(&mut socket, "hello?").await;
    let answer = text(&mut socket, "answer", |_| true).await;
    assert_eq!(
        (&answer["ok"], &answer["request"]),
        (&false.into(), &Value::Null)
    );
    for _ in 0..50 {
        say(&mut socket, r#"{"do": "live"}"#).await;
    }
    assert_eq!(closed(&mut socket).await, 1008);
    let mut socket = running.open("/ws").await;
    say(&mut socket, &"x".repeat(5000)).await;
    assert_eq!(closed(&mut socket).await, 1009);
    running.end().await;
}

#[tokio::test]
async fn more_pages_than_there_is_room_for_are_told_so() {
    let running = Running::live().await;
    let mut open = Vec::new();
    for _ in 0..MAX_CLIENTS {
        open.push(running.open("/ws").await);
    }
    match running.try_open("/ws", None).await.unwrap_err() {
        tungstenite::Error::Http(answer) => assert_eq!(answer.status().as_u16(), 503),
        other => panic!("{other}"),
    }
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
