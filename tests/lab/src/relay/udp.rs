//! Two links between sockets: datagrams of clients go from the relay's port to a server, and back.
//!
//! All clients of one relay share its two links, as behind one radio bridge. Each has a socket of its own towards the server,
//! so that the server distinguishes them.

use std::collections::{BTreeMap, HashMap};
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use super::{Counts, Impairment, RelayLink, on_the_wire};

/// Most clients; later ones are ignored.
const MAX_CLIENTS: usize = 256;
/// Longest datagram that IP carries, bytes.
const MAX_DATAGRAM: usize = 65_535;
/// Interval at which an idle thread checks whether the relay has ended.
const PAUSE: Duration = Duration::from_millis(100);

/// Direction of a datagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// From a client to the server.
    Up,
    /// From the server to a client.
    Down,
}

/// A datagram with the socket and address for sending it.
#[derive(Debug, Clone)]
struct OutgoingDatagram {
    /// The client that sent it or receives it.
    client: SocketAddr,
    socket: Arc<UdpSocket>,
    /// `None`: the socket is connected.
    to: Option<SocketAddr>,
    bytes: Arc<[u8]>,
}

/// A relay on a port of its own; it ends when dropped.
#[derive(Debug)]
pub struct UdpRelay {
    address: SocketAddr,
    shared: Arc<RelayShared>,
    threads: Vec<JoinHandle<()>>,
}

#[derive(Debug)]
struct RelayShared {
    clock: Clock,
    server: SocketAddr,
    /// Up, down.
    links: Mutex<[RelayLink<OutgoingDatagram>; 2]>,
    /// Bytes from each client since the start or the last [`UdpRelay::restart_counts`], with headers.
    up_bytes: Mutex<BTreeMap<SocketAddr, u64>>,
    /// Signals a new datagram, or the end of the relay.
    changed: Condvar,
    ended: AtomicBool,
}

impl UdpRelay {
    /// Listens on `listen` (port 0: a free one) and forwards to `server`, without impairments.
    ///
    /// # Errors
    /// The port is not free, or the system has no thread left.
    pub fn start(listen: SocketAddr, server: SocketAddr, seed: u64) -> io::Result<Self> {
        let socket = Arc::new(UdpSocket::bind(listen)?);
        socket.set_read_timeout(Some(PAUSE))?;
        let perfect = Impairment::default();
        let shared = Arc::new(RelayShared {
            clock: Clock::start(),
            server,
            links: Mutex::new([
                RelayLink::new(perfect, seed),
                RelayLink::new(perfect, !seed),
            ]),
            up_bytes: Mutex::default(),
            changed: Condvar::new(),
            ended: AtomicBool::new(false),
        });
        let mut relay = Self {
            address: socket.local_addr()?,
            shared: Arc::clone(&shared),
            threads: Vec::new(),
        };
        relay.spawn("relay-out", {
            let shared = Arc::clone(&shared);
            move || shared.send_due()
        })?;
        relay.spawn("relay-in", move || listen_to_clients(&shared, &socket))?;
        Ok(relay)
    }

    /// The address for clients.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Changes the impairments of one direction.
    pub fn set(&self, direction: Direction, impairment: Impairment) {
        self.shared.lock()[direction as usize].set(impairment);
    }

    /// Changes the impairments of both directions.
    pub fn set_both(&self, impairment: Impairment) {
        for link in self.shared.lock().iter_mut() {
            link.set(impairment);
        }
    }

    /// Drops everything for `span`, both ways.
    pub fn cut(&self, span: Duration) {
        let span_us = u64::try_from(span.as_micros()).unwrap_or(u64::MAX);
        let until_us = self.shared.clock.now_us().saturating_add(span_us);
        for link in self.shared.lock().iter_mut() {
            link.cut(until_us);
        }
    }

    /// Counts of one direction, since the start or [`Self::restart_counts`].
    pub fn counts(&self, direction: Direction) -> Counts {
        self.shared.lock()[direction as usize].counts().clone()
    }

    /// Resets the counts of both directions.
    pub fn restart_counts(&self) {
        for link in self.shared.lock().iter_mut() {
            link.restart_counts();
        }
        self.shared.up_bytes().clear();
    }

