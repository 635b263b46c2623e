//! An observer of a running venue: what fusion publishes, and when it arrives.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::{Context as _, anyhow};
use farfield_proto::id::SessionId;
use farfield_proto::key::Keys;
use farfield_proto::message::live::LiveStatus;
use farfield_proto::message::{PersonPose, PersonState, PoseSet, Status};
use farfield_proto::tick::Tick;
use farfield_proto::wire;
use zenoh::sample::Sample;
use zenoh::{Session, Wait as _};

/// Arrivals of poses that are remembered: an hour at 60 Hz. Later ones are only counted.
const MAX_ARRIVALS: usize = 60 * 60 * 60;
/// Keys whose newest message is remembered.
const MAX_KEYS: usize = 256;

/// Messages and bytes of a burst of a flood, and the pause after it.
const FLOOD_AT_ONCE: usize = 64;
const FLOOD_MESSAGE_BYTES: usize = 8_000;
const FLOOD_PAUSE: Duration = Duration::from_millis(5);

/// A session that subscribes to all keys of a venue, until it is dropped.
#[derive(Debug)]
pub struct VenueWatch {
    session: Session,
    keys: Keys,
    seen: Arc<Mutex<SeenVenue>>,
}

/// Messages received so far.
#[derive(Debug, Clone, Default)]
pub struct SeenVenue {
    /// Number of pose sets.
    pub poses: u64,
    /// The newest of them.
    pub newest: Option<PoseSet>,
    /// Arrivals of the pose sets.
    pub arrivals: Vec<PoseArrival>,
    /// The newest status of every node.
    pub statuses: BTreeMap<String, Status>,
    /// The newest message of every key, at most `MAX_KEYS` of them.
    pub newest_bytes: BTreeMap<String, Vec<u8>>,
}

/// The arrival of one tick's poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PoseArrival {
    /// Session of fusion.
    pub session: SessionId,
    /// The tick.
    pub tick: Tick,
    /// Unix time of the arrival, microseconds.
    pub arrived_us: u64,
    /// Persons that were tracked.
    pub tracked: usize,
}

impl SeenVenue {
    /// The newest live status of `node`.
    pub fn live(&self, node: &str) -> Option<&LiveStatus> {
        self.statuses.get(node)?.live.as_ref()
    }

    /// Number of tracked persons in the newest poses.
    pub fn tracked(&self) -> usize {
        self.newest.as_ref().map_or(0, tracked)
    }

    /// Share of the poses, without the first fifth, in which as many people are tracked as ever were; 0 if none ever was.
    pub fn share_with_all_tracked(&self) -> f64 {
        let settled = self.arrivals.iter().skip(self.arrivals.len() / 5);
        let most = settled.clone().map(|arrival| arrival.tracked).max();
        let Some(most) = most.filter(|most| *most > 0) else {
            return 0.0;
        };
        let whole = settled.clone().filter(|arrival| arrival.tracked >= most);
        whole.count() as f64 / settled.count().max(1) as f64
    }

    /// Delays from the capture of each tick to the arrival of its poses, from tick `from` on, microseconds, sorted. Empty until
    /// fusion has published the time of its ticks.
    pub fn delays_us(&self, rate_hz: f64, from: Tick) -> Vec<u64> {
        let epoch_us = self.live("fusion").and_then(|live| live.epoch_us);
        let Some(epoch_us) = epoch_us else {
            return Vec::new();
        };
        let arrivals = self.arrivals.iter().filter(|arrival| arrival.tick >= from);
        let delay = |arrival: &PoseArrival| {
            let captured_us = epoch_us as f64 + arrival.tick.seconds(rate_hz) * 1e6;
            (arrival.arrived_us as f64 - captured_us).max(0.0) as u64
        };
        let mut delays: Vec<u64> = arrivals.map(delay).collect();
        delays.sort_unstable();
        delays
    }
}

fn tracked(set: &PoseSet) -> usize {
    let is_tracked = |person: &&PersonPose| person.state == PersonState::Tracked;
    set.persons.iter().filter(is_tracked).count()
}

impl VenueWatch {
    /// Connects to the fusion of venue `name` at `endpoint`; waits until it runs, and reconnects after its restarts.
    ///
    /// # Errors
    /// Zenoh fails.
    pub fn open(name: &str, endpoint: &str) -> anyhow::Result<Self> {
        let session = session(endpoint)?;
        let seen: Arc<Mutex<SeenVenue>> = Arc::default();
        let keys = Keys::new(name);
        let all = Arc::clone(&seen);
        subscribe(&session, keys.all(), move |key, bytes| {
            let newest = &mut lock(&all).newest_bytes;
            if newest.len() < MAX_KEYS || newest.contains_key(key) {
                newest.insert(key.to_owned(), bytes.to_vec());
            }
        })?;
        let poses = Arc::clone(&seen);
        subscribe(&session, keys.pose(), move |_, bytes| {
            if let Ok(set) = wire::decode::<PoseSet>(bytes) {
                let now_us = unix_us();
                lock(&poses).pose(set, now_us);
            }
        })?;
        let statuses = Arc::clone(&seen);
        subscribe(&session, keys.statuses(), move |_, bytes| {
            if let Ok(status) = wire::decode::<Status>(bytes) {
                let node = status.node.clone();
                lock(&statuses).statuses.insert(node, status);
            }
        })?;
        Ok(Self {
            session,
            keys,
            seen,
        })
    }

