//! One client's WebSocket: how it begins, what may come in, how messages go out.

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

/// How long a client may take to say what it wants.
const HANDSHAKE: Duration = Duration::from_secs(5);
/// The head in which protocols above WebSocket are agreed on.
const PROTOCOL: &str = "sec-websocket-protocol";

/// Most bytes that wait for the system to take them: one message of a crowd. A message is only taken when the one before
/// has gone.
const MAX_WAITING: usize = 4 * 1024 * 1024;

/// How a stream meets its clients.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Etiquette {
    /// Most bytes of a message that a client may send.
    pub(crate) max_incoming: usize,
    /// Of these names of protocols above WebSocket the first that a client offers is agreed on; empty: none is asked for.
    pub(crate) protocols: &'static [&'static str],
    /// Pages of other machines that are let in.
    pub(crate) origins: &'static [&'static str],
}

/// What a client sent.
pub(crate) enum Received {
    /// A text.
    Text(Utf8Bytes),
    /// Something that is not looked at.
    Something,
    /// It leaves.
    Goodbye,
}

/// A client that was let in.
pub(crate) struct Connection(WebSocketStream<TcpStream>);

/// Lets a client in, unless another machine's page asks, or one that speaks none of the protocols.
pub(crate) async fn accept_connection(
    socket: TcpStream,
    etiquette: Etiquette,
) -> io::Result<Connection> {
    let config = WebSocketConfig::default()
        .max_message_size(Some(etiquette.max_incoming))
        .max_frame_size(Some(etiquette.max_incoming))
        .read_buffer_size(etiquette.max_incoming)
        .max_write_buffer_size(MAX_WAITING);
    let check = Check(etiquette);
    socket.set_nodelay(true)?;
    // Who has gone without a word is let go of, also where nothing is said to him.
    let keepalive = TcpKeepalive::new()
        .with_time(Duration::from_secs(30))
        .with_interval(Duration::from_secs(10));
    SockRef::from(&socket).set_tcp_keepalive(&keepalive)?;
    let accepting = accept_hdr_async_with_config(socket, check, Some(config));
    match timeout(HANDSHAKE, accepting).await {
        Ok(accepted) => accepted.map(Connection).map_err(as_io),
        Err(_) => Err(io::Error::new(
            io::ErrorKind::TimedOut,
            "did not ask within five seconds",
        )),
    }
}

/// Looks at what a client asks for.
struct Check(Etiquette);

impl Callback for Check {
    fn on_request(
        self,
        request: &Request,
        mut response: Response,
    ) -> Result<Response, ErrorResponse> {
        let Self(etiquette) = self;
        if let Some(origin) = request.headers().get("origin") {
            let is_let_in =
                |origin: &str| is_of_this_machine(origin) || etiquette.origins.contains(&origin);
            if !origin.to_str().is_ok_and(is_let_in) {
                let why = "found a page of another machine, expected one of this";
                return Err(refusal(StatusCode::FORBIDDEN, why.to_owned()));
            }
        }
        if !etiquette.protocols.is_empty() {
            let offered = request.headers().get_all(PROTOCOL);
            let offered = offered.iter().filter_map(|value| value.to_str().ok());
            let offered = offered.flat_map(|value| value.split(',').map(str::trim));
            let agreed = offered
                .into_iter()
                .find(|name| etiquette.protocols.contains(name));
            let Some(agreed) = agreed.and_then(|name| HeaderValue::from_str(name).ok()) else {
                let why = format!(
                    "expected one of the protocols {}",
                    etiquette.protocols.join(", ")
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
    // Pages that are files have no other origin. So have pages in a sandbox, of anybody: these are refused.
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
    /// Waits for something to come in. May be cancelled.
    pub(crate) async fn receive(&mut self) -> io::Result<Received> {
        match self.0.next().await {
            // The last two: a browser's tab that was closed.
            None
            | Some(Ok(Message::Close(_)) | Err(Error::ConnectionClosed | Error::Protocol(_))) => {
                Ok(Received::Goodbye)
            }
            Some(Ok(Message::Text(text))) => Ok(Received::Text(text)),
            Some(Ok(_)) => Ok(Received::Something),
            Some(Err(error)) => Err(as_io(error)),
        }
    }

    /// Sends messages, to the last byte, unless the client takes none for [`STALL`] or the streams stop.
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
                Err(_) => Err(io::Error::new(io::ErrorKind::TimedOut, "took nothing for ten seconds")),
            },
        }
    }

    /// Says goodbye; a client that hangs does not hear it.
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
