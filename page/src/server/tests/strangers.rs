//! What a stranger, and what who has the token, may ask.

use super::*;

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
        token: None,
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

#[tokio::test]
async fn beyond_the_loopback_everything_is_secret_and_nothing_is_told_without_the_token() {
    let state = PageState::live(venue::venue(), venue::skeleton(), PageOptions::default()).unwrap();
    let (keys, certificate) = keys();
    let options = ServerOptions {
        address: SocketAddr::from(([0, 0, 0, 0], 0)),
        names: vec!["hall.local".to_owned()],
        keys: Some(keys),
        token: None,
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
    for path in [
        "/api/venue",
        "/api/status",
        "/api/series?person=1&angles=1",
        "/api/thumbnail/0",
    ] {
        assert_eq!(code(&get(path, "").await), "401", "{path}");
    }
    assert_eq!(code(&get("/api/venue", &bearer).await), "200");
    assert_eq!(code(&get("/api/thumbnail/0", &bearer).await), "204");
    let upgrade = "Connection: upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n";
    assert_eq!(code(&get("/ws", upgrade).await), "401");
    let plain = TcpStream::connect(("127.0.0.1", port)).await.unwrap();
    let answer = exchange(plain, "GET / HTTP/1.1\r\nHost: hall.local\r\n\r\n").await;
    assert!(!answer.contains("HTTP/1.1 200"), "{answer}");
    stop.cancel();
    timeout(PATIENCE, serving).await.unwrap().unwrap();
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
    for _ in 0..50 {
        let pong = Message::Pong(b"unasked!".to_vec().into());
        socket.send(pong).await.unwrap();
    }
    assert_eq!(closed(&mut socket).await, 1008);
    let mut socket = running.open("/ws").await;
    say(&mut socket, &"x".repeat(5000)).await;
    assert_eq!(closed(&mut socket).await, 1009);
    running.end().await;
}

#[tokio::test]
async fn the_past_of_angles_is_not_given_without_measure() {
    let running = Running::live().await;
    let asks = (0..100).map(|_| running.get("/api/series?person=1&angles=1", ""));
    let answers = futures_util::future::join_all(asks).await;
    let count = |wanted| {
        answers
            .iter()
            .filter(|answer| code(answer) == wanted)
            .count()
    };
    assert!(count("200") >= 40 && count("429") > 0, "{}", count("200"));
    assert_eq!(count("200") + count("429"), 100);
    running.end().await;
}

#[tokio::test]
async fn who_does_not_read_its_answer_is_left_and_who_reads_slowly_is_not() {
    let page = || {
        let large = axum::routing::get(|| async { "x".repeat(200_000) });
        axum::Router::new().route("/", large)
    };
    let times = [Duration::from_millis(100), Duration::from_millis(900)];
    let request = b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n";
    let (mut near, far) = tokio::io::duplex(1024);
    near.write_all(request).await.unwrap();
    timeout(PATIENCE, requests(far, page(), times))
        .await
        .expect("an end");
    let (mut near, far) = tokio::io::duplex(1024);
    near.write_all(request).await.unwrap();
    let slowly = async {
        tokio::time::sleep(2 * times[0]).await;
        let mut answer = Vec::new();
        near.read_to_end(&mut answer).await.unwrap();
        answer.len()
    };
    let ((), read) = tokio::join!(requests(far, page(), times), slowly);
    assert!(read > 200_000, "{read}");
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

/// Keys of a machine that is called `hall.local`, and the certificate alone.
fn keys() -> (Keys, CertificateDer<'static>) {
    let made = rcgen::generate_simple_self_signed(["hall.local".to_owned()]).unwrap();
    let keys = Keys {
        certificate_pem: made.cert.pem().into_bytes(),
        key_pem: made.signing_key.serialize_pem().into_bytes(),
    };
    (keys, made.cert.der().clone())
}

/// Symptom: who had the address of a demo could record and name people until it began anew, and not afterwards.
#[tokio::test]
async fn a_server_that_is_given_a_token_is_the_same_to_who_has_the_address_of_the_one_before() {
    let token = Token::random().unwrap();
    let state = PageState::live(venue::venue(), venue::skeleton(), PageOptions::default()).unwrap();
    for _ in 0..2 {
        let options = ServerOptions {
            address: SocketAddr::from(([127, 0, 0, 1], 0)),
            token: Some(token.clone()),
            ..ServerOptions::default()
        };
        let server = Server::bind(Arc::clone(&state), options).await.unwrap();
        assert!(server.url().ends_with(token.text()), "{}", server.url());
    }
}
