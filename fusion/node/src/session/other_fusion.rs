//! Detects another fusion of the same venue: edges would follow whichever they reach. It watches the endpoints where edges connect:
//! before this node listens, again when a live node has begun to listen, and during the run.
//!
//! Another fusion is detected by its liveliness token, which ends with its session: a killed one delays others at most for
//! [`farfield_proto::transport::LEASE`]. Its details come from its status.

use std::collections::BTreeMap;
use std::fmt;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::sync::Arc;
use std::time::Duration;

use anyhow::anyhow;
use farfield_node::clock;
use farfield_node::endpoints::Reach;
use farfield_node::process::{NodeError, say};
use farfield_node::session;
use farfield_proto::id::SessionId;
use farfield_proto::key::Keys;
use farfield_proto::message::Status;
use farfield_proto::tick::Tick;
use farfield_proto::transport::endpoint::{at_host, host, port, scheme};
use farfield_proto::transport::{EdgeTransport, FUSION, Identity};
use farfield_proto::venue::Venue;
use farfield_proto::wire;
use tokio::sync::watch;
use tokio::time::{Instant, MissedTickBehavior, interval, timeout_at};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::debug;
use zenoh::Session;
use zenoh::sample::SampleKind;
use zenoh::session::ZenohId;

use super::messages::RunMode;

/// Time for another fusion to answer: several round trips of a far link. A starting fusion waits this long if its venue names
/// endpoints of other machines, and a live one again after it listens.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(2);
/// Time for the status of a fusion that has answered: a live one sends it once a second.
const STATUS_TIMEOUT: Duration = Duration::from_millis(1500);
/// Interval of the reminders that this fusion waits.
const REMIND_EVERY: Duration = Duration::from_secs(10);
/// Messages queued between Zenoh and the task.
const QUEUE: usize = 16;

/// Facts about another fusion of the venue.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct OtherFusion {
    release: String,
    session: Option<SessionId>,
    tick: Option<Tick>,
    is_live: bool,
    /// The viewpoints that it receives.
    edges: Vec<String>,
    /// Zenoh's id of its session.
    id: Option<ZenohId>,
    /// Whether it has sent any status, readable or not.
    is_at_work: bool,
}

impl OtherFusion {
    /// A fusion without a status.
    fn unknown(id: Option<ZenohId>) -> Self {
        Self {
            id,
            ..Self::default()
        }
    }

    /// The same fusion with its `status`.
    fn with_status(&self, status: &Status) -> Self {
        let live = status.live.as_ref();
        let edges = live.into_iter().flat_map(|live| &live.edges);
        Self {
            id: self.id,
            is_at_work: true,
            release: status.release.clone(),
            session: status.health.follows,
            tick: status.tick,
            is_live: live.is_some(),
            edges: edges
                .filter(|edge| edge.live)
                .map(|edge| edge.viewpoint.clone())
                .collect(),
        }
    }

    /// Whether this node, with session `own`, must leave the edges to it: it is at work, or of two that have just begun to listen it
    /// is the one that both choose.
    fn comes_before(&self, own: ZenohId) -> bool {
        let is_first = |id: ZenohId| id.to_le_bytes() < own.to_le_bytes();
        self.is_at_work || self.id.is_some_and(is_first)
    }
}

impl fmt::Display for OtherFusion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut facts = Vec::new();
        if !self.release.is_empty() {
            facts.push(format!("farfield {}", self.release));
        }
        if let Some(session) = self.session {
            facts.push(format!("session {:x}", session.0));
            facts.extend(age(session));
        }
        if self.is_live {
            facts.push("live".to_owned());
        }
        facts.extend(self.tick.map(|tick| format!("at tick {tick}")));
        if !self.edges.is_empty() {
            facts.push(format!("receives from {}", self.edges.join(", ")));
        }
        f.write_str(&facts.join(", "))
    }
}

