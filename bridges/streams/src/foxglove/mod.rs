//! Foxglove's WebSocket protocol: its program, and Lichtblick, show people and cameras live, without a plug-in.
//!
//! Messages are those of [`farfield_export::formats::foxglove`], so a live stream looks like an exported file. A client is
//! told of channels, subscribes to some, and gets each frame's messages of these. It cannot publish, call or set anything:
//! the server says that it is capable of nothing else, and looks at nothing else.
//!
//! Time stamps are Unix time: that of the first frame, when it came, and from then on the venue's clock.
//!
//! Sources: <https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md>; `foxglove.sdk.v1` differs from it in name alone
//! for what is used here (crate `foxglove` 0.30, `protocol::v1`).

mod channels;
mod client;
mod encoded;

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;

use farfield_proto::camera::CameraModel;
use tokio::net::TcpStream;

use crate::connection::{Etiquette, Received, accept_connection};
use crate::server::{listen, take_clients};
use crate::shell::Shell;
use crate::slot::Feed;

use client::Client;
use encoded::Encoder;

pub use client::Request;

const ETIQUETTE: Etiquette = Etiquette {
    // Subscriptions to every channel of a crowd.
    max_incoming: 64 * 1024,
    protocols: &["foxglove.sdk.v1", "foxglove.websocket.v1"],
    // The program itself, where it is a page.
    origins: &["https://app.foxglove.dev"],
};

/// What clients are told of the venue.
#[derive(Debug)]
pub(crate) struct Venue {
    pub(crate) name: String,
    pub(crate) cameras: Vec<CameraModel>,
}

/// Serves clients at `address`; says where, as the port may have been left open.
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

/// Until the client leaves, or takes nothing for too long.
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
        connected = accept_connection(socket, ETIQUETTE) => connected?,
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
                Received::Something => {}
                Received::Goodbye => return Ok(()),
            },
            frame = feed.next() => {
                let Some(frame) = frame else { return Ok(()) };
                let (messages, is_data) = client.frame(venue, &encoder.of(&frame));
                connection.send(messages, &shell.stop).await?;
                if is_data {
                    shell.counters.sent();
                }
            }
        }
    }
}
