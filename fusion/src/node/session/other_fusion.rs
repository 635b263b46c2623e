//! Another fusion of the same venue: edges would follow whichever they happen to reach. Where edges look for fusion, this
//! looks for one, too: before this node listens itself, live again once it does, and for as long as it works.
//!
//! Whoever answers is known by its liveliness token, which goes with its session; one that was killed holds nobody up for
//! longer than [`farfield_proto::transport::LEASE`]. What it says of itself it says in its status.

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

use super::mode::RunMode;

/// How long another may take to answer: some round trips of a far link. A fusion that starts waits for so long where its
/// venue names endpoints of other machines, and live again once it listens.
const LOOK: Duration = Duration::from_secs(2);
/// How long one that answers may take to say more of itself: live it says it once a second.
const INTRODUCTION: Duration = Duration::from_millis(1500);
/// How often it is said that this one waits.
const REMIND_EVERY: Duration = Duration::from_secs(10);
/// Messages that wait between Zenoh and the task.
const QUEUE: usize = 16;

/// What is known of another fusion of the venue.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(in crate::node) struct OtherFusion {
    release: String,
    session: Option<SessionId>,
    tick: Option<Tick>,
    is_live: bool,
    /// The viewpoints that it hears.
    edges: Vec<String>,
    /// Its session among all of Zenoh's.
    id: Option<ZenohId>,
    /// Whether it has said anything of itself, be it that this node cannot read it.
    is_at_work: bool,
}

impl OtherFusion {
    /// One of which nothing is known but that it is there.
    fn unknown(id: Option<ZenohId>) -> Self {
        Self {
            id,
            ..Self::default()
        }
    }

    /// What it says of itself in `status`.
    fn introduced(&self, status: &Status) -> Self {
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

    /// Whether it goes on, and this node, whose session is `own`, leaves the edges to it: it is at work, or of two that
    /// have just begun to listen the one that both take for the first.
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
            facts.push(format!("heard by it: {}", self.edges.join(", ")));
        }
        f.write_str(&facts.join(", "))
    }
}

/// How long ago a session began, in words: it is named after that instant.
fn age(session: SessionId) -> Option<String> {
    let began_s = i64::try_from((session.0 & !(1 << 63)) / 1_000_000_000).ok()?;
    let s = clock::unix_s().checked_sub(began_s)?;
    match s {
        0..120 => Some(format!("begun {s} s ago")),
        120..7200 => Some(format!("begun {} min ago", s / 60)),
        7200..31_536_000 => Some(format!("begun {} h ago", s / 3600)),
        // One of the clocks is wrong, or it is no instant.
        _ => None,
    }
}

/// How a fusion came to be the only one of its venue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::node) enum Place {
    /// There was none.
    Free,
    /// Another has gone: what it had open may still be closing.
    Inherited,
}

/// Those that answer now, by endpoint.
type Answering = BTreeMap<String, OtherFusion>;

/// Who looks, at every endpoint where another fusion may be.
#[derive(Debug, Clone)]
pub(in crate::node) struct OtherFusionWatch {
    venue: String,
    endpoints: Vec<String>,
    answering: watch::Receiver<Answering>,
    /// This node's own session, once it is open: it may be what answers.
    own: Arc<watch::Sender<Option<ZenohId>>>,
}

/// One look at one endpoint.
struct Look {
    venue: String,
    endpoint: String,
    identity: Option<Identity>,
    found: Arc<watch::Sender<Answering>>,
    own: Arc<watch::Sender<Option<ZenohId>>>,
}

