//! Functions for TCP servers (listening, accepting clients, writing with a time limit) and UDP
//! senders.

use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::time::Duration;

use tokio::io::{AsyncWrite, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpSocket, TcpStream, UdpSocket};
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;

use crate::slot::{Feed, Shell};

/// Maximum number of clients per stream.
const MAX_CLIENTS: usize = 16;
/// A client that accepts nothing for this long is disconnected.
pub(crate) const STALL: Duration = Duration::from_secs(10);
/// Size of the system's send buffer per client, bytes (doubled by Linux). It holds a few frames, so
/// that slow clients receive new frames, not old ones.
const SEND_BUFFER: u32 = 64 * 1024;
/// Maximum number of connections waiting to be accepted.
const BACKLOG: u32 = 16;
/// Delay after failing to accept a connection, for example with too many open files.
pub(crate) const BREATH: Duration = Duration::from_millis(100);

/// Listens at `address`.
pub(crate) fn listen(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = match address {
        SocketAddr::V4(_) => TcpSocket::new_v4()?,
        SocketAddr::V6(_) => TcpSocket::new_v6()?,
    };
    // Allows an immediate restart of a stream, but not two streams on one port.
    socket.set_reuseaddr(true)?;
    socket.set_send_buffer_size(SEND_BUFFER)?;
    socket.bind(address)?;
    socket.listen(BACKLOG)
}

/// Accepts clients while the streams run, at most [`MAX_CLIENTS`] at a time, and serves each in its
/// own task. Surplus clients receive `refusal`.
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
                shell
                    .counters
                    .failed(format!("accepting a client: {error}"));
                tokio::time::sleep(BREATH).await;
                continue;
            }
        };
        let Some(guard) = shell.counters.client(MAX_CLIENTS) else {
            let why = format!("client {peer}: refused, there are already {MAX_CLIENTS}");
            shell.counters.failed(why);
            // Fits into the empty buffer of a new connection, or is not sent.
            drop(socket.try_write(&refusal));
            drop(socket.shutdown().await);
            continue;
        };
        let serving = serve((socket, peer), shell.clone(), shell.feed.fresh());
        let client = shell.clone();
        shell.spawn_until_done(async move {
            let (mut feed, served) = serving.await;
            // Clients that are disconnected by the stop did not fail.
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

/// Writes all bytes, unless the client accepts none for [`STALL`] or the streams stop.
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

/// The error of a client that accepts nothing for [`STALL`].
pub(crate) fn stalled() -> io::Error {
    io::Error::new(io::ErrorKind::TimedOut, "accepted nothing for ten seconds")
}

/// Address to bind for sending to `address`: the loopback for the loopback, otherwise any.
pub(crate) fn any_address(address: SocketAddr) -> IpAddr {
    match address.ip() {
        ip if ip.is_loopback() => ip,
        IpAddr::V4(_) => IpAddr::V4(Ipv4Addr::UNSPECIFIED),
        IpAddr::V6(_) => IpAddr::V6(Ipv6Addr::UNSPECIFIED),
    }
}

/// Whether `ip` is an address of this machine, which can be bound.
pub(crate) fn is_of_this_machine(ip: IpAddr) -> bool {
    ip.is_loopback() || std::net::UdpSocket::bind((ip, 0)).is_ok()
}

/// Sends datagrams. If the system's buffer is full, this waits, and the stream skips frames
/// meanwhile. A missing receiver is no error.
pub(crate) async fn send_all(
    socket: &UdpSocket,
    datagrams: &[Vec<u8>],
    to: SocketAddr,
) -> io::Result<()> {
    for datagram in datagrams {
        match socket.send_to(datagram, to).await {
            Ok(_) => {}
            // The reply to an earlier datagram.
            Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}
