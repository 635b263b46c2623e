//! Tasks of the outlet: accepting inlets, one per inlet, and one for each of the two UDP sockets.

use std::hash::{BuildHasher as _, Hasher as _, RandomState};
use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, SocketAddrV4};
use std::sync::Arc;
use std::time::Duration;

use socket2::{Domain, Protocol, Socket, Type};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream, UdpSocket};
use tokio::time::{Instant, sleep_until, timeout};

use super::info::Info;
use super::outlet::{Outlet, Unsent, now};
use super::query::is_met;
use super::request::{Datagram, FeedRequest, Incoming, Request, time_answer};
use super::{DISCOVERY_PORT, PORTS};
use crate::frame::{Frame, VenueFacts};
use crate::server::{BREATH, STALL, is_of_this_machine, listen, stalled, take_clients, write};
use crate::slot::{Feed, Shell};

/// Maximum time for an inlet's request.
const HANDSHAKE: Duration = Duration::from_secs(5);
/// Maximum number of answered datagrams per second: sixteen inlets that query the time in bursts of
/// eight.
const MOST_ANSWERS_PER_S: u32 = 200;
/// Size of a read; no datagram of an inlet is longer.
const READ: usize = 4096;
/// Multicast groups of discovery, in addition to the broadcast address.
const GROUPS: [Ipv4Addr; 2] = [
    Ipv4Addr::new(224, 0, 0, 183),
    Ipv4Addr::new(239, 255, 172, 215),
];

/// Serves inlets at the first free port from that of `address`; returns the bound address.
pub(crate) async fn serve(
    address: SocketAddr,
    facts: &VenueFacts,
    shell: &Shell,
) -> io::Result<SocketAddr> {
    let SocketAddr::V4(address) = address else {
        return Err(io::Error::new(
            io::ErrorKind::Unsupported,
            "expected an IPv4 address",
        ));
    };
    let listener = listen_near(address)?;
    let bound = listener.local_addr()?;
    let service = bind_near(*address.ip(), bound.port()).await?;
    let discovery = listen_for_queries(*address.ip())?;
    let outlet = Arc::new(Outlet::new(Info {
        venue: facts.venue.clone(),
        rate_hz: facts.rate_hz,
        uid: new_uid(),
        hostname: hostname(),
        created_at_s: now().as_secs_f64(),
        data_port: bound.port(),
        service_port: service.local_addr()?.port(),
    }));
    // Replies are sent from the clock's socket: inlets connect to the sender, and from the loopback
    // nothing leaves this machine.
    let service = Arc::new(service);
    for (socket, scope) in [
        (Arc::clone(&service), Scope::for_address(*address.ip())),
        (Arc::new(discovery), Scope::for_address(*address.ip())),
    ] {
        let (service, outlet) = (Arc::clone(&service), Arc::clone(&outlet));
        shell.spawn(async move { answer_datagrams(&socket, &service, &outlet, scope).await });
    }
    shell.spawn(take_clients(
        listener,
        shell.clone(),
        Vec::new(),
        move |(socket, _), shell, feed| serve_inlet(socket, Arc::clone(&outlet), shell, feed),
    ));
    Ok(bound)
}

/// The ports from `first`; any port if it is 0.
fn ports(first: u16) -> std::ops::RangeInclusive<u16> {
    match first {
        0 => 0..=0,
        first => first..=first.saturating_add(PORTS - 1),
    }
}

/// Listens at the first free port, since other outlets of this machine may use some.
fn listen_near(address: SocketAddrV4) -> io::Result<TcpListener> {
    let mut outcome = Err(io::ErrorKind::AddrInUse.into());
    for port in ports(address.port()) {
        outcome = listen(SocketAddr::from((*address.ip(), port)));
        if !is_taken(&outcome) {
            break;
        }
    }
    outcome
}

/// A UDP socket at the first free port.
async fn bind_near(ip: Ipv4Addr, first: u16) -> io::Result<UdpSocket> {
    let mut outcome = Err(io::ErrorKind::AddrInUse.into());
    for port in ports(first) {
        outcome = UdpSocket::bind((ip, port)).await;
        if !is_taken(&outcome) {
            break;
        }
    }
    outcome
}

fn is_taken<T>(outcome: &io::Result<T>) -> bool {
    outcome
        .as_ref()
        .is_err_and(|error| error.kind() == io::ErrorKind::AddrInUse)
}

