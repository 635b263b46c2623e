//! Tests of the server: strangers, pages, and the operator.

mod clicking;
mod pages;
mod strangers;

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

use super::listening::requests;
use super::{Keys, MAX_CLIENTS, Server, ServerError, ServerOptions, Token};
use crate::protocol::camera_view::CameraView;
use crate::protocol::chosen_angles::ChosenAngles;
use crate::protocol::request::Action;
use crate::protocol::text::ActionKind;
use crate::protocol::tick::TickMessage;
use crate::state::fixture::messages::{Synthetic, SyntheticRecording};
use crate::state::fixture::{synthetic, venue};
use crate::state::{PageActions, PageOptions, PageState};

/// Longer than any operation on a busy machine.
const PATIENCE: Duration = Duration::from_secs(20);

type Socket = WebSocketStream<TcpStream>;

/// Records requested actions.
#[derive(Default)]
struct RecordedActions(Mutex<Vec<Action>>);

impl PageActions for RecordedActions {
    fn kinds(&self) -> Vec<ActionKind> {
        vec![ActionKind::NamePerson]
    }

    fn act(&self, action: &Action) -> Result<(), String> {
        self.0.lock().unwrap().push(action.clone());
        match action {
            Action::NamePerson { person: 13, .. } => Err("no such person".to_owned()),
            _ => Ok(()),
        }
    }
}

/// A server on a free port of the loopback.
struct TestServer {
    state: Arc<PageState>,
    synthetic: Synthetic,
    address: SocketAddr,
    token: String,
    stop: CancellationToken,
    serving: JoinHandle<()>,
}

/// Serves in the background.
fn serving(server: Server, stop: &CancellationToken) -> JoinHandle<()> {
    TaskTracker::new().spawn(server.serve(stop.clone()))
}

impl TestServer {
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
            actions: Some(Arc::new(RecordedActions::default())),
            ..PageOptions::default()
        };
        Self::serve(PageState::live(venue::venue(), venue::skeleton(), options).unwrap()).await
    }

    /// Feeds the messages of ticks, all at once.
    fn feed(&self, ticks: impl IntoIterator<Item = i64>) {
        for (key, bytes, at_us) in ticks
            .into_iter()
            .flat_map(|t| self.synthetic.messages(Tick(t)))
        {
            self.state.message(&key, &bytes, at_us);
        }
    }

    /// Feeds ticks and waits until pages can receive them.
    async fn feed_and_wait(&self, [from, to]: [i64; 2]) {
        self.feed(from..to);
        let mut newest = self.state.shared().newest.subscribe();
        let is_there =
            newest.wait_for(|frame| frame.as_ref().is_some_and(|f| f.tick == Tick(to - 1)));
        timeout(PATIENCE, is_there).await.unwrap().unwrap();
    }

    /// The response to a request with these additional headers, as text.
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
    // An end without a close notification is accepted.
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

/// The next text message of the kind for which `is` returns true.
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

async fn send_text(socket: &mut Socket, text: &str) {
    socket.send(Message::text(text)).await.unwrap();
}

/// The code with which a socket is closed.
async fn closed(socket: &mut Socket) -> u16 {
    loop {
        match timeout(PATIENCE, socket.next()).await.unwrap() {
            Some(Ok(Message::Close(Some(frame)))) => return frame.code.into(),
            Some(Ok(_)) => {}
            other => panic!("{other:?}"),
        }
    }
}