/// The age of a session, in words. Its number is its start time.
fn age(session: SessionId) -> Option<String> {
    let began_s = i64::try_from((session.0 & !(1 << 63)) / 1_000_000_000).ok()?;
    let s = clock::unix_s().checked_sub(began_s)?;
    match s {
        0..120 => Some(format!("begun {s} s ago")),
        120..7200 => Some(format!("begun {} min ago", s / 60)),
        7200..31_536_000 => Some(format!("begun {} h ago", s / 3600)),
        // One of the clocks is wrong, or the number is no time.
        _ => None,
    }
}

/// How a fusion became the only one of its venue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Place {
    /// There was no other.
    Free,
    /// Another has ended; its sockets may still be closing.
    Inherited,
}

/// The fusions that answer now, by endpoint.
type Answering = BTreeMap<String, OtherFusion>;

/// Watches every endpoint where another fusion may listen.
#[derive(Debug, Clone)]
pub(crate) struct OtherFusionWatch {
    venue: String,
    endpoints: Vec<String>,
    answering: watch::Receiver<Answering>,
    /// This node's own session, once it is open: the watch may detect itself.
    own: Arc<watch::Sender<Option<ZenohId>>>,
}

/// The watch of one endpoint.
struct EndpointWatch {
    venue: String,
    endpoint: String,
    identity: Option<Identity>,
    answering: Arc<watch::Sender<Answering>>,
    own: Arc<watch::Sender<Option<ZenohId>>>,
}

impl OtherFusionWatch {
    /// Watches the endpoints where the edges of `venue` connect, except those where only this node can listen, given `reach`.
    pub(crate) async fn start(
        venue: &Venue,
        reach: &Reach,
        tasks: &TaskTracker,
        leave: &CancellationToken,
    ) -> Self {
        let mut endpoints = Vec::new();
        for endpoint in &venue.endpoints.connect {
            if !is_own(endpoint, &reach.endpoints).await {
                endpoints.push(endpoint.clone());
            }
        }
        Self::at(&venue.name, endpoints, reach, tasks, leave)
    }

    /// Watches the endpoints that this node cannot listen on because another process does.
    pub(crate) fn at_taken(
        venue: &Venue,
        reach: &Reach,
        tasks: &TaskTracker,
        leave: &CancellationToken,
    ) -> Self {
        let endpoints = reach.endpoints.iter().map(|endpoint| reachable(endpoint));
        Self::at(&venue.name, endpoints.collect(), reach, tasks, leave)
    }

    /// Watches no endpoint: the parent process has given its edges the endpoint of this node.
    pub(crate) fn nowhere() -> Self {
        Self {
            venue: String::new(),
            endpoints: Vec::new(),
            answering: watch::channel(Answering::new()).1,
            own: Arc::new(watch::Sender::new(None)),
        }
    }

    fn at(
        venue: &str,
        endpoints: Vec<String>,
        reach: &Reach,
        tasks: &TaskTracker,
        leave: &CancellationToken,
    ) -> Self {
        let (sender, answering) = watch::channel(Answering::new());
        let (sender, own) = (Arc::new(sender), Arc::new(watch::Sender::new(None)));
        for endpoint in &endpoints {
            let watch = EndpointWatch {
                venue: venue.to_owned(),
                endpoint: endpoint.clone(),
                identity: reach.identity.clone(),
                answering: Arc::clone(&sender),
                own: Arc::clone(&own),
            };
            tasks.spawn(watch.run(leave.clone()));
        }
        Self {
            venue: venue.to_owned(),
            endpoints,
            answering,
            own,
        }
    }

    /// Sets this node's own session, before its token is declared: it is no other fusion.
    pub(crate) fn set_own(&self, own: ZenohId) {
        self.own.send_replace(Some(own));
    }

