//! `farfield status`: joins a running venue as somebody who only listens, and shows for every node how it is, as a table
//! that pipes, or JSON.

mod listen;
mod state;
mod table;

use std::io::{IsTerminal as _, stdout};
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use clap::Args;
use farfield_node::endpoints::{Asked, LinkEnd, Reach};
use farfield_node::files::load_venue;
use farfield_node::process::{Ending, Managed, NodeError, stop_when_told};
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

/// How long fusion may take to answer: some tries, over a far link.
const ANSWER: Duration = Duration::from_secs(6);
/// How long statuses are listened for: every node says one a second, and two make a rate.
const LISTEN: Duration = Duration::from_millis(2300);
/// How long tokens of nodes that are there may take to come.
const SETTLED: Duration = Duration::from_millis(400);
/// How often a table that is watched is drawn.
const DRAW_EVERY: Duration = Duration::from_secs(1);

/// Arguments of `farfield status`.
#[derive(Debug, Args)]
pub(crate) struct StatusArgs {
    /// The venue file.
    pub(crate) venue: PathBuf,
    /// Where fusion listens, for example `quic/10.0.0.1:7447`; the venue file's, if left out.
    #[arg(long, value_name = "ENDPOINT")]
    pub(crate) connect: Vec<String>,
    /// Talk to other machines without TLS: everyone in the network may read along.
    #[arg(long)]
    pub(crate) allow_plaintext: bool,
    /// Folder of the keys; the venue file's, if left out.
    #[arg(long, value_name = "DIR")]
    pub(crate) certificates: Option<PathBuf>,
    /// Whose keys are used: the recorder's or a reader's.
    #[arg(long, value_name = "NAME", default_value = RECORDER)]
    pub(crate) node: String,
    /// Go on, and draw the table anew every second.
    #[arg(long)]
    pub(crate) watch: bool,
    /// Print JSON, one object a line.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Shows how the nodes of a venue are.
///
/// # Errors
/// [`NodeError::Refused`] where venue file, keys or endpoints are wrong; [`NodeError::Failed`] when nobody answers, or some
/// node needs attention.
pub(crate) fn status(args: &StatusArgs) -> Result<Ending, NodeError> {
    log::start_log();
    let venue = load_venue(&args.venue).map_err(NodeError::refused)?;
    let asked = Asked {
        side: LinkEnd::Connect,
        node: &args.node,
        endpoints: &args.connect,
        certificates: args.certificates.as_deref(),
        allow_plaintext: args.allow_plaintext,
    };
    let reach = asked.in_venue(&venue)?;
    runtime::block_on(2, show(args, &venue, &reach))
}

async fn show(args: &StatusArgs, venue: &Venue, reach: &Reach) -> Result<Ending, NodeError> {
    let (tasks, stop) = (TaskTracker::new(), CancellationToken::new());
    stop_when_told(&tasks, &stop, Managed::No)
        .context("listening for signals")
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
    let (session, listener) = joined.ok_or_else(|| NodeError::Failed(nobody(venue, reach)))?;
    sleep(LISTEN).await;
    let state = || VenueState::new(venue, &listener.heard(), clock::unix_s());
    if args.watch {
        let mut draws = interval(DRAW_EVERY);
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
    if state.nodes.iter().all(|node| !node.is_heard) {
        return Err(NodeError::Failed(silent(venue, reach)));
    }
    draw(args, &state).map_err(NodeError::Failed)?;
    session::close(&session).await;
    match state.attention() {
        None => Ok(Ending::Done),
        Some(why) => Err(NodeError::Failed(anyhow!("{why}"))),
    }
}

/// A session with fusion, and what is heard on it; `None` when nobody answers in time.
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

/// A node in short.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct NodeInShort {
    /// Its name: `fusion`, or a viewpoint's.
    pub(crate) name: String,
    /// Which farfield it runs; empty where it does not say.
    pub(crate) version: String,
    /// Why somebody must look after it.
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

/// The nodes of `venue` as they say that they are, for whoever asks at `connect`, or where the venue file says; `None` when
/// nobody answers within `answer`.
///
/// # Errors
/// [`NodeError::Refused`] where keys or endpoints are wrong, [`NodeError::Failed`] with what Zenoh says.
pub(crate) fn join_for_a_moment(
    venue: &Venue,
    connect: &[String],
    answer: Duration,
) -> Result<Option<Vec<NodeInShort>>, NodeError> {
    let asked = Asked {
        side: LinkEnd::Connect,
        node: RECORDER,
        endpoints: connect,
        certificates: None,
        allow_plaintext: false,
    };
    let reach = asked.in_venue(venue)?;
    runtime::block_on(2, async {
        let Some((session, listener)) = join(venue, &reach, answer).await? else {
            return Ok(None);
        };
        // Every node says once a second how it is; a far link takes its time.
        let until = Instant::now() + LISTEN;
        sleep(SETTLED).await;
        while !listener.heard().is_complete() && Instant::now() < until {
            sleep(SETTLED / 4).await;
        }
        let state = VenueState::new(venue, &listener.heard(), clock::unix_s());
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
    // What is piped is read by programs: all of it, however long.
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

/// What was tried, and what to look at.
fn nobody(venue: &Venue, reach: &Reach) -> anyhow::Error {
    let keys = if reach.identity.is_some() {
        ", whether this machine's clock and its certificates are those of the venue"
    } else {
        ""
    };
    anyhow!(
        "nobody answers for venue {}: tried {} for {} s; look whether fusion runs, whether it listens there (`[fusion] connect` of the venue file, or --connect; fusion and `farfield run --live` say where when they begin), whether the way is open (a firewall, UDP for quic/){keys}",
        venue.name,
        reach.endpoints.join(", "),
        ANSWER.as_secs()
    )
}

fn silent(venue: &Venue, reach: &Reach) -> anyhow::Error {
    let why = if reach.identity.is_some() {
        "fusion may refuse this certificate (it says so itself, with the reason)"
    } else {
        "it may be the fusion of a venue of another name"
    };
    anyhow!(
        "somebody answers at {}, but no node of venue {} was heard in {:.1} s: {why}; in lock-step nothing is said once the run goes on",
        reach.endpoints.join(", "),
        venue.name,
        LISTEN.as_secs_f64()
    )
}
