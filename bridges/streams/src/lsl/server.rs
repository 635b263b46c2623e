//! The tasks of the outlet: one that takes inlets and one per inlet, and one each for the two sockets of datagrams.

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
use super::outlet::{Outlet, now};
use super::query::is_met;
use super::request::{Datagram, FeedRequest, Incoming, Request, time_answer};
use super::unsent::Unsent;
use super::{DISCOVERY_PORT, PORTS};
use crate::frame::{Frame, VenueFacts};
use crate::server::{BREATH, STALL, listen, stalled, take_clients, write};
use crate::shell::Shell;
use crate::slot::Feed;
use crate::udp::is_of_this_machine;

/// How long an inlet may take to ask.
const HANDSHAKE: Duration = Duration::from_secs(5);
/// Most datagrams that are answered a second: sixteen inlets that ask for the time in bursts of eight.
const MOST_ANSWERS_PER_S: u32 = 200;
/// Bytes that are read at once; no datagram of an inlet is longer.
const READ: usize = 4096;
/// Groups that inlets ask for streams in, beside that of all machines of a network.
const GROUPS: [Ipv4Addr; 2] = [
    Ipv4Addr::new(224, 0, 0, 183),
    Ipv4Addr::new(239, 255, 172, 215),
];

/// Serves inlets at the first free port from that of `address` on; says where.
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
    // Answers leave by the socket of the clock: inlets connect to where they come from, and from the loopback none leaves this machine.
    let service = Arc::new(service);
    for (asked, who) in [
        (Arc::clone(&service), Who::of(*address.ip())),
        (Arc::new(discovery), Who::of(*address.ip())),
    ] {
        let (service, outlet) = (Arc::clone(&service), Arc::clone(&outlet));
        shell.spawn(async move { answer_datagrams(&asked, &service, &outlet, who).await });
    }
    shell.spawn(take_clients(
        listener,
        shell.clone(),
        Vec::new(),
        move |(socket, _), shell, feed| serve_inlet(socket, Arc::clone(&outlet), shell, feed),
    ));
    Ok(bound)
}

/// The ports from that of `address` on; any where that is 0.
fn ports(first: u16) -> std::ops::RangeInclusive<u16> {
    match first {
        0 => 0..=0,
        first => first..=first.saturating_add(PORTS - 1),
    }
}

/// Listens at the first free port: other outlets of this machine may have some.
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

/// A socket for datagrams at the first free port.
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

/// A socket that hears who asks for streams, beside those of other outlets of this machine.
fn listen_for_queries(ip: Ipv4Addr) -> io::Result<UdpSocket> {
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_nonblocking(true)?;
    socket.set_reuse_address(true)?;
    // Inlets of this machine ask by broadcast and multicast too, which come to no socket that is bound to one address.
    socket.bind(&SocketAddr::from((Ipv4Addr::UNSPECIFIED, DISCOVERY_PORT)).into())?;
    let mut interfaces = vec![Ipv4Addr::UNSPECIFIED, Ipv4Addr::LOCALHOST];
    if !interfaces.contains(&ip) {
        interfaces.push(ip);
    }
    for (group, interface) in GROUPS
        .iter()
        .flat_map(|g| interfaces.iter().map(move |i| (g, i)))
    {
        // A machine without that network is asked at its loopback.
        drop(socket.join_multicast_v4(group, interface));
    }
    UdpSocket::from_std(socket.into())
}

/// Who is answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Who {
    /// Inlets of this machine alone.
    ThisMachine,
    /// Whoever asks.
    All,
}

impl Who {
    fn of(address: Ipv4Addr) -> Self {
        if address.is_loopback() {
            Self::ThisMachine
        } else {
            Self::All
        }
    }

    fn is_answered(self, asks: IpAddr) -> bool {
        self == Self::All || is_of_this_machine(asks)
    }
}

/// Whether an address is that of one machine, not of a group, all or none.
fn is_of_one(address: IpAddr) -> bool {
    let is_all = matches!(address, IpAddr::V4(v4) if v4.is_broadcast());
    !(address.is_unspecified() || address.is_multicast() || is_all)
}