    /// The first fusion that answers within [`ANSWER_TIMEOUT`], with its status.
    pub(crate) async fn first(&self) -> Option<String> {
        if self.endpoints.is_empty() {
            return None;
        }
        let mut answering = self.answering.clone();
        let until = Instant::now() + ANSWER_TIMEOUT;
        let answered = timeout_at(until, answering.wait_for(|all| !all.is_empty())).await;
        drop(answered.ok()?.ok()?);
        let has_status = |all: &Answering| all.values().any(|other| other.session.is_some());
        let until = Instant::now() + STATUS_TIMEOUT;
        drop(timeout_at(until, answering.wait_for(has_status)).await);
        self.described()
    }

    /// Whether this node, which has just begun to listen, must leave the edges to another that began at the same moment. Neither
    /// could detect the other before; one of two continues.
    pub(crate) async fn must_step_back(&self, own: ZenohId) -> bool {
        if self.endpoints.is_empty() {
            return false;
        }
        let before = |all: &Answering| all.values().any(|other| other.comes_before(own));
        let mut answering = self.answering.clone();
        let until = Instant::now() + ANSWER_TIMEOUT;
        let detected = timeout_at(until, answering.wait_for(before)).await;
        if matches!(detected, Ok(Ok(_))) {
            return true;
        }
        drop(detected);
        // A remaining fusion will step back, or has not detected this node and is about to begin.
        let is_decided = |all: &Answering| all.is_empty() || before(all);
        let until = Instant::now() + STATUS_TIMEOUT;
        let decided = timeout_at(until, answering.wait_for(is_decided)).await;
        decided.is_ok_and(|all| all.is_ok_and(|all| !all.is_empty()))
    }

    /// Describes all fusions that answer now; `None` if there are none.
    pub(crate) fn described(&self) -> Option<String> {
        let answering = self.answering.borrow();
        let lines = answering.iter().map(|(endpoint, other)| match other {
            other if other.to_string().is_empty() => endpoint.clone(),
            other => format!("{endpoint} ({other})"),
        });
        let lines: Vec<String> = lines.collect();
        (!lines.is_empty()).then(|| lines.join(" and "))
    }

    /// Returns when a run may begin: in lock-step there must be no other fusion, a live one waits until the other has ended. `None`
    /// if stopped before.
    ///
    /// # Errors
    /// [`NodeError::Refused`] with the other fusion.
    pub(crate) async fn wait_until_alone(
        &self,
        mode: RunMode,
        stop: &CancellationToken,
    ) -> Result<Option<Place>, NodeError> {
        let other = match stop.run_until_cancelled(self.first()).await {
            Some(Some(other)) => other,
            Some(None) => return Ok(Some(Place::Free)),
            None => return Ok(None),
        };
        let venue = &self.venue;
        if mode == RunMode::LockStep {
            return Err(NodeError::Refused(anyhow!(
                "a fusion of venue {venue} is already running: {other}; end it first, or give the venue file of this run another `name`, or another `[fusion] connect`"
            )));
        }
        let mut answering = self.answering.clone();
        let mut reminders = interval(REMIND_EVERY);
        reminders.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                () = stop.cancelled() => return Ok(None),
                ended = answering.wait_for(Answering::is_empty) => {
                    drop(ended);
                    say(format_args!("the other fusion of venue {venue} has gone: this one takes its place"));
                    return Ok(Some(Place::Inherited));
                }
                _ = reminders.tick() => {
                    let other = self.described().unwrap_or_else(|| other.clone());
                    say(format_args!(
                        "a fusion of venue {venue} is already running: {other}; this one waits until it has gone: stop one of the two"
                    ));
                }
            }
        }
    }
}

