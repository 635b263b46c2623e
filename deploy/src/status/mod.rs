//! `farfield status`: joins a running venue as an observer, and shows the state of every node as a table, or as JSON.

mod listen;
mod state;
mod table;

use std::io::{IsTerminal as _, stdout};
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use clap::Args;
use farfield_node::endpoints::{LinkEnd, LinkRequest, Reach};
use farfield_node::files::load_venue;
use farfield_node::process::{Ending, Managed, NodeError, stop_on_signal};
use farfield_node::{clock, log, runtime, session};
use farfield_proto::transport::{EdgeTransport, RECORDER};
use farfield_proto::venue::Venue;
use tokio::time::{Instant, MissedTickBehavior, interval, sleep, timeout};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use zenoh::Session;

use self::listen::Listener;
use self::state::{Mark, NodeState, VenueState};
use crate::output::{self, Reader};

/// Time for fusion to answer: several tries over a slow link.
const ANSWER: Duration = Duration::from_secs(6);
/// Time to receive statuses: every node sends one per second, and two give a rate.
const RECEIVE: Duration = Duration::from_millis(2300);
/// Time for the tokens of connected nodes to arrive.
const SETTLED: Duration = Duration::from_millis(400);
/// Interval of redraws with `--watch`.
const DRAW_INTERVAL: Duration = Duration::from_secs(1);

/// Arguments of `farfield status`.
#[derive(Debug, Args)]
pub(crate) struct StatusArgs {
    /// The venue file.
    pub(crate) venue: PathBuf,
    /// Endpoint of fusion, for example `quic/10.0.0.1:7447`. Default: that of the venue file.
    #[arg(long, value_name = "ENDPOINT")]
    pub(crate) connect: Vec<String>,
    /// Connect to other machines without TLS: everyone in the network can read the data.
    #[arg(long)]
    pub(crate) allow_plaintext: bool,
    /// Folder of the keys. Default: that of the venue file.
    #[arg(long, value_name = "DIR")]
    pub(crate) certificates: Option<PathBuf>,
    /// The node whose keys are used: the recorder or a reader.
    #[arg(long, value_name = "NAME", default_value = RECORDER)]
    pub(crate) node: String,
    /// Redraw the table every second.
    #[arg(long)]
    pub(crate) watch: bool,
    /// Print JSON, one object per line.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Shows the state of the nodes of a venue.
///
/// # Errors
/// [`NodeError::Refused`] where venue file, keys or endpoints are wrong; [`NodeError::Failed`] when no node answers, or
/// a node needs attention.
pub(crate) fn status(args: &StatusArgs) -> Result<Ending, NodeError> {
    log::start_log();
    let venue = load_venue(&args.venue).map_err(NodeError::refused)?;
    let options = LinkRequest {
        side: LinkEnd::Connect,
        node: &args.node,
        endpoints: &args.connect,
        certificates: args.certificates.as_deref(),
        allow_plaintext: args.allow_plaintext,
    };
    let reach = options.in_venue(&venue)?;
    runtime::block_on(2, show(args, &venue, &reach))
}

async fn show(args: &StatusArgs, venue: &Venue, reach: &Reach) -> Result<Ending, NodeError> {
    let (tasks, stop) = (TaskTracker::new(), CancellationToken::new());
    stop_on_signal(&tasks, &stop, Managed::No)
        .context("catching signals")
        .map_err(NodeError::Failed)?;
    let shown = stop
        .run_until_cancelled(join_and_show(args, venue, reach))
        .await;
    stop.cancel();
    shown.unwrap_or(Ok(Ending::Interrupted))
}

async fn join_and_show(
    args: &StatusArgs,
    venue: &Venue,
    reach: &Reach,
) -> Result<Ending, NodeError> {
    let joined = join(venue, reach, ANSWER).await?;
    let (session, listener) = joined.ok_or_else(|| NodeError::Failed(no_answer(venue, reach)))?;
    sleep(RECEIVE).await;
    let state = || VenueState::new(venue, &listener.received(), clock::unix_s());
    if args.watch {
        let mut draws = interval(DRAW_INTERVAL);
        draws.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            draws.tick().await;
            if draw(args, &state()).map_err(NodeError::Failed)? == Reader::Gone {
                session::close(&session).await;
                return Ok(Ending::Done);
            }
        }
    }
    let state = state();
    if state.nodes.iter().all(|node| !node.has_status) {
        return Err(NodeError::Failed(no_status(venue, reach)));
    }
    draw(args, &state).map_err(NodeError::Failed)?;
    session::close(&session).await;
    match state.attention() {
        None => Ok(Ending::Done),
        Some(why) => Err(NodeError::Failed(anyhow!("{why}"))),
    }
}

