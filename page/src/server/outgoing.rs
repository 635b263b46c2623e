//! Sends to a client: a message at a time, and not for ever.

use std::time::Duration;

use axum::extract::ws::{CloseFrame, Message, WebSocket};
use futures_util::SinkExt as _;
use tokio::time::timeout;

use crate::protocol::text::TextMessage;

/// How long a client may take to take a message.
const SEND_TIME: Duration = Duration::from_secs(30);

/// Why a client is left.
pub(super) struct Left;

/// Waits for the network, but not for ever.
pub(super) async fn in_time<T>(
    sending: impl Future<Output = Result<T, axum::Error>>,
) -> Result<T, Left> {
    match timeout(SEND_TIME, sending).await {
        Ok(Ok(sent)) => Ok(sent),
        Ok(Err(_)) | Err(_) => Err(Left),
    }
}

pub(super) async fn send(socket: &mut WebSocket, message: Message) -> Result<(), Left> {
    in_time(socket.send(message)).await
}

pub(super) async fn feed(socket: &mut WebSocket, message: Message) -> Result<(), Left> {
    in_time(socket.feed(message)).await
}

pub(super) async fn text(socket: &mut WebSocket, text: String) -> Result<(), Left> {
    send(socket, Message::Text(text.into())).await
}

pub(super) async fn answer(
    socket: &mut WebSocket,
    request: Option<u64>,
    outcome: Result<(), String>,
) -> Result<(), Left> {
    text(socket, TextMessage::answer(request, outcome).to_json()).await
}

pub(super) async fn close(
    socket: &mut WebSocket,
    code: u16,
    reason: &'static str,
) -> Result<(), Left> {
    let frame = CloseFrame {
        code,
        reason: reason.into(),
    };
    send(socket, Message::Close(Some(frame))).await?;
    Err(Left)
}
