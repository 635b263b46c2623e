//! One client's WebSocket: how it begins, what may come in, how messages go out.

use std::io;
use std::net::IpAddr;

use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::handshake::server::{ErrorResponse, Request, Response};
use tokio_tungstenite::tungstenite::http::StatusCode;
use tokio_tungstenite::tungstenite::protocol::WebSocketConfig;
use tokio_tungstenite::tungstenite::{Error, Message};
use tokio_tungstenite::{WebSocketStream, accept_hdr_async_with_config};

use futures_util::{SinkExt as _, StreamExt as _};

/// Most bytes of a message that a client may send; none is looked at.
const MAX_INCOMING: usize = 4096;
/// Most bytes that wait for the system to take them: one message of a crowd. A message is only taken when the one before
/// has gone.
const MAX_WAITING: usize = 4 * 1024 * 1024;

/// What a client sent.
pub(super) enum Received {
    /// Something that is not looked at.
    Something,
    /// It leaves.
    Goodbye,
}

/// A client that was let in.
pub(super) struct Connection(WebSocketStream<TcpStream>);

/// Lets a client in, unless another machine's page asks.
pub(super) async fn accept_connection(socket: TcpStream) -> io::Result<Connection> {
    let config = WebSocketConfig::default()
        .max_message_size(Some(MAX_INCOMING))
        .max_frame_size(Some(MAX_INCOMING))
        .read_buffer_size(MAX_INCOMING)
        .max_write_buffer_size(MAX_WAITING);
    let accepted = accept_hdr_async_with_config(socket, check_origin, Some(config)).await;
    accepted.map(Connection).map_err(as_io)
}

#[expect(
    clippy::result_large_err,
    reason = "the type that the handshake asks for"
)]
fn check_origin(request: &Request, response: Response) -> Result<Response, ErrorResponse> {
    let Some(origin) = request.headers().get("origin") else {
        return Ok(response);
    };
    if origin.to_str().is_ok_and(is_of_this_machine) {
        return Ok(response);
    }
    let mut refused = ErrorResponse::new(Some(
        "found a page of another machine, expected one of this".to_owned(),
    ));
    *refused.status_mut() = StatusCode::FORBIDDEN;
    Err(refused)
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
    pub(super) async fn receive(&mut self) -> io::Result<Received> {
        match self.0.next().await {
            // The last two: a browser's tab that was closed.
            None
            | Some(Ok(Message::Close(_)) | Err(Error::ConnectionClosed | Error::Protocol(_))) => {
                Ok(Received::Goodbye)
            }
            Some(Ok(_)) => Ok(Received::Something),
            Some(Err(error)) => Err(as_io(error)),
        }
    }

    /// Sends a message, to the last byte.
    pub(super) async fn send(&mut self, text: &str) -> io::Result<()> {
        self.0.send(Message::text(text)).await.map_err(as_io)
    }

    /// Says goodbye.
    pub(super) async fn close(&mut self) -> io::Result<()> {
        self.0.close(None).await.map_err(as_io)
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
