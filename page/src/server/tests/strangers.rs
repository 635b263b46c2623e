//! Tests: what clients with and without the token may request.

use super::*;

#[tokio::test]
async fn another_host_and_another_origin_are_refused() {
    let running = TestServer::live().await;
    for path in ["/", "/api/venue", "/ws"] {
        let answer = running.get(path, "Host: evil.example\r\n").await;
        assert_eq!(code(&answer), "421", "{answer}");
        let answer = running.get(path, "Origin: http://evil.example\r\n").await;
        assert_eq!(code(&answer), "403", "{answer}");
    }
    running.end().await;
}

#[tokio::test]
async fn every_response_has_security_headers() {
    let running = TestServer::live().await;
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
async fn the_page_is_compressed_and_cached() {
    let running = TestServer::live().await;
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
async fn on_the_loopback_reading_is_free_and_acting_needs_the_token() {
    let running = TestServer::live().await;
    running.feed_and_wait([0, 61]).await;
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
    send_text(
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
async fn clients_with_the_token_name_people_on_all_pages() {
    let running = TestServer::live().await;
    let mut other = running.open("/ws").await;
    let mut socket = running.try_open("/ws", Some(&running.token)).await.unwrap();
    assert_eq!(text(&mut socket, "hello", |_| true).await["may_act"], true);
    send_text(
        &mut socket,
        r#"{"do": "name_person", "person": 3, "name": "Anna", "request": 1}"#,
    )
    .await;
    assert_eq!(text(&mut socket, "answer", |_| true).await["ok"], true);
    text(&mut other, "names", |message| {
        message["names"]["3"] == "Anna"
    })
    .await;
    send_text(
        &mut socket,
        r#"{"do": "name_person", "person": 13, "name": "x", "request": 2}"#,
    )
    .await;
    assert_eq!(
        text(&mut socket, "answer", |_| true).await["error"],
        "no such person"
    );
    send_text(&mut socket, r#"{"do": "start_recording"}"#).await;
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
async fn beyond_the_loopback_keys_and_a_name_are_required() {
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
    assert!(matches!(refused, ServerError::NoKeys { .. }));
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
async fn beyond_the_loopback_https_and_the_token_are_required() {
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
async fn invalid_requests_are_answered_and_floods_are_closed() {
    let running = TestServer::live().await;
    let mut socket = running.open("/ws").await;
    send_text(&mut socket, "hello?").await;
    let answer = text(&mut socket, "answer", |_| true).await;
    assert_eq!(
        (&answer["ok"], &answer["request"]),
        (&false.into(), &Value::Null)
    );
    for _ in 0..50 {
        send_text(&mut socket, r#"{"do": "live"}"#).await;
    }
    assert_eq!(closed(&mut socket).await, 1008);
    let mut socket = running.open("/ws").await;
    for _ in 0..50 {
        let pong = Message::Pong(b"unasked!".to_vec().into());
        socket.send(pong).await.unwrap();
    }
    assert_eq!(closed(&mut socket).await, 1008);
    let mut socket = running.open("/ws").await;
    send_text(&mut socket, &"x".repeat(5000)).await;
    assert_eq!(closed(&mut socket).await, 1009);
    running.end().await;
}

#[tokio::test]
async fn past_angles_are_rate_limited() {
    let running = TestServer::live().await;
    let requests = (0..100).map(|_| running.get("/api/series?person=1&angles=1", ""));
    let answers = futures_util::future::join_all(requests).await;
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
async fn slow_readers_are_served_and_stalled_ones_dropped() {
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
async fn too_many_pages_are_refused() {
    let running = TestServer::live().await;
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

/// Keys of a machine named `hall.local`, and the certificate alone.
fn keys() -> (Keys, CertificateDer<'static>) {
    let made = rcgen::generate_simple_self_signed(["hall.local".to_owned()]).unwrap();
    let keys = Keys {
        certificate_pem: made.cert.pem().into_bytes(),
        key_pem: made.signing_key.serialize_pem().into_bytes(),
    };
    (keys, made.cert.der().clone())
}

/// Regression: the printed URL of a demo could record and name people only until the demo
/// restarted.
#[tokio::test]
async fn a_given_token_keeps_the_url_valid_across_restarts() {
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
