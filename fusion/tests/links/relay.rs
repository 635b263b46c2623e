//! A relay of UDP datagrams with a delay and losses, so that loss is loss.

use std::collections::BTreeMap;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tokio::net::UdpSocket;
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep_until};

/// Largest datagram there is.
const MAX_BYTES: usize = 65_535;

/// Most datagrams under way in one direction; more are lost, as in any router.
const UNDER_WAY: usize = 4096;
/// A datagram and when it is due.
type Due = (Instant, Vec<u8>);

/// What a relay does to what it carries, either way.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Faults {
    /// One way.
    pub(crate) delay: Duration,
    /// Every how many datagrams one is lost; 0: none.
    pub(crate) lose_every: u64,
}

/// Stands in front of a port of this machine.
pub(crate) struct Relay {
    /// Where it listens.
    pub(crate) port: u16,
    /// Datagrams lost since the start.
    pub(crate) lost: Arc<AtomicU64>,
    /// Datagrams that came for the target since the start.
    pub(crate) came: Arc<AtomicU64>,
    _tasks: JoinSet<()>,
}

impl Relay {
    /// Carries datagrams to `target` of this machine and back.
    pub(crate) async fn before(target: u16, faults: Faults) -> Self {
        let front = Arc::new(
            UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))
                .await
                .expect("a socket"),
        );
        let port = front.local_addr().expect("an address").port();
        let (lost, came): (Arc<AtomicU64>, Arc<AtomicU64>) = <_>::default();
        let mut tasks = JoinSet::new();
        let counts = [&lost, &came].map(Arc::clone);
        tasks.spawn(carry(front, target, faults, counts));
        Self {
            port,
            lost,
            came,
            _tasks: tasks,
        }
    }
}

async fn carry(
    front: Arc<UdpSocket>,
    target: u16,
    faults: Faults,
    [lost, came]: [Arc<AtomicU64>; 2],
) {
    let mut ways: BTreeMap<SocketAddr, mpsc::Sender<Due>> = BTreeMap::new();
    let mut tasks = JoinSet::new();
    let mut buffer = vec![0; MAX_BYTES];
    let mut seen = 0;
    loop {
        let Ok((n, from)) = front.recv_from(&mut buffer).await else {
            continue;
        };
        came.fetch_add(1, Ordering::Relaxed);
        let way = if let Some(way) = ways.get(&from) {
            way.clone()
        } else {
            let back = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).await;
            let back = Arc::new(back.expect("a socket"));
            let connected = back.connect((Ipv4Addr::LOCALHOST, target)).await;
            connected.expect("a way to the target");
            let (way, due) = mpsc::channel(UNDER_WAY);
            tasks.spawn(deliver(due, Arc::clone(&back), None));
            let (front, lost) = (Arc::clone(&front), Arc::clone(&lost));
            tasks.spawn(return_trip(back, front, from, faults, lost));
            ways.insert(from, way.clone());
            way
        };
        if !is_lost(&mut seen, faults, &lost) {
            drop(way.try_send((Instant::now() + faults.delay, buffer[..n].to_vec())));
        }
    }
}

/// Sends each datagram when its time has come, in order.
async fn deliver(mut due: mpsc::Receiver<Due>, socket: Arc<UdpSocket>, to: Option<SocketAddr>) {
    while let Some((at, datagram)) = due.recv().await {
        if at > Instant::now() {
            sleep_until(at).await;
        }
        // An error means that nobody is there (yet): lost, as on any network.
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
    let (way, due) = mpsc::channel(UNDER_WAY);
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
            drop(way.try_send((Instant::now() + faults.delay, buffer[..n].to_vec())));
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