    /// The messages received so far.
    pub fn seen(&self) -> MutexGuard<'_, SeenVenue> {
        lock(&self.seen)
    }

    /// Calls `receive` with all poses from now on.
    ///
    /// # Errors
    /// Zenoh fails.
    pub fn subscribe_poses(
        &self,
        receive: impl Fn(PoseSet) + Send + Sync + 'static,
    ) -> anyhow::Result<()> {
        subscribe(&self.session, self.keys.pose(), move |_, bytes| {
            if let Ok(set) = wire::decode::<PoseSet>(bytes) {
                receive(set);
            }
        })
    }

    /// Sends noise as the patches of `viewpoint`, as fast as possible, while `during` runs; returns its result and the bytes sent.
    pub fn flood<T>(&self, viewpoint: &str, during: impl FnOnce() -> T) -> (T, u64) {
        let key = self.keys.patch(viewpoint);
        let (is_over, sent_bytes) = (AtomicBool::new(false), AtomicU64::new(0));
        let noise = vec![0xffu8; FLOOD_MESSAGE_BYTES];
        let result = thread::scope(|scope| {
            scope.spawn(|| {
                while !is_over.load(Ordering::Relaxed) {
                    for _ in 0..FLOOD_AT_ONCE {
                        // A refused message is no error here.
                        drop(self.put(&key, &noise));
                    }
                    let bytes = FLOOD_AT_ONCE * FLOOD_MESSAGE_BYTES;
                    sent_bytes.fetch_add(bytes as u64, Ordering::Relaxed);
                    // Leaves half of a core to fusion.
                    thread::sleep(FLOOD_PAUSE);
                }
            });
            let result = during();
            is_over.store(true, Ordering::Relaxed);
            result
        });
        (result, sent_bytes.load(Ordering::Relaxed))
    }

    /// Publishes a message, as a stranger can where no access control is active.
    ///
    /// # Errors
    /// Zenoh fails.
    pub fn put(&self, key: &str, bytes: &[u8]) -> anyhow::Result<()> {
        self.session.put(key, bytes).wait().map_err(zenoh_error)
    }
}

impl SeenVenue {
    fn pose(&mut self, set: PoseSet, now_us: u64) {
        self.poses += 1;
        if self.arrivals.len() < MAX_ARRIVALS {
            self.arrivals.push(PoseArrival {
                session: set.session,
                tick: set.tick,
                arrived_us: now_us,
                tracked: tracked(&set),
            });
        }
        self.newest = Some(set);
    }
}

/// A session with fusion at `endpoint`, which waits without a limit.
pub(super) fn session(endpoint: &str) -> anyhow::Result<Session> {
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", "\"client\"".to_owned()),
        ("scouting/multicast/enabled", "false".to_owned()),
        ("scouting/gossip/enabled", "false".to_owned()),
        ("connect/endpoints", format!("[\"{endpoint}\"]")),
        ("connect/timeout_ms", "-1".to_owned()),
        ("connect/exit_on_failure", "false".to_owned()),
        (
            "connect/retry",
            "{ period_init_ms: 100, period_max_ms: 500, period_increase_factor: 2 }".to_owned(),
        ),
    ] {
        let set = config.insert_json5(key, &value).map_err(zenoh_error);
        set.with_context(|| format!("setting {key} to {value}"))?;
    }
    zenoh::open(config).wait().map_err(zenoh_error)
}

/// Subscribes as long as the session lives.
pub(super) fn subscribe(
    session: &Session,
    key: String,
    receive: impl Fn(&str, &[u8]) + Send + Sync + 'static,
) -> anyhow::Result<()> {
    let callback = move |sample: Sample| {
        receive(sample.key_expr().as_str(), &sample.payload().to_bytes());
    };
    let subscriber = session.declare_subscriber(key).callback(callback);
    subscriber.background().wait().map_err(zenoh_error)
}

fn lock(seen: &Mutex<SeenVenue>) -> MutexGuard<'_, SeenVenue> {
    // A panic elsewhere leaves complete messages.
    seen.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Now, Unix time, microseconds.
pub(super) fn unix_us() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    u64::try_from(since.unwrap_or_default().as_micros()).unwrap_or(u64::MAX)
}

#[expect(clippy::needless_pass_by_value, reason = "what `map_err` takes")]
pub(super) fn zenoh_error(error: zenoh::Error) -> anyhow::Error {
    anyhow!("{error}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use farfield_proto::message::health::NodeHealth;

    fn status_of(node: &str) -> Status {
        Status {
            node: node.to_owned(),
            process: 0,
            viewpoint: None,
            release: String::new(),
            ready: true,
            venue_hash: String::new(),
            calibration_hash: String::new(),
            network_hash: String::new(),
            backend: String::new(),
            ticks: None,
            tick: None,
            unreadable: 0,
            failure: None,
            stages: Vec::new(),
            live: None,
            health: NodeHealth::default(),
            agreement: Vec::new(),
        }
    }

    fn arrival(tick: i64, arrived_us: u64) -> PoseArrival {
        PoseArrival {
            session: SessionId(1),
            tick: Tick(tick),
            arrived_us,
            tracked: 0,
        }
    }

    #[test]
    fn a_delay_is_counted_from_the_capture() {
        let mut seen = SeenVenue {
            arrivals: vec![arrival(60, 6_030_000), arrival(120, 7_020_000)],
            ..SeenVenue::default()
        };
        assert!(seen.delays_us(60.0, Tick(0)).is_empty());
        let mut status = status_of("fusion");
        status.live = Some(LiveStatus {
            epoch_us: Some(5_000_000),
            ..LiveStatus::default()
        });
        seen.statuses.insert("fusion".to_owned(), status);
        assert_eq!(seen.delays_us(60.0, Tick(0)), [20_000, 30_000]);
        assert_eq!(seen.delays_us(60.0, Tick(61)), [20_000]);
    }
}