impl EndpointWatch {
    /// Runs until `leave`: the session finds every fusion that starts or returns.
    async fn run(self, leave: CancellationToken) {
        let connect = [self.endpoint.clone()];
        let transport = EdgeTransport {
            venue: &self.venue,
            connect: &connect,
            identity: self.identity.as_ref(),
        };
        let session = match leave
            .run_until_cancelled(session::connect(&transport))
            .await
        {
            Some(Ok(session)) => session,
            Some(Err(error)) => {
                debug!(endpoint = self.endpoint, %error, "cannot watch this endpoint for another fusion");
                return;
            }
            None => return,
        };
        if let Some(Err(error)) = leave.run_until_cancelled(self.listen(&session)).await {
            debug!(endpoint = self.endpoint, %error, "no longer watching this endpoint for another fusion");
        }
        self.set(None);
        session::close(&session).await;
    }

    async fn listen(&self, session: &Session) -> anyhow::Result<()> {
        let keys = Keys::new(&self.venue);
        let statuses = session::subscriber(session, keys.status(FUSION), QUEUE).await?;
        let tokens = session::liveliness(session, keys.alive(FUSION), QUEUE).await?;
        loop {
            tokio::select! {
                token = tokens.recv_async() => match token.map_err(session::zenoh_error)?.kind() {
                    SampleKind::Put => {
                        let id = session.info().routers_zid().await.next();
                        // This node itself may answer, under another name or over an indirect route.
                        if id.is_none() || *self.own.borrow() != id {
                            self.set(Some(OtherFusion::unknown(id)));
                        }
                    }
                    SampleKind::Delete => self.set(None),
                },
                status = statuses.recv_async() => {
                    let bytes = status.map_err(session::zenoh_error)?;
                    let status = wire::decode::<Status>(&bytes.payload().to_bytes());
                    self.add_status(status.ok().as_ref());
                }
            }
        }
    }

    fn set(&self, other: Option<OtherFusion>) {
        self.answering.send_if_modified(|all| match other {
            Some(other) => all.insert(self.endpoint.clone(), other).is_none(),
            None => all.remove(&self.endpoint).is_some(),
        });
    }

    /// Adds the status of a known fusion, `None` if unreadable. Without a token there is no fusion.
    fn add_status(&self, status: Option<&Status>) {
        self.answering.send_if_modified(|all| {
            let known = all.get_mut(&self.endpoint);
            known.is_some_and(|known| {
                let updated = match status {
                    Some(status) => known.with_status(status),
                    None => OtherFusion {
                        is_at_work: true,
                        ..known.clone()
                    },
                };
                std::mem::replace(known, updated) != *known
            })
        });
    }
}

/// Whether only this node can be at `endpoint` once it listens at `listen`: a port of an address of this machine.
async fn is_own(endpoint: &str, listen: &[String]) -> bool {
    let Some(wanted) = port(endpoint) else {
        return false;
    };
    let is_datagrams = |endpoint: &str| matches!(scheme(endpoint), "udp" | "quic");
    let listens = listen
        .iter()
        .any(|own| port(own) == Some(wanted) && is_datagrams(own) == is_datagrams(endpoint));
    if !listens {
        return false;
    }
    let resolved = tokio::net::lookup_host((host(endpoint), wanted));
    let resolved = tokio::time::timeout(ANSWER_TIMEOUT, resolved);
    let Ok(Ok(mut addresses)) = resolved.await else {
        return false;
    };
    addresses.any(|address| is_of_this_machine(address.ip()))
}

/// Only an address of this machine can be bound.
fn is_of_this_machine(address: IpAddr) -> bool {
    UdpSocket::bind(SocketAddr::new(address, 0)).is_ok()
}

/// An address at which a listener on `endpoint` of this machine answers.
fn reachable(endpoint: &str) -> String {
    match host(endpoint).parse() {
        Ok(IpAddr::V4(address)) if address.is_unspecified() => {
            at_host(endpoint, &Ipv4Addr::LOCALHOST.to_string())
        }
        Ok(IpAddr::V6(address)) if address.is_unspecified() => {
            at_host(endpoint, &format!("[{}]", Ipv6Addr::LOCALHOST))
        }
        _ => endpoint.to_owned(),
    }
}

#[cfg(test)]
#[path = "other_fusion_tests.rs"]
mod tests;
