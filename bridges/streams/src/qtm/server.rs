//! The server: a task that accepts connections, and one per client.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;

use tokio::io::AsyncReadExt as _;
use tokio::net::{TcpStream, UdpSocket};

use super::session::Session;
use super::wire::Incoming;
use crate::server::{listen, send_all, take_clients, write};
use crate::slot::{Feed, Shell};

/// Size of a read.
const READ: usize = 4096;

/// Serves clients at `address`; returns the bound address, since the port may be 0.
pub(crate) async fn serve(address: SocketAddr, shell: Shell) -> io::Result<SocketAddr> {
    let listener = listen(address)?;
    let bound = listener.local_addr()?;
    // Bound to the server's address, so that datagrams come from the address that clients know.
    let udp = UdpSocket::bind(SocketAddr::new(bound.ip(), 0)).await?;
    let udp = Arc::new(udp);
    let clients = shell.clone();
    shell.spawn(take_clients(
        listener,
        clients,
        Session::refusal("Too many clients"),
        move |client, shell, feed| serve_client(client, Arc::clone(&udp), shell, feed),
    ));
    Ok(bound)
}

async fn serve_client(
    client: (TcpStream, SocketAddr),
    udp: Arc<UdpSocket>,
    shell: Shell,
    mut feed: Feed,
) -> (Feed, io::Result<()>) {
    let (socket, peer) = client;
    let served = answer_client(socket, peer, &udp, &shell, &mut feed).await;
    (feed, served)
}

/// Runs until the client leaves, sends invalid data, or accepts nothing for too long.
async fn answer_client(
    mut socket: TcpStream,
    peer: SocketAddr,
    udp: &UdpSocket,
    shell: &Shell,
    feed: &mut Feed,
) -> io::Result<()> {
    socket.set_nodelay(true)?;
    let stop = &shell.stop;
    let (mut reader, mut writer) = socket.split();
    let (mut session, mut incoming) = (Session::new(peer.ip()), Incoming::default());
    let mut bytes = [0; READ];
    feed.catch_up();
    write(&mut writer, &Session::welcome(), stop).await?;
    loop {
        tokio::select! {
            biased;
            () = stop.cancelled() => {
                // A client that hangs does not receive it.
                drop(writer.try_write(&Session::goodbye()));
                return Ok(());
            }
            read = reader.read(&mut bytes) => {
                let n = match read {
                    Ok(0) => return Ok(()),
                    Ok(n) => n,
                    Err(error) if error.kind() == io::ErrorKind::ConnectionReset => return Ok(()),
                    Err(error) => return Err(error),
                };
                incoming.push(bytes.get(..n).unwrap_or_default());
                loop {
                    let request = match incoming.take() {
                        Ok(Some(request)) => request,
                        Ok(None) => break,
                        Err(too_long) => {
                            write(&mut writer, &Session::refusal("Parse error"), stop).await?;
                            return Err(io::Error::new(io::ErrorKind::InvalidData, too_long));
                        }
                    };
                    let was_streaming = session.is_streaming();
                    let answer = session.answer(&request, feed.newest().as_ref());
                    if !was_streaming {
                        feed.catch_up();
                    }
                    write(&mut writer, &answer.bytes, stop).await?;
                    if answer.closes {
                        return Ok(());
                    }
                }
            }
            frame = feed.next() => {
                let Some(frame) = frame else { return Ok(()) };
                let (tcp, datagram) = session.frame(&frame);
                let is_data = !tcp.is_empty() && session.is_streaming() || datagram.is_some();
                write(&mut writer, &tcp, stop).await?;
                let sent = match datagram {
                    Some((to, data)) => send_all(udp, &[data], to).await,
                    None => Ok(()),
                };
                match sent {
                    Ok(()) if is_data => shell.counters.sent(),
                    Ok(()) => {}
                    // For example, a crowd that does not fit into a datagram.
                    Err(error) => shell.counters.failed(format!("datagram to {peer}: {error}")),
                }
            }
        }
    }
}