    /// Bytes delivered to the server from each client, since the start or [`Self::restart_counts`], with headers.
    pub fn up_bytes_by_client(&self) -> Vec<u64> {
        self.shared.up_bytes().values().copied().collect()
    }

    fn spawn(&mut self, name: &str, work: impl FnOnce() + Send + 'static) -> io::Result<()> {
        let thread = thread::Builder::new().name(name.to_owned()).spawn(work)?;
        self.threads.push(thread);
        Ok(())
    }
}

impl Drop for UdpRelay {
    fn drop(&mut self) {
        self.shared.ended.store(true, Ordering::Relaxed);
        self.shared.changed.notify_all();
        for thread in self.threads.drain(..) {
            // A thread that panicked has printed its message.
            drop(thread.join());
        }
    }
}

impl RelayShared {
    fn lock(&self) -> MutexGuard<'_, [RelayLink<OutgoingDatagram>; 2]> {
        // A panic elsewhere leaves complete links.
        self.links.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn up_bytes(&self) -> MutexGuard<'_, BTreeMap<SocketAddr, u64>> {
        // A panic elsewhere leaves complete counts.
        self.up_bytes.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn has_ended(&self) -> bool {
        self.ended.load(Ordering::Relaxed)
    }

    fn offer(&self, direction: Direction, outgoing: OutgoingDatagram) {
        let mut links = self.lock();
        let now_us = self.clock.now_us();
        let bytes = outgoing.bytes.len();
        links[direction as usize].offer(now_us, bytes, outgoing);
        self.changed.notify_one();
    }

    /// Thread: sends each datagram when it is due.
    fn send_due(&self) {
        let mut links = self.lock();
        while !self.has_ended() {
            let now_us = self.clock.now_us();
            if let Some(outgoing) = links.iter_mut().find_map(|link| link.take(now_us)) {
                drop(links);
                // A client that has gone refuses, which is a loss like any other.
                let OutgoingDatagram {
                    client,
                    socket,
                    to,
                    bytes,
                } = outgoing;
                if to.is_none() {
                    *self.up_bytes().entry(client).or_default() += on_the_wire(bytes.len()) as u64;
                }
                drop(match to {
                    Some(to) => socket.send_to(&bytes, to),
                    None => socket.send(&bytes),
                });
                links = self.lock();
                continue;
            }
            let next_us = links.iter().filter_map(RelayLink::next_due_us).min();
            let wait = next_us.map_or(PAUSE, |due_us| {
                Duration::from_micros(due_us.saturating_sub(now_us)).min(PAUSE)
            });
            links = match self.changed.wait_timeout(links, wait) {
                Ok((links, _)) => links,
                Err(poisoned) => poisoned.into_inner().0,
            };
        }
    }
}

/// Thread: forwards the datagrams of clients.
fn listen_to_clients(shared: &Arc<RelayShared>, socket: &Arc<UdpSocket>) {
    let mut clients: HashMap<SocketAddr, (Arc<UdpSocket>, JoinHandle<()>)> = HashMap::new();
    let mut buffer = vec![0; MAX_DATAGRAM];
    while !shared.has_ended() {
        let Ok((n, client)) = socket.recv_from(&mut buffer) else {
            continue;
        };
        let is_new = !clients.contains_key(&client);
        if is_new
            && clients.len() < MAX_CLIENTS
            && let Ok(opened) = open_client(shared, socket, client)
        {
            clients.insert(client, opened);
        }
        if let Some((up, _)) = clients.get(&client) {
            let outgoing = OutgoingDatagram {
                client,
                socket: Arc::clone(up),
                to: None,
                bytes: buffer[..n].into(),
            };
            shared.offer(Direction::Up, outgoing);
        }
    }
    for (_, thread) in clients.into_values() {
        // A thread that panicked has printed its message.
        drop(thread.join());
    }
}