/// A socket for discovery queries, shared with other outlets of this machine.
fn listen_for_queries(ip: Ipv4Addr) -> io::Result<UdpSocket> {
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_nonblocking(true)?;
    socket.set_reuse_address(true)?;
    // Broadcasts and multicasts of this machine do not reach a socket bound to one address.
    socket.bind(&SocketAddr::from((Ipv4Addr::UNSPECIFIED, DISCOVERY_PORT)).into())?;
    let mut interfaces = vec![Ipv4Addr::UNSPECIFIED, Ipv4Addr::LOCALHOST];
    if !interfaces.contains(&ip) {
        interfaces.push(ip);
    }
    for (group, interface) in GROUPS
        .iter()
        .flat_map(|g| interfaces.iter().map(move |i| (g, i)))
    {
        // Fails without a network; the loopback still works.
        drop(socket.join_multicast_v4(group, interface));
    }
    UdpSocket::from_std(socket.into())
}

/// Which inlets are answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Scope {
    /// Only inlets of this machine.
    ThisMachine,
    /// All inlets.
    All,
}

impl Scope {
    fn for_address(address: Ipv4Addr) -> Self {
        if address.is_loopback() {
            Self::ThisMachine
        } else {
            Self::All
        }
    }

    fn includes(self, sender: IpAddr) -> bool {
        self == Self::All || is_of_this_machine(sender)
    }
}

/// Whether an address is that of a single machine: not multicast, broadcast or unspecified.
fn is_unicast(address: IpAddr) -> bool {
    let is_all = matches!(address, IpAddr::V4(v4) if v4.is_broadcast());
    !(address.is_unspecified() || address.is_multicast() || is_all)
}

/// Answers the datagrams received at `queries` from the socket `service`. Unreadable and unsendable
/// datagrams count as lost.
async fn answer_datagrams(queries: &UdpSocket, service: &UdpSocket, outlet: &Outlet, scope: Scope) {
    let mut bytes = [0; READ];
    let (mut since, mut answers) = (Duration::ZERO, 0);
    loop {
        let Ok((n, from)) = queries.recv_from(&mut bytes).await else {
            tokio::time::sleep(BREATH).await;
            continue;
        };
        let came = now();
        // Replies are longer than queries: limit them, and never reply to group addresses.
        if !is_unicast(from.ip()) {
            continue;
        }
        if came.saturating_sub(since) >= Duration::from_secs(1) {
            (since, answers) = (came, 0);
        }
        if answers >= MOST_ANSWERS_PER_S {
            continue;
        }
        let answered = match Datagram::parse(bytes.get(..n).unwrap_or_default()) {
            Some(Datagram::ShortInfo {
                query,
                return_port,
                id,
            }) if is_met(query, &outlet.info.fields()) && scope.includes(from.ip()) => {
                let text = format!("{id}\r\n{}", outlet.short_xml);
                Some((text, SocketAddr::new(from.ip(), return_port)))
            }
            // The time is only answered on its own port.
            Some(Datagram::TimeData { wave, t0_s }) if std::ptr::eq(queries, service) => {
                let times = [came, now()].map(|it| it.as_secs_f64());
                Some((time_answer(wave, t0_s, times), from))
            }
            _ => None,
        };
        if let Some((text, to)) = answered {
            answers += 1;
            drop(service.send_to(text.as_bytes(), to).await);
        }
    }
}

async fn serve_inlet(
    socket: TcpStream,
    outlet: Arc<Outlet>,
    shell: Shell,
    mut feed: Feed,
) -> (Feed, io::Result<()>) {
    let served = answer_inlet(socket, &outlet, &shell, &mut feed).await;
    (feed, served)
}

/// Handles an inlet's request until it leaves or accepts nothing for too long.
async fn answer_inlet(
    mut socket: TcpStream,
    outlet: &Outlet,
    shell: &Shell,
    feed: &mut Feed,
) -> io::Result<()> {
    socket.set_nodelay(true)?;
    let request = tokio::select! {
        biased;
        () = shell.stop.cancelled() => return Ok(()),
        request = timeout(HANDSHAKE, request(&mut socket)) => request,
    };
    let request = request.unwrap_or_else(|_| {
        let why = "did not send a request within five seconds";
        Err(io::Error::new(io::ErrorKind::TimedOut, why))
    });
    let text = match request? {
        None => return Ok(()),
        Some(Request::Feed(request)) => {
            return send_samples(socket, &request, outlet, shell, feed).await;
        }
        Some(Request::FullInfo) => outlet.full_xml.as_str(),
        Some(Request::ShortInfo(query)) if is_met(&query, &outlet.info.fields()) => {
            outlet.short_xml.as_str()
        }
        Some(Request::ShortInfo(_)) => "",
    };
    write(&mut socket, text.as_bytes(), &shell.stop).await?;
    // Ensures that it is read completely.
    socket.shutdown().await
}

