//! One client's WebSocket: handshake, incoming limits, sending.

use std::io;
use std::net::IpAddr;
use std::time::Duration;

use socket2::{SockRef, TcpKeepalive};
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::handshake::server::{
    Callback, ErrorResponse, Request, Response,
};
use tokio_tungstenite::tungstenite::http::{HeaderValue, StatusCode};
use tokio_tungstenite::tungstenite::protocol::WebSocketConfig;
use tokio_tungstenite::tungstenite::{Error, Message, Utf8Bytes};
use tokio_tungstenite::{WebSocketStream, accept_hdr_async_with_config};
use tokio_util::sync::CancellationToken;

use futures_util::{SinkExt as _, StreamExt as _};

use crate::server::{BREATH, STALL};

/// Maximum time for the handshake.
const HANDSHAKE: Duration = Duration::from_secs(5);
/// Header that negotiates protocols above WebSocket.
const PROTOCOL: &str = "sec-websocket-protocol";

/// Maximum number of bytes waiting to be sent: one message of a crowd. A message is only accepted
/// when the previous one is sent.
const MAX_WAITING: usize = 4 * 1024 * 1024;

/// Rules for accepting clients.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ConnectionRules {
    /// Maximum size of a client's message, bytes.
    pub(crate) max_incoming: usize,
    /// Accepted protocols above WebSocket; the first one that the client offers is used. Empty:
    /// none required.
    pub(crate) protocols: &'static [&'static str],
    /// Origins of other machines that are accepted.
    pub(crate) origins: &'static [&'static str],
}

/// A received message.
pub(crate) enum Received {
    /// A text.
    Text(Utf8Bytes),
    /// Another message, which is ignored.
    Other,
    /// The client closed the connection.
    Closed,
}

/// An accepted client.
pub(crate) struct Connection(WebSocketStream<TcpStream>);

/// Accepts a client, unless the request comes from another machine's page or offers no supported
/// protocol.
pub(crate) async fn accept_connection(
    socket: TcpStream,
    rules: ConnectionRules,
) -> io::Result<Connection> {
    let config = WebSocketConfig::default()
        .max_message_size(Some(rules.max_incoming))
        .max_frame_size(Some(rules.max_incoming))
        .read_buffer_size(rules.max_incoming)
        .max_write_buffer_size(MAX_WAITING);
    let check = Check(rules);
    socket.set_nodelay(true)?;
    // Detects clients that disappeared, even if nothing is sent to them.
    let keepalive = TcpKeepalive::new()
        .with_time(Duration::from_secs(30))
        .with_interval(Duration::from_secs(10));
    SockRef::from(&socket).set_tcp_keepalive(&keepalive)?;
    let accepting = accept_hdr_async_with_config(socket, check, Some(config));
    match timeout(HANDSHAKE, accepting).await {
        Ok(accepted) => accepted.map(Connection).map_err(as_io),
        Err(_) => Err(io::Error::new(
            io::ErrorKind::TimedOut,
            "did not send a request within five seconds",
        )),
    }
}

/// Checks the handshake request.
struct Check(ConnectionRules);

impl Callback for Check {
    fn on_request(
        self,
        request: &Request,
        mut response: Response,
    ) -> Result<Response, ErrorResponse> {
        let Self(rules) = self;
        if let Some(origin) = request.headers().get("origin") {
            let is_accepted =
                |origin: &str| is_of_this_machine(origin) || rules.origins.contains(&origin);
            if !origin.to_str().is_ok_and(is_accepted) {
                let why = "found a page of another machine, expected one of this machine";
                return Err(refusal(StatusCode::FORBIDDEN, why.to_owned()));
            }
        }
        if !rules.protocols.is_empty() {
            let offered = request.headers().get_all(PROTOCOL);
            let offered = offered.iter().filter_map(|value| value.to_str().ok());
            let offered = offered.flat_map(|value| value.split(',').map(str::trim));
            let agreed = offered
                .into_iter()
                .find(|name| rules.protocols.contains(name));
            let Some(agreed) = agreed.and_then(|name| HeaderValue::from_str(name).ok()) else {
                let why = format!(
                    "expected one of the protocols {}",
                    rules.protocols.join(", ")
                );
                return Err(refusal(StatusCode::BAD_REQUEST, why));
            };
            response.headers_mut().insert(PROTOCOL, agreed);
        }
        Ok(response)
    }
}

fn refusal(status: StatusCode, why: String) -> ErrorResponse {
    let mut refused = ErrorResponse::new(Some(why));
    *refused.status_mut() = status;
    refused
}

/// Whether a page comes from this machine: `http://localhost:3000`, `http://127.0.0.1`, or a file.
fn is_of_this_machine(origin: &str) -> bool {
    // Pages from files send `file://`. Sandboxed pages of any site send `null` and are refused.
    let Some((_, rest)) = origin.split_once("://") else {
        return false;
    };
    if origin.starts_with("file://") {
        return true;
    }
    let host = match rest.strip_prefix('[') {
        Some(rest) => rest.split(']').next(),
        None => rest.split(':').next(),
    };
    let host = host.unwrap_or_default();
    host == "localhost" || host.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

impl Connection {
    /// Waits for a message. Cancel safe.
    pub(crate) async fn receive(&mut self) -> io::Result<Received> {
        match self.0.next().await {
            // The last two occur when a browser tab is closed.
            None
            | Some(Ok(Message::Close(_)) | Err(Error::ConnectionClosed | Error::Protocol(_))) => {
                Ok(Received::Closed)
            }
            Some(Ok(Message::Text(text))) => Ok(Received::Text(text)),
            Some(Ok(_)) => Ok(Received::Other),
            Some(Err(error)) => Err(as_io(error)),
        }
    }

    /// Sends all messages completely, unless the client accepts none for [`STALL`] or the streams
    /// stop.
    pub(crate) async fn send(
        &mut self,
        messages: impl IntoIterator<Item = Message>,
        stop: &CancellationToken,
    ) -> io::Result<()> {
        let sending = async {
            for message in messages {
                self.0.feed(message).await?;
            }
            self.0.flush().await
        };
        tokio::select! {
            biased;
            () = stop.cancelled() => Err(io::ErrorKind::Interrupted.into()),
            sent = timeout(STALL, sending) => match sent {
                Ok(sent) => sent.map_err(as_io),
                Err(_) => Err(io::Error::new(io::ErrorKind::TimedOut, "accepted nothing for ten seconds")),
            },
        }
    }

    /// Sends a close frame, with a short time limit.
    pub(crate) async fn close(&mut self) {
        drop(timeout(BREATH, self.0.close(None)).await);
    }
}

fn as_io(error: Error) -> io::Error {
    match error {
        Error::Io(error) => error,
        other => io::Error::other(other.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_of_other_machines_are_refused() {
        for origin in [
            "http://localhost",
            "https://localhost:3000",
            "http://127.0.0.1:8080",
            "http://[::1]:80",
            "file://",
        ] {
            assert!(is_of_this_machine(origin), "{origin}");
        }
        for origin in [
            "null",
            "",
            "http://example.org",
            "http://localhost.example.org",
            "http://127.0.0.1.example.org",
            "http://192.168.1.2",
        ] {
            assert!(!is_of_this_machine(origin), "{origin}");
        }
    }
}