/// A socket towards the server for a new client, and the thread that forwards the answers.
fn open_client(
    shared: &Arc<RelayShared>,
    socket: &Arc<UdpSocket>,
    client: SocketAddr,
) -> io::Result<(Arc<UdpSocket>, JoinHandle<()>)> {
    let any = match shared.server {
        SocketAddr::V4(_) => "0.0.0.0:0",
        SocketAddr::V6(_) => "[::]:0",
    };
    let up = Arc::new(UdpSocket::bind(any)?);
    up.connect(shared.server)?;
    up.set_read_timeout(Some(PAUSE))?;
    let (shared, socket, received) = (Arc::clone(shared), Arc::clone(socket), Arc::clone(&up));
    let thread = thread::Builder::new()
        .name("relay-back".to_owned())
        .spawn(move || {
            let mut buffer = vec![0; MAX_DATAGRAM];
            while !shared.has_ended() {
                // A server that has not started refuses; it may start later.
                let Ok(n) = received.recv(&mut buffer) else {
                    continue;
                };
                let outgoing = OutgoingDatagram {
                    client,
                    socket: Arc::clone(&socket),
                    to: Some(client),
                    bytes: buffer[..n].into(),
                };
                shared.offer(Direction::Down, outgoing);
            }
        })?;
    Ok((up, thread))
}

/// Microseconds since the relay's start.
#[derive(Debug, Clone, Copy)]
pub(super) struct Clock(Instant);

impl Clock {
    /// A clock that shows 0.
    #[expect(
        clippy::disallowed_methods,
        reason = "a relay holds datagrams back in real time"
    )]
    pub(super) fn start() -> Self {
        Self(Instant::now())
    }

    pub(super) fn now_us(self) -> u64 {
        u64::try_from(self.0.elapsed().as_micros()).unwrap_or(u64::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Far above what a loaded machine takes for a datagram on the loopback.
    const PATIENCE: Duration = Duration::from_secs(20);

    fn socket() -> UdpSocket {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        socket
    }

    fn received(socket: &UdpSocket) -> (Vec<u8>, SocketAddr) {
        let mut buffer = [0; 2000];
        let (n, from) = socket.recv_from(&mut buffer).unwrap();
        (buffer[..n].to_vec(), from)
    }

    #[test]
    fn answers_find_the_client_that_asked() {
        let server = socket();
        let any = "127.0.0.1:0".parse().unwrap();
        let relay = UdpRelay::start(any, server.local_addr().unwrap(), 1).unwrap();
        let clients = [socket(), socket()];
        for (i, client) in clients.iter().enumerate() {
            client.send_to(&[i as u8; 100], relay.address()).unwrap();
        }
        for _ in 0..2 {
            let (bytes, from) = received(&server);
            server.send_to(&bytes[..10], from).unwrap();
        }
        for (i, client) in clients.iter().enumerate() {
            assert_eq!(received(client).0, [i as u8; 10]);
        }
        let (up, down) = (relay.counts(Direction::Up), relay.counts(Direction::Down));
        assert_eq!((up.offered.datagrams, up.offered.bytes), (2, 256));
        assert_eq!((down.delivered.datagrams, down.delivered.bytes), (2, 76));
        assert_eq!(relay.up_bytes_by_client(), [128, 128]);
    }

    #[test]
    fn a_cut_ends_and_the_link_works_again() {
        let server = socket();
        let any = "127.0.0.1:0".parse().unwrap();
        let relay = UdpRelay::start(any, server.local_addr().unwrap(), 1).unwrap();
        let client = socket();
        relay.cut(Duration::from_millis(50));
        client.send_to(b"lost", relay.address()).unwrap();
        // Repeats until one passes, which takes as long as the machine needs.
        server
            .set_read_timeout(Some(Duration::from_millis(5)))
            .unwrap();
        let mut buffer = [0; 100];
        let n = loop {
            client.send_to(b"again", relay.address()).unwrap();
            if let Ok(n) = server.recv(&mut buffer) {
                break n;
            }
        };
        assert_eq!(&buffer[..n], b"again");
        assert!(relay.counts(Direction::Up).cut >= 1);
        relay.restart_counts();
        relay.set_both(Impairment {
            loss: 1.0,
            ..Impairment::default()
        });
        relay.set(Direction::Down, Impairment::default());
        client.send_to(b"gone", relay.address()).unwrap();
        while relay.counts(Direction::Up).lost == 0 {
            thread::sleep(Duration::from_millis(1));
        }
    }
}
