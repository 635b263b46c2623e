//! What TCP servers share: how they listen, how they take clients, how they write to one that may hang.

use std::io;
use std::net::SocketAddr;
use std::time::Duration;

use tokio::io::{AsyncWrite, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;

use crate::shell::Shell;
use crate::slot::Feed;

/// Most clients of one stream.
const MAX_CLIENTS: usize = 16;
/// Who takes nothing for so long is left.
pub(crate) const STALL: Duration = Duration::from_secs(10);
/// What the system may hold back for one client, bytes (Linux doubles it): some frames, so that a slow client gets new
/// ones and not those of seconds ago.
const SEND_BUFFER: u32 = 64 * 1024;
/// Connections that wait to be taken.
const BACKLOG: u32 = 16;
/// How long to wait when no connection can be taken, as when there are too many open files.
pub(crate) const BREATH: Duration = Duration::from_millis(100);

/// Listens at `address`.
pub(crate) fn listen(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = match address {
        SocketAddr::V4(_) => TcpSocket::new_v4()?,
        SocketAddr::V6(_) => TcpSocket::new_v6()?,
    };
    // So that a stream can start again at once; not so that two can share a port.
    socket.set_reuseaddr(true)?;
    socket.set_send_buffer_size(SEND_BUFFER)?;
    socket.bind(address)?;
    socket.listen(BACKLOG)
}

/// Takes clients for as long as streams run, [`MAX_CLIENTS`] at a time, and serves each in a task of its own. `refusal`: what
/// one too many is told.
pub(crate) async fn take_clients<F>(
    listener: TcpListener,
    shell: Shell,
    refusal: Vec<u8>,
    serve: impl Fn((TcpStream, SocketAddr), Shell, Feed) -> F,
) where
    F: Future<Output = (Feed, io::Result<()>)> + Send + 'static,
{
    loop {
        let (mut socket, peer) = match listener.accept().await {
            Ok(taken) => taken,
            Err(error) => {
                shell.counters.failed(format!("taking a client: {error}"));
                tokio::time::sleep(BREATH).await;
                continue;
            }
        };
        let Some(guard) = shell.counters.client(MAX_CLIENTS) else {
            let why = format!("client {peer}: refused, {MAX_CLIENTS} are there");
            shell.counters.failed(why);
            // Fits into the empty buffer of a new connection, or is not said.
            drop(socket.try_write(&refusal));
            drop(socket.shutdown().await);
            continue;
        };
        let serving = serve((socket, peer), shell.clone(), shell.feed.fresh());
        let client = shell.clone();
        shell.spawn_to_its_end(async move {
            let (mut feed, served) = serving.await;
            // Who is cut off because all stops is none that failed.
            if let Err(error) = served.or_else(|error| match error.kind() {
                io::ErrorKind::Interrupted => Ok(()),
                _ => Err(error),
            }) {
                feed.miss();
                client.counters.failed(format!("client {peer}: {error}"));
            }
            drop(guard);
        });
    }
}

/// Writes all bytes, unless the client takes none for [`STALL`] or the streams stop.
pub(crate) async fn write(
    to: &mut (impl AsyncWrite + Unpin),
    bytes: &[u8],
    stop: &CancellationToken,
) -> io::Result<()> {
    tokio::select! {
        biased;
        () = stop.cancelled() => Err(io::ErrorKind::Interrupted.into()),
        written = timeout(STALL, to.write_all(bytes)) => written.unwrap_or_else(|_| Err(stalled())),
    }
}

/// What is said of who takes nothing for [`STALL`].
pub(crate) fn stalled() -> io::Error {
    io::Error::new(io::ErrorKind::TimedOut, "took nothing for ten seconds")
}
