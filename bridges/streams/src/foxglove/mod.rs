//! Foxglove's WebSocket protocol: Foxglove and Lichtblick show people and cameras live, without a
//! plug-in.
//!
//! Messages are those of [`farfield_export::formats::foxglove`], so a live stream looks like an
//! exported file. The server advertises channels, and a client receives the frames of those it
//! subscribes to. Clients cannot publish, call services or set parameters: the server announces no
//! capabilities and ignores other requests.
//!
//! Time stamps are Unix time: the arrival of the first frame, continued with the venue's clock.
//!
//! Sources: <https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md>; for this subset,
//! `foxglove.sdk.v1` differs only in its name (crate `foxglove` 0.30, `protocol::v1`).

mod channels;
mod client;
mod encoded;

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;

use farfield_proto::camera::CameraModel;
use tokio::net::TcpStream;

use crate::connection::{ConnectionRules, Received, accept_connection};
use crate::server::{listen, take_clients};
use crate::slot::{Feed, Shell};

use client::Client;
use encoded::Encoder;

pub use client::Request;

const RULES: ConnectionRules = ConnectionRules {
    // Enough for subscriptions to every channel of a crowd.
    max_incoming: 64 * 1024,
    protocols: &["foxglove.sdk.v1", "foxglove.websocket.v1"],
    // The web version of Foxglove.
    origins: &["https://app.foxglove.dev"],
};

/// The venue as shown to clients.
#[derive(Debug)]
pub(crate) struct Venue {
    pub(crate) name: String,
    pub(crate) cameras: Vec<CameraModel>,
}

/// Serves clients at `address`; returns the bound address, since the port may be 0.
pub(crate) fn serve(address: SocketAddr, venue: Venue, shell: &Shell) -> io::Result<SocketAddr> {
    let listener = listen(address)?;
    let bound = listener.local_addr()?;
    let clients = shell.clone();
    let shared = Arc::new((venue, Encoder::default()));
    shell.spawn(take_clients(
        listener,
        clients,
        Vec::new(),
        move |(socket, _), shell, feed| serve_client(socket, Arc::clone(&shared), shell, feed),
    ));
    Ok(bound)
}

async fn serve_client(
    socket: TcpStream,
    shared: Arc<(Venue, Encoder)>,
    shell: Shell,
    mut feed: Feed,
) -> (Feed, io::Result<()>) {
    let (venue, encoder) = &*shared;
    let served = send_frames(socket, venue, encoder, &shell, &mut feed).await;
    (feed, served)
}

/// Runs until the client leaves or accepts nothing for too long.
async fn send_frames(
    socket: TcpStream,
    venue: &Venue,
    encoder: &Encoder,
    shell: &Shell,
    feed: &mut Feed,
) -> io::Result<()> {
    let mut connection = tokio::select! {
        biased;
        () = shell.stop.cancelled() => return Ok(()),
        connected = accept_connection(socket, RULES) => connected?,
    };
    let mut client = Client::default();
    let welcome = client.welcome(venue, feed.newest().as_deref());
    connection.send(welcome, &shell.stop).await?;
    feed.catch_up();
    loop {
        tokio::select! {
            biased;
            () = shell.stop.cancelled() => {
                connection.close().await;
                return Ok(());
            }
            received = connection.receive() => match received? {
                Received::Text(text) => {
                    let had_none = !client.has_subscribed();
                    let answers = client.answer(&text, venue, encoder.now());
                    connection.send(answers, &shell.stop).await?;
                    if had_none {
                        feed.catch_up();
                    }
                }
                Received::Other => {}
                Received::Closed => return Ok(()),
            },
            frame = feed.next() => {
                let Some(frame) = frame else { return Ok(()) };
                let (messages, is_data) = client.frame(venue, &encoder.encode(&frame));
                connection.send(messages, &shell.stop).await?;
                if is_data {
                    shell.counters.sent();
                }
            }
        }
    }
}
