//! What senders of datagrams share.

use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};

use tokio::net::UdpSocket;

/// Where to bind a socket that sends to `address`: the loopback for the loopback, else any.
pub(crate) fn any_address(address: SocketAddr) -> IpAddr {
    match address.ip() {
        ip if ip.is_loopback() => ip,
        IpAddr::V4(_) => IpAddr::V4(Ipv4Addr::UNSPECIFIED),
        IpAddr::V6(_) => IpAddr::V6(Ipv6Addr::UNSPECIFIED),
    }
}

/// Whether `ip` is one of this machine's addresses: those can be bound to.
pub(crate) fn is_of_this_machine(ip: IpAddr) -> bool {
    ip.is_loopback() || std::net::UdpSocket::bind((ip, 0)).is_ok()
}

/// Sends datagrams. Where the system takes none, the stream waits and skips frames meanwhile. That nobody listens is no
/// failure.
pub(crate) async fn send_all(
    socket: &UdpSocket,
    datagrams: &[Vec<u8>],
    to: SocketAddr,
) -> io::Result<()> {
    for datagram in datagrams {
        match socket.send_to(datagram, to).await {
            Ok(_) => {}
            // An answer to an earlier datagram.
            Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}
