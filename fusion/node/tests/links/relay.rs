//! A relay of UDP datagrams with a delay and losses.

use std::collections::BTreeMap;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tokio::net::UdpSocket;
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep_until};

/// The largest UDP datagram.
const MAX_BYTES: usize = 65_535;

/// Most datagrams under way in one direction; further ones are lost, as in any router.
const UNDER_WAY: usize = 4096;
/// A datagram and its delivery time.
type Due = (Instant, Vec<u8>);

/// Faults in either direction.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Faults {
    /// Delay in one direction.
    pub(crate) delay: Duration,
    /// One of this many datagrams is lost; 0: none.
    pub(crate) lose_every: u64,
}

/// A relay in front of a local port.
pub(crate) struct Relay {
    /// The port of the relay.
    pub(crate) port: u16,
    /// Datagrams lost since the start.
    pub(crate) lost: Arc<AtomicU64>,
    /// Datagrams received for the target since the start.
    pub(crate) received: Arc<AtomicU64>,
    _tasks: JoinSet<()>,
}

impl Relay {
    /// Carries datagrams to the local port `target` and back.
    pub(crate) async fn before(target: u16, faults: Faults) -> Self {
        let front = Arc::new(
            UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))
                .await
                .expect("a socket"),
        );
        let port = front.local_addr().expect("an address").port();
        let (lost, received): (Arc<AtomicU64>, Arc<AtomicU64>) = <_>::default();
        let mut tasks = JoinSet::new();
        let counts = [&lost, &received].map(Arc::clone);
        tasks.spawn(carry(front, target, faults, counts));
        Self {
            port,
            lost,
            received,
            _tasks: tasks,
        }
    }
}

async fn carry(
    front: Arc<UdpSocket>,
    target: u16,
    faults: Faults,
    [lost, received]: [Arc<AtomicU64>; 2],
) {
    let mut routes: BTreeMap<SocketAddr, mpsc::Sender<Due>> = BTreeMap::new();
    let mut tasks = JoinSet::new();
    let mut buffer = vec![0; MAX_BYTES];
    let mut seen = 0;
    loop {
        let Ok((n, from)) = front.recv_from(&mut buffer).await else {
            continue;
        };
        received.fetch_add(1, Ordering::Relaxed);
        let route = if let Some(route) = routes.get(&from) {
            route.clone()
        } else {
            let back = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).await;
            let back = Arc::new(back.expect("a socket"));
            let connected = back.connect((Ipv4Addr::LOCALHOST, target)).await;
            connected.expect("a route to the target");
            let (route, due) = mpsc::channel(UNDER_WAY);
            tasks.spawn(deliver(due, Arc::clone(&back), None));
            let (front, lost) = (Arc::clone(&front), Arc::clone(&lost));
            tasks.spawn(return_trip(back, front, from, faults, lost));
            routes.insert(from, route.clone());
            route
        };
        if !is_lost(&mut seen, faults, &lost) {
            drop(route.try_send((Instant::now() + faults.delay, buffer[..n].to_vec())));
        }
    }
}

/// Sends each datagram at its delivery time, in order.
async fn deliver(mut due: mpsc::Receiver<Due>, socket: Arc<UdpSocket>, to: Option<SocketAddr>) {
    while let Some((at, datagram)) = due.recv().await {
        if at > Instant::now() {
            sleep_until(at).await;
        }
        // An error means that the target is not there yet: the datagram is lost, as on any network.
        drop(match to {
            Some(to) => socket.send_to(&datagram, to).await,
            None => socket.send(&datagram).await,
        });
    }
}

async fn return_trip(
    back: Arc<UdpSocket>,
    front: Arc<UdpSocket>,
    to: SocketAddr,
    faults: Faults,
    lost: Arc<AtomicU64>,
) {
    let (route, due) = mpsc::channel(UNDER_WAY);
    let mut tasks = JoinSet::new();
    tasks.spawn(deliver(due, front, Some(to)));
    let mut buffer = vec![0; MAX_BYTES];
    let mut seen = 0;
    loop {
        // An error means that the target is not there yet.
        let Ok(n) = back.recv(&mut buffer).await else {
            continue;
        };
        if !is_lost(&mut seen, faults, &lost) {
            drop(route.try_send((Instant::now() + faults.delay, buffer[..n].to_vec())));
        }
    }
}

fn is_lost(seen: &mut u64, faults: Faults, lost: &AtomicU64) -> bool {
    *seen += 1;
    let is_lost = faults.lose_every > 0 && seen.is_multiple_of(faults.lose_every);
    if is_lost {
        lost.fetch_add(1, Ordering::Relaxed);
    }
    is_lost
}