impl OtherFusionWatch {
    /// Looks where the edges of `venue` do, but not where only this node itself can be once it listens as `reach` says.
    pub(in crate::node) async fn start(
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

    /// Looks at the endpoints where this node cannot listen because somebody does.
    pub(in crate::node) fn at_taken(
        venue: &Venue,
        reach: &Reach,
        tasks: &TaskTracker,
        leave: &CancellationToken,
    ) -> Self {
        let endpoints = reach.endpoints.iter().map(|endpoint| reachable(endpoint));
        Self::at(&venue.name, endpoints.collect(), reach, tasks, leave)
    }

    /// Looks nowhere: whoever started this node has told its edges where it is.
    pub(in crate::node) fn nowhere() -> Self {
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
        let (found, answering) = watch::channel(Answering::new());
        let (found, own) = (Arc::new(found), Arc::new(watch::Sender::new(None)));
        for endpoint in &endpoints {
            let look = Look {
                venue: venue.to_owned(),
                endpoint: endpoint.clone(),
                identity: reach.identity.clone(),
                found: Arc::clone(&found),
                own: Arc::clone(&own),
            };
            tasks.spawn(look.run(leave.clone()));
        }
        Self {
            venue: venue.to_owned(),
            endpoints,
            answering,
            own,
        }
    }

    /// This node's own session is open, and has not said yet whose it is: it is none other.
    pub(in crate::node) fn know_own(&self, own: ZenohId) {
        self.own.send_replace(Some(own));
    }

    /// The first that answers within [`LOOK`], with what it says of itself.
    pub(in crate::node) async fn first(&self) -> Option<String> {
        if self.endpoints.is_empty() {
            return None;
        }
        let mut answering = self.answering.clone();
        let until = Instant::now() + LOOK;
        let found = timeout_at(until, answering.wait_for(|all| !all.is_empty())).await;
        drop(found.ok()?.ok()?);
        let introduced = |all: &Answering| all.values().any(|other| other.session.is_some());
        let until = Instant::now() + INTRODUCTION;
        drop(timeout_at(until, answering.wait_for(introduced)).await);
        self.named()
    }

    /// Whether this node, which has just begun to listen, is to leave the edges to another that did so at the same moment:
    /// neither could find the other before. Of two, one goes on.
    pub(in crate::node) async fn is_to_step_back(&self, own: ZenohId) -> bool {
        if self.endpoints.is_empty() {
            return false;
        }
        let before = |all: &Answering| all.values().any(|other| other.comes_before(own));
        let mut answering = self.answering.clone();
        let until = Instant::now() + LOOK;
        let found = timeout_at(until, answering.wait_for(before)).await;
        if matches!(found, Ok(Ok(_))) {
            return true;
        }
        drop(found);
        // Who is still there has yet to step back, or has not found this node and is about to begin.
        let is_decided = |all: &Answering| all.is_empty() || before(all);
        let until = Instant::now() + INTRODUCTION;
        let decided = timeout_at(until, answering.wait_for(is_decided)).await;
        decided.is_ok_and(|all| all.is_ok_and(|all| !all.is_empty()))
    }

    /// All that answer now, with what they say of themselves; `None` when there is none.
    pub(in crate::node) fn named(&self) -> Option<String> {
        let answering = self.answering.borrow();
        let named = answering.iter().map(|(endpoint, other)| match other {
            other if other.to_string().is_empty() => endpoint.clone(),
            other => format!("{endpoint} ({other})"),
        });
        let named: Vec<String> = named.collect();
        (!named.is_empty()).then(|| named.join(" and "))
    }

    /// Lets a run begin: in lock-step there must be no other, live the other is waited for until it has gone. `None` when
    /// told to `stop` before.
    ///
    /// # Errors
    /// [`NodeError::Refused`], naming the other.
    pub(in crate::node) async fn be_the_only_one(
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
                "a fusion of venue {venue} is there already: {other}; end it first, or give the venue file of this run another `name`, or another `[fusion] connect`"
            )));
        }
        let mut answering = self.answering.clone();
        let mut reminders = interval(REMIND_EVERY);
        reminders.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                () = stop.cancelled() => return Ok(None),
                gone = answering.wait_for(Answering::is_empty) => {
                    drop(gone);
                    say(format_args!("the other fusion of venue {venue} has gone: this one takes its place"));
                    return Ok(Some(Place::Inherited));
                }
                _ = reminders.tick() => {
                    let other = self.named().unwrap_or_else(|| other.clone());
                    say(format_args!(
                        "a fusion of venue {venue} is there already: {other}; this one waits until it has gone: end one of the two"
                    ));
                }
            }
        }
    }
}

impl Look {
    /// For as long as nobody calls it off: the session finds whoever comes, and whoever comes again.
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
                debug!(endpoint = self.endpoint, %error, "another fusion is not looked for there");
                return;
            }
            None => return,
        };
        if let Some(Err(error)) = leave.run_until_cancelled(self.listen(&session)).await {
            debug!(endpoint = self.endpoint, %error, "another fusion is not looked for any more");
        }
        self.note(None);
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
                        // It may be this node that answers: under another name, or by a way around.
                        if id.is_none() || *self.own.borrow() != id {
                            self.note(Some(OtherFusion::unknown(id)));
                        }
                    }
                    SampleKind::Delete => self.note(None),
                },
                status = statuses.recv_async() => {
                    let bytes = status.map_err(session::zenoh_error)?;
                    let status = wire::decode::<Status>(&bytes.payload().to_bytes());
                    self.introduce(status.ok().as_ref());
                }
            }
        }
    }

    fn note(&self, other: Option<OtherFusion>) {
        self.found.send_if_modified(|all| match other {
            Some(other) => all.insert(self.endpoint.clone(), other).is_none(),
            None => all.remove(&self.endpoint).is_some(),
        });
    }

    /// What somebody who is there says of itself, `None` where it cannot be read; without its token nobody is.
    fn introduce(&self, status: Option<&Status>) {
        self.found.send_if_modified(|all| {
            let known = all.get_mut(&self.endpoint);
            known.is_some_and(|known| {
                let introduced = match status {
                    Some(status) => known.introduced(status),
                    None => OtherFusion {
                        is_at_work: true,
                        ..known.clone()
                    },
                };
                std::mem::replace(known, introduced) != *known
            })
        });
    }
}

/// Whether nobody but this node can be at `endpoint` once it listens at `listen`: the port of an address of this machine.
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
    let resolved = tokio::time::timeout(LOOK, tokio::net::lookup_host((host(endpoint), wanted)));
    let Ok(Ok(mut addresses)) = resolved.await else {
        return false;
    };
    addresses.any(|address| is_of_this_machine(address.ip()))
}

/// Only an address of this machine can be bound.
fn is_of_this_machine(address: IpAddr) -> bool {
    UdpSocket::bind(SocketAddr::new(address, 0)).is_ok()
}

/// Where somebody answers who listens at `endpoint` of this machine.
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
