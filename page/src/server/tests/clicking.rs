//! Tests of the page for clicking marks: it requires the token, and submissions are limited.

use super::*;
use crate::server::{Clicking, ClickingServer, Taken};

/// Returns the result named by the submission.
struct FakeClicking;

impl Clicking for FakeClicking {
    fn document(&self) -> String {
        "{\"file\":\"clicked.toml\"}".to_owned()
    }

    fn picture(&self, number: usize) -> Option<Arc<[u8]>> {
        (number == 0).then(|| Arc::from(&b"PNG"[..]))
    }

    fn take(&self, clicked: &[u8]) -> Taken {
        let text = String::from_utf8_lossy(clicked).into_owned();
        match text.as_str() {
            "behind" => Taken::Behind(text),
            "wrong" => Taken::Refused(text),
            "full" => Taken::Failed(text),
            _ => Taken::Written(text),
        }
    }
}

struct Served {
    address: SocketAddr,
    bearer: String,
    stop: CancellationToken,
    serving: JoinHandle<()>,
}

impl Served {
    async fn start() -> Self {
        let options = ServerOptions {
            address: SocketAddr::from(([127, 0, 0, 1], 0)),
            ..ServerOptions::default()
        };
        let server = ClickingServer::bind(Arc::new(FakeClicking), options)
            .await
            .unwrap();
        assert!(server.url().contains(server.token().text()));
        let (address, token) = (server.address(), server.token().text().to_owned());
        let stop = CancellationToken::new();
        Self {
            address,
            bearer: format!("Authorization: Bearer {token}\r\n"),
            serving: TaskTracker::new().spawn(server.serve(stop.clone())),
            stop,
        }
    }

    async fn ask(&self, first: &str, head: &str, body: &str) -> String {
        let host = if head.contains("Host:") {
            ""
        } else {
            "Host: localhost\r\n"
        };
        let length = body.len();
        let request = format!(
            "{first} HTTP/1.1\r\n{host}{head}Content-Length: {length}\r\nConnection: close\r\n\r\n{body}"
        );
        exchange(TcpStream::connect(self.address).await.unwrap(), &request).await
    }

    async fn end(self) {
        self.stop.cancel();
        timeout(PATIENCE, self.serving).await.unwrap().unwrap();
    }
}

#[tokio::test]
async fn without_the_token_only_the_empty_page_is_served() {
    let served = Served::start().await;
    for path in ["GET /", "GET /marks.js", "GET /marks.css"] {
        let page = served.ask(path, "", "").await;
        assert_eq!(code(&page), "200", "{path}");
        assert!(page.contains("default-src 'self'"), "{path}");
    }
    for path in ["GET /api/marks", "PUT /api/marks", "GET /api/picture/0"] {
        assert_eq!(code(&served.ask(path, "", "").await), "401", "{path}");
        let wrong = "Authorization: Bearer 0123456789abcdef0123456789abcdef\r\n";
        assert_eq!(code(&served.ask(path, wrong, "").await), "401", "{path}");
        let foreign = format!("{}Origin: http://stranger.example\r\n", served.bearer);
        assert_eq!(code(&served.ask(path, &foreign, "").await), "403", "{path}");
        let host = format!("{}Host: stranger.example\r\n", served.bearer);
        assert_eq!(code(&served.ask(path, &host, "").await), "421", "{path}");
    }
    for path in ["GET /page.js", "GET /api/venue", "GET /ws"] {
        assert_eq!(
            code(&served.ask(path, &served.bearer, "").await),
            "404",
            "{path}"
        );
    }
    served.end().await;
}

#[tokio::test]
async fn the_status_code_shows_the_result_of_a_submission() {
    let served = Served::start().await;
    for (text, status) in [
        ("all", "200"),
        ("behind", "409"),
        ("wrong", "400"),
        ("full", "500"),
    ] {
        let answer = served.ask("PUT /api/marks", &served.bearer, text).await;
        assert_eq!(code(&answer), status);
        assert!(answer.contains(&format!("\r\n\r\n{text}")), "{answer}");
    }
    assert!(
        served
            .ask("GET /api/marks", &served.bearer, "")
            .await
            .contains("clicked.toml")
    );
    assert!(
        served
            .ask("GET /api/picture/0", &served.bearer, "")
            .await
            .ends_with("PNG")
    );
    for path in ["GET /api/picture/1", "GET /api/picture/-1"] {
        let answer = served.ask(path, &served.bearer, "").await;
        assert!(["400", "404"].contains(&code(&answer)), "{answer}");
    }
    let large = "x".repeat((1 << 20) + 1);
    assert_eq!(
        code(&served.ask("PUT /api/marks", &served.bearer, &large).await),
        "413"
    );
    served.end().await;
}

#[tokio::test]
async fn beyond_the_loopback_keys_are_required() {
    let options = ServerOptions {
        address: SocketAddr::from(([0, 0, 0, 0], 0)),
        ..ServerOptions::default()
    };
    let refused = ClickingServer::bind(Arc::new(FakeClicking), options).await;
    assert!(matches!(refused, Err(ServerError::NoKeys { .. })));
}
