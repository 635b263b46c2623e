//! The server: a task that takes connections, and one per client.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;

use tokio::io::AsyncReadExt as _;
use tokio::net::{TcpStream, UdpSocket};

use super::session::Session;
use super::wire::Incoming;
use crate::server::{listen, take_clients, write};
use crate::shell::Shell;
use crate::slot::Feed;
use crate::udp::send_all;

/// Bytes read from a client at once.
const READ: usize = 4096;

/// Serves clients at `address`; says where, as the port may have been left open.
pub(crate) async fn serve(address: SocketAddr, shell: Shell) -> io::Result<SocketAddr> {
    let listener = listen(address)?;
    let bound = listener.local_addr()?;
    // Bound where the clients connect to: datagrams come from the address that they know.
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
    (socket, peer): (TcpStream, SocketAddr),
    udp: Arc<UdpSocket>,
    shell: Shell,
    mut feed: Feed,
) -> (Feed, io::Result<()>) {
    let served = answer_client(socket, peer, &udp, &shell, &mut feed).await;
    (feed, served)
}

/// Until the client leaves, does what cannot be understood, or takes nothing for too long.
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
                // A client that hangs does not hear it.
                let said = writer.try_write(&Session::goodbye());
                drop(said);
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
                    let asked = match incoming.take() {
                        Ok(Some(asked)) => asked,
                        Ok(None) => break,
                        Err(too_long) => {
                            write(&mut writer, &Session::refusal("Parse error"), stop).await?;
                            return Err(io::Error::new(io::ErrorKind::InvalidData, too_long));
                        }
                    };
                    let was_streaming = session.is_streaming();
                    let answer = session.answer(&asked, feed.newest().as_ref());
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
                    // Such as a crowd that fits into no datagram.
                    Err(error) => shell.counters.failed(format!("datagram to {peer}: {error}")),
                }
            }
        }
    }
}