/// Task: answers what comes to `asked`, by `service`. What cannot be read or sent is as if it had been lost on the way.
async fn answer_datagrams(asked: &UdpSocket, service: &UdpSocket, outlet: &Outlet, who: Who) {
    let mut bytes = [0; READ];
    let (mut since, mut answers) = (Duration::ZERO, 0);
    loop {
        let Ok((n, from)) = asked.recv_from(&mut bytes).await else {
            tokio::time::sleep(BREATH).await;
            continue;
        };
        let came = now();
        // Answers are longer than questions: nobody's address is good for more than a few, and none for a group's.
        if !is_of_one(from.ip()) {
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
            }) if is_met(query, &outlet.info.fields()) && who.is_answered(from.ip()) => {
                let text = format!("{id}\r\n{}", outlet.short_xml);
                Some((text, SocketAddr::new(from.ip(), return_port)))
            }
            // The clock is asked for at its own port alone.
            Some(Datagram::TimeData { wave, t0_s }) if std::ptr::eq(asked, service) => {
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

/// Reads what an inlet asks, and does it, until it leaves or takes nothing for too long.
async fn answer_inlet(
    mut socket: TcpStream,
    outlet: &Outlet,
    shell: &Shell,
    feed: &mut Feed,
) -> io::Result<()> {
    socket.set_nodelay(true)?;
    let asked = tokio::select! {
        biased;
        () = shell.stop.cancelled() => return Ok(()),
        asked = timeout(HANDSHAKE, request(&mut socket)) => asked,
    };
    let asked = asked.unwrap_or_else(|_| {
        let why = "did not ask within five seconds";
        Err(io::Error::new(io::ErrorKind::TimedOut, why))
    });
    let text = match asked? {
        None => return Ok(()),
        Some(Request::Feed(asked)) => {
            return send_samples(socket, &asked, outlet, shell, feed).await;
        }
        Some(Request::FullInfo) => outlet.full_xml.as_str(),
        Some(Request::ShortInfo(query)) if is_met(&query, &outlet.info.fields()) => {
            outlet.short_xml.as_str()
        }
        Some(Request::ShortInfo(_)) => "",
    };
    write(&mut socket, text.as_bytes(), &shell.stop).await?;
    // So that it is read to its end.
    socket.shutdown().await
}

/// What an inlet asks; `None`: it has gone.
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
    asked: &FeedRequest,
    outlet: &Outlet,
    shell: &Shell,
    feed: &mut Feed,
) -> io::Result<()> {
    let answer = asked.answer(&outlet.info.uid);
    write(&mut socket, &answer.head, &shell.stop).await?;
    let Some(version) = answer.data_version else {
        return socket.shutdown().await;
    };
    // What comes while it reads the opening is its own already.
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
            // Inlets say nothing more: that they leave is heard so, and who talks is none.
            read = reader.read(&mut bytes) => match read {
                Ok(0) => return Ok(()),
                Ok(_) => return Err(io::Error::new(io::ErrorKind::InvalidData, "talks while it is sent samples")),
                Err(error) if error.kind() == io::ErrorKind::ConnectionReset => return Ok(()),
                Err(error) => return Err(error),
            },
            // Each is taken, and stamped, when it comes, however slow the inlet is.
            frame = feed.next() => {
                let Some(frame) = frame else { return Ok(()) };
                let sample = outlet.sample(&frame, version);
                if unsent.is_empty() {
                    moved_at = Instant::now();
                }
                // Its rate is said to be the venue's: so it has a sample of every tick.
                let missed = last.take().map(|last| outlet.missed(&last, &frame, version));
                for sample in missed.into_iter().flatten().chain([sample]) {
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

/// A UUID by chance, in small letters.
fn new_uid() -> String {
    // Each state of the standard library's hash has keys of its own, by chance.
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
    fn every_outlet_has_a_uid_of_its_own() {
        let [a, b] = [new_uid(), new_uid()];
        assert_ne!(a, b);
        let lengths: Vec<usize> = a.split('-').map(str::len).collect();
        assert_eq!(lengths, [8, 4, 4, 4, 12]);
        assert_eq!(a, a.to_lowercase());
    }

    #[test]
    fn strangers_are_not_answered_from_the_loopback() {
        let who = Who::of(Ipv4Addr::LOCALHOST);
        assert!(who.is_answered(Ipv4Addr::LOCALHOST.into()));
        // A documentation address is nobody's (RFC 5737).
        assert!(!who.is_answered(Ipv4Addr::new(203, 0, 113, 7).into()));
        assert!(Who::of(Ipv4Addr::UNSPECIFIED).is_answered(Ipv4Addr::new(203, 0, 113, 7).into()));
    }
}