/// A session with fusion and its listener; `None` if no node answers in time.
async fn join(
    venue: &Venue,
    reach: &Reach,
    answer: Duration,
) -> Result<Option<(Session, Listener)>, NodeError> {
    let transport = EdgeTransport {
        venue: &venue.name,
        connect: &reach.endpoints,
        identity: reach.identity.as_ref(),
    };
    let Ok(session) = timeout(answer, session::connect(&transport)).await else {
        return Ok(None);
    };
    let session = session.map_err(NodeError::Failed)?;
    let listener = Listener::start(&session, venue).await;
    Ok(Some((session, listener.map_err(NodeError::Failed)?)))
}

/// Summary of a node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct NodeInShort {
    /// `fusion`, or the name of a viewpoint.
    pub(crate) name: String,
    /// Its farfield version; empty if unknown.
    pub(crate) version: String,
    /// Why it needs attention.
    pub(crate) trouble: Option<String>,
}

impl From<NodeState> for NodeInShort {
    fn from(state: NodeState) -> Self {
        Self {
            name: state.node,
            version: state.version,
            trouble: (state.mark == Mark::Red).then_some(state.state),
        }
    }
}

/// The nodes of `venue` at `connect`, or at the endpoint of the venue file; `None` if no node answers within `answer`.
///
/// # Errors
/// [`NodeError::Refused`] where keys or endpoints are wrong, [`NodeError::Failed`] for errors of Zenoh.
pub(crate) fn join_for_a_moment(
    venue: &Venue,
    connect: &[String],
    answer: Duration,
) -> Result<Option<Vec<NodeInShort>>, NodeError> {
    let options = LinkRequest {
        side: LinkEnd::Connect,
        node: RECORDER,
        endpoints: connect,
        certificates: None,
        allow_plaintext: false,
    };
    let reach = options.in_venue(venue)?;
    runtime::block_on(2, async {
        let Some((session, listener)) = join(venue, &reach, answer).await? else {
            return Ok(None);
        };
        // Every node sends one status per second, and a slow link delays it.
        let until = Instant::now() + RECEIVE;
        sleep(SETTLED).await;
        while !listener.received().is_complete() && Instant::now() < until {
            sleep(SETTLED / 4).await;
        }
        let state = VenueState::new(venue, &listener.received(), clock::unix_s());
        session::close(&session).await;
        Ok(Some(
            state.nodes.into_iter().map(NodeInShort::from).collect(),
        ))
    })
}

fn draw(args: &StatusArgs, state: &VenueState) -> anyhow::Result<Reader> {
    if args.json {
        let json = serde_json::to_string(state).context("writing the status as JSON")?;
        return output::print_while_read(&(json + "\n"));
    }
    // Programs read piped output, so it is not shortened.
    let table = match output::columns() {
        Some(columns) => table::text_within(state, columns),
        None => table::text(state),
    };
    match (args.watch, stdout().is_terminal()) {
        (false, _) => output::print_while_read(&table),
        (true, true) => output::print_over(&table),
        (true, false) => output::print_while_read(&(table + "\n")),
    }
}

/// The error when no node answers, with what was tried and what to check.
fn no_answer(venue: &Venue, reach: &Reach) -> anyhow::Error {
    let keys = if reach.identity.is_some() {
        ", and that the clock and the certificates of this machine are right"
    } else {
        ""
    };
    anyhow!(
        "no node of venue {} answers: tried {} for {} s; check that fusion runs, that it listens there (`[fusion] connect` of the venue file, or --connect; fusion and `farfield run --live` print the endpoint at their start), that no firewall blocks it (UDP for quic/){keys}",
        venue.name,
        reach.endpoints.join(", "),
        ANSWER.as_secs()
    )
}

fn no_status(venue: &Venue, reach: &Reach) -> anyhow::Error {
    let why = if reach.identity.is_some() {
        "fusion may refuse this certificate (it then prints the reason)"
    } else {
        "the fusion there may belong to another venue"
    };
    anyhow!(
        "a node answers at {}, but no node of venue {} sent a status in {:.1} s: {why}; in lock-step no status is sent during a run",
        reach.endpoints.join(", "),
        venue.name,
        RECEIVE.as_secs_f64()
    )
}