/// Reads an inlet's request; `None` if it left.
async fn request(socket: &mut TcpStream) -> io::Result<Option<Request>> {
    let (mut incoming, mut bytes) = (Incoming::default(), [0; READ]);
    loop {
        let n = socket.read(&mut bytes).await?;
        if n == 0 {
            return Ok(None);
        }
        let request = incoming.push(bytes.get(..n).unwrap_or_default());
        let request = request.map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))?;
        if request.is_some() {
            return Ok(request);
        }
    }
}

async fn send_samples(
    mut socket: TcpStream,
    request: &FeedRequest,
    outlet: &Outlet,
    shell: &Shell,
    feed: &mut Feed,
) -> io::Result<()> {
    let answer = request.answer(&outlet.info.uid);
    write(&mut socket, &answer.head, &shell.stop).await?;
    let Some(version) = answer.data_version else {
        return socket.shutdown().await;
    };
    // Frames that arrive while the inlet reads the opening are already sent to it.
    feed.catch_up();
    write(&mut socket, &outlet.opening(version), &shell.stop).await?;
    let (mut reader, mut writer) = socket.split();
    let mut bytes = [0; READ];
    let mut last: Option<Arc<Frame>> = None;
    let (mut unsent, mut moved_at) = (Unsent::default(), Instant::now());
    loop {
        tokio::select! {
            biased;
            () = shell.stop.cancelled() => return Ok(()),
            // Inlets send nothing more, so a read detects that they leave; data is an error.
            read = reader.read(&mut bytes) => match read {
                Ok(0) => return Ok(()),
                Ok(_) => return Err(io::Error::new(io::ErrorKind::InvalidData, "found unexpected data after the request")),
                Err(error) if error.kind() == io::ErrorKind::ConnectionReset => return Ok(()),
                Err(error) => return Err(error),
            },
            // Each frame is stamped when it arrives, even for slow inlets.
            frame = feed.next() => {
                let Some(frame) = frame else { return Ok(()) };
                let sample = outlet.sample(&frame, version);
                if unsent.is_empty() {
                    moved_at = Instant::now();
                }
                // The announced rate is the venue's, so every tick has a sample.
                let missing = last.take().map(|last| outlet.missing(&last, &frame, version));
                for sample in missing.into_iter().flatten().chain([sample]) {
                    shell.counters.skipped(unsent.push(sample, frame.rate_hz));
                }
                last = Some(frame);
            }
            written = writer.write(unsent.next()), if !unsent.is_empty() => match written? {
                0 => return Err(io::ErrorKind::WriteZero.into()),
                n => {
                    moved_at = Instant::now();
                    if unsent.sent(n) {
                        shell.counters.sent();
                    }
                }
            },
            () = sleep_until(moved_at + STALL), if !unsent.is_empty() => return Err(stalled()),
        }
    }
}

/// A random UUID in lower case.
fn new_uid() -> String {
    // Each hasher state of the standard library has random keys.
    let [a, b] = [0; 2].map(|_: u8| RandomState::new().build_hasher().finish());
    let digits = format!("{a:016x}{b:016x}");
    let mut rest = digits.as_str();
    let parts = [8, 4, 4, 4, 12].map(|n| {
        let (part, after) = rest.split_at_checked(n).unwrap_or((rest, ""));
        rest = after;
        part
    });
    parts.join("-")
}

fn hostname() -> String {
    let system = rustix_clock::system::uname();
    system.nodename().to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_outlet_has_a_unique_id() {
        let [a, b] = [new_uid(), new_uid()];
        assert_ne!(a, b);
        let lengths: Vec<usize> = a.split('-').map(str::len).collect();
        assert_eq!(lengths, [8, 4, 4, 4, 12]);
        assert_eq!(a, a.to_lowercase());
    }

    #[test]
    fn the_loopback_does_not_answer_other_machines() {
        let scope = Scope::for_address(Ipv4Addr::LOCALHOST);
        assert!(scope.includes(Ipv4Addr::LOCALHOST.into()));
        // A documentation address, which no machine has (RFC 5737).
        assert!(!scope.includes(Ipv4Addr::new(203, 0, 113, 7).into()));
        assert!(
            Scope::for_address(Ipv4Addr::UNSPECIFIED)
                .includes(Ipv4Addr::new(203, 0, 113, 7).into())
        );
    }
}
