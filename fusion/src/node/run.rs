//! A fusion node from its arguments to its exit code.

use std::io;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use farfield_node::clock;
use farfield_node::log::start_log_with;
use farfield_node::process::{Ending, Managed, NodeError, exit_code, say, stop_when_told};
use farfield_node::{runtime, service_manager, session};
use farfield_proto::id::SessionId;
use farfield_proto::transport::FUSION;
use tokio::time::{sleep, timeout};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::{debug, warn};
use zenoh::Session;

use super::config::{FusionArgs, FusionConfig};
use super::handout;
use super::listeners::{Listeners, NoListeners, OpenListeners, RunAtItsStart};
use super::live::{LiveContext, live, names_place};
use super::lock_step::{Begin, Outside};
use super::output::claim::FolderClaim;
use super::output::progress::Reporter;
use super::output::summary_file::SummaryFile;
use super::recording::{RecordingFile, RecordingThread, RecordingsOnDemand, head};
use super::session::authentication_log;
use super::session::interceptor::{Interceptor, Senders};
use super::session::link::FusionSession;
use super::session::mode::RunMode;
use super::session::other_fusion::{OtherFusionWatch, Place};
use super::session::wiretap::{Wiretap, WiretapHandle};
use crate::pipeline::Pipeline;

/// How long the tasks may take to end.
const DRAIN: Duration = Duration::from_secs(5);

/// How often a place to listen at is tried that another fusion of the venue may just have left, and how long after a try.
const TRIES: u32 = 20;
const TRY_AGAIN: Duration = Duration::from_millis(250);

/// How long a session stays open that is not needed, so that nodes that are just connecting have done so: where Zenoh closes
/// a session while a peer opens one with it, that peer's link stays, and with it the socket, until the process ends. Two
/// fusions that are started at the same moment find each other within the same millisecond.
const SETTLE: Duration = Duration::from_millis(500);

/// Runs a fusion node to its end and says on standard error what went wrong.
pub fn main(args: FusionArgs) -> ExitCode {
    main_with(args, Box::new(NoListeners))
}

/// As [`main`]; whom `listeners` opens gets a copy of every message.
pub fn main_with(args: FusionArgs, listeners: Box<dyn OpenListeners>) -> ExitCode {
    start_log_with(authentication_log::layer());
    exit_code(load_and_run(args, listeners))
}

fn load_and_run(args: FusionArgs, listeners: Box<dyn OpenListeners>) -> Result<Ending, NodeError> {
    let config = FusionConfig::load(args)?;
    listeners.check(config.reach.identity.as_ref())?;
    if let Some(identity) = &config.reach.identity {
        authentication_log::know_generations(&identity.generations);
    }
    let session = new_session();
    let mut pipeline = Pipeline::new(&config.venue, config.card.as_ref(), session);
    pipeline.know(config.subjects.subjects.clone());
    let ending = runtime::block_on(2, run(&config, session, pipeline, listeners));
    authentication_log::sum_up();
    ending
}

/// A number that no earlier life of fusion had. Its top bit is set, so that it takes the same bytes
/// on the wire in every run: equal runs send equal numbers of bytes.
fn new_session() -> SessionId {
    SessionId(clock::unix_time().as_nanos() as u64 | 1 << 63)
}

async fn run(
    config: &FusionConfig,
    session: SessionId,
    pipeline: Pipeline,
    listeners: Box<dyn OpenListeners>,
) -> Result<Ending, NodeError> {
    // `stop` asks the run to end; `leave` ends the tasks that carry messages, once all is said.
    let tasks = TaskTracker::new();
    let (stop, leave) = (CancellationToken::new(), CancellationToken::new());
    stop_when_told(&tasks, &stop, config.managed)
        .context("listening for signals")
        .map_err(NodeError::Failed)?;
    let others = look_for_another(config, &tasks, &leave).await;
    let Some(place) = others.be_the_only_one(config.mode, &stop).await? else {
        return Ok(Ending::Interrupted);
    };
    let claim = claim_folder(config)?;
    let mut reporter = Reporter::new(config.managed, config.detail);
    let Some((mut link, senders)) = listen_alone(config, (&others, place), &stop).await? else {
        return Ok(Ending::Interrupted);
    };
    hand_out(config, &link, &tasks, &leave);
    reporter.listening(&config.reach.endpoints, link.locators().await);
    let on_demand = on_demand(config, session, (&pipeline, claim.folder()));
    let run = (&pipeline, claim.folder(), on_demand.as_ref());
    let listeners = open_listeners(config, run, listeners, &reporter).await?;
    let on_demand = on_demand.filter(|_| listeners.is_looked_at);
    let recording = record(config, session, (&pipeline, claim.folder()))?;
    let wiretap = wiretaps(recording.as_ref(), on_demand.as_ref(), listeners.wiretaps);
    show_thumbnails(config, &wiretap, (&mut link, &senders)).await?;
    let interceptor = Interceptor::new(&config.venue, senders, wiretap);
    let mut summary = SummaryFile::in_folder(claim.folder());
    let mut ends = link.spawn(&tasks, &leave, &interceptor);
    let outcome = match config.mode {
        RunMode::LockStep => {
            let mut outside = Outside {
                ends: &mut ends,
                reporter: &mut reporter,
                stop: &stop,
            };
            let mut run = Begin {
                config,
                session,
                out: claim.folder(),
                summary: &mut summary,
                interceptor: &interceptor,
                recording: recording.as_ref(),
            };
            Box::pin(run.lock_step(pipeline, &mut outside)).await
        }
        RunMode::Live => {
            if let Some(recording) = &recording {
                let fillers = recording.fillers(&interceptor.clock);
                fillers.spawn(&ends.session(), &config.venue, &tasks, &leave);
            }
            let context = LiveContext {
                config,
                session,
                out: claim.folder(),
                summary: &mut summary,
                recording: recording.as_ref(),
                on_demand: on_demand.as_deref(),
                interceptor: &interceptor,
                ends: &mut ends,
                reporter: &mut reporter,
                stop: &stop,
                others,
            };
            Box::pin(live(context, pipeline)).await
        }
    };
    service_manager::end_work();
    stop.cancel();
    if timeout(DRAIN, ends.close(&tasks, &leave)).await.is_err() {
        warn!("tasks still running, leaving anyway");
    }
    let closed = close(recording, summary, on_demand).await;
    closed.map_err(NodeError::Failed)?;
    outcome
}

/// Lets edges send thumbnails where they may, and somebody looks at them.
async fn show_thumbnails(
    config: &FusionConfig,
    wiretap: &WiretapHandle,
    (link, senders): (&mut FusionSession, &Senders),
) -> Result<(), NodeError> {
    if !(wiretap.looks_at_thumbnails() && config.takes_pictures()) {
        return Ok(());
    }
    let shown = link.show_thumbnails(&config.venue, senders).await;
    shown.map_err(NodeError::Failed)
}

/// Lets edges fetch what the venue has for them, until they `leave`.
fn hand_out(
    config: &FusionConfig,
    link: &FusionSession,
    tasks: &TaskTracker,
    leave: &CancellationToken,
) {
    let (venue, handout) = (config.venue.name.clone(), Arc::clone(&config.handout));
    tasks.spawn(handout::serve(
        link.session(),
        venue,
        handout,
        leave.clone(),
    ));
}

/// Opens whoever listens beside the recorder; before there is a recording that a refusal would leave behind.
async fn open_listeners(
    config: &FusionConfig,
    (pipeline, out, recordings): (&Pipeline, &Path, Option<&Arc<RecordingsOnDemand>>),
    listeners: Box<dyn OpenListeners>,
    reporter: &Reporter,
) -> Result<Listeners, NodeError> {
    // As people keep their ids: under a parent all nodes end together.
    let names = names_place(&config.venue, out);
    let restarts =
        (config.mode == RunMode::Live && config.managed == Managed::No).then_some(&*names);
    let run = RunAtItsStart {
        venue: &config.venue,
        keypoints: pipeline.keypoints(),
        is_live: config.mode == RunMode::Live,
        identity: config.reach.identity.as_ref(),
        out,
        restarts,
        recordings,
        listens_at: &config.reach.endpoints,
        replays: None,
    };
    let opened = listeners.open(run).await?;
    reporter.said(&opened.said);
    Ok(opened)
}

/// Everybody who gets copies: the recorder, who records on demand, and `listeners`, who are told of recordings.
fn wiretaps(
    recording: Option<&RecordingThread>,
    on_demand: Option<&Arc<RecordingsOnDemand>>,
    listeners: Vec<Arc<dyn Wiretap>>,
) -> WiretapHandle {
    if let Some(on_demand) = on_demand {
        if let Some(recording) = recording {
            on_demand.leave_it_to(recording);
        }
        // From now on somebody may begin one.
        on_demand.tell(&listeners);
    }
    let recorder = recording.map(RecordingThread::wiretap);
    let asked_for = on_demand.map(|it| Arc::clone(it) as Arc<dyn Wiretap>);
    let wiretap = WiretapHandle::new(recorder.into_iter().chain(asked_for).chain(listeners));
    if let Some(recording) = recording {
        wiretap.recording_begins(recording.file());
    }
    wiretap
}

/// What starts and stops recordings of a live run, in `folder`.
fn on_demand(
    config: &FusionConfig,
    session: SessionId,
    (pipeline, folder): (&Pipeline, &Path),
) -> Option<Arc<RecordingsOnDemand>> {
    let venue = (&config.venue, config.venue_path.as_path());
    let is_live = config.mode == RunMode::Live;
    is_live.then(|| {
        let keypoints = pipeline.keypoints();
        let folder = folder.to_owned();
        let subjects = &config.subjects;
        let recordings = RecordingsOnDemand::of_run(venue, keypoints, session, folder, subjects);
        Arc::new(recordings)
    })
}

/// Ends a recording that nobody has ended, and says where it is.
async fn end_on_demand(on_demand: Arc<RecordingsOnDemand>) {
    match tokio::task::spawn_blocking(move || on_demand.end()).await {
        Ok(None) => {}
        Ok(Some(last)) => match last.failure {
            None => say(format_args!("recorded in {}", last.file.display())),
            Some(failure) => say(format_args!("error: {failure}")),
        },
        Err(error) => warn!(%error, "waiting for the recorder"),
    }
}

/// Finishes the recording, and then the summary, which says what it has come to.
async fn close(
    recording: Option<RecordingThread>,
    summary: SummaryFile,
    on_demand: Option<Arc<RecordingsOnDemand>>,
) -> anyhow::Result<()> {
    let recorded = match recording {
        Some(recording) => Some(recording.finish().await?),
        None => None,
    };
    let finished = summary.finish(recorded.as_ref());
    if let Some(on_demand) = on_demand {
        end_on_demand(on_demand).await;
    }
    finished
}

/// Looks whether the venue has another fusion; not under a parent, which has told its edges where this one is.
async fn look_for_another(
    config: &FusionConfig,
    tasks: &TaskTracker,
    leave: &CancellationToken,
) -> OtherFusionWatch {
    match config.managed {
        Managed::Yes => OtherFusionWatch::nowhere(),
        Managed::No => OtherFusionWatch::start(&config.venue, &config.reach, tasks, leave).await,
    }
}

/// Listens, and goes on to do so unless another began to at the same moment; then that one is waited for. `None` when told
/// to `stop` before. The venue's clock starts when this node listens for good: the machine's own may be set right while it
/// waits, as after a power cut.
///
/// # Errors
/// As [`open_link`] and [`OtherFusionWatch::be_the_only_one`].
async fn listen_alone(
    config: &FusionConfig,
    (others, mut place): (&OtherFusionWatch, Place),
    stop: &CancellationToken,
) -> Result<Option<(FusionSession, Senders)>, NodeError> {
    loop {
        let senders = Senders::new(&config.venue, clock::VenueClock::start());
        let link = open_link(config, &senders, (others, place)).await?;
        let steps_back = match config.mode {
            RunMode::LockStep => Some(false),
            RunMode::Live => {
                let looked = others.is_to_step_back(link.zenoh_id());
                stop.run_until_cancelled(looked).await
            }
        };
        if steps_back == Some(false) {
            return Ok(Some((link, senders)));
        }
        sleep(SETTLE).await;
        link.close_unused().await;
        if steps_back.is_none() || others.be_the_only_one(config.mode, stop).await?.is_none() {
            return Ok(None);
        }
        // What this node has closed itself may still be closing.
        place = Place::Inherited;
    }
}

/// Listens, and lets `others` know that this node is none of them.
///
/// # Errors
/// What Zenoh says; where the place is taken, by whom.
async fn open_link(
    config: &FusionConfig,
    senders: &Senders,
    (others, place): (&OtherFusionWatch, Place),
) -> Result<FusionSession, NodeError> {
    let mut tries = match place {
        Place::Free => 1,
        Place::Inherited => TRIES,
    };
    loop {
        tries -= 1;
        match listen(config).await {
            Ok(session) => {
                // Before its token is declared: who looks by a way around would take it for that of another.
                others.know_own(session.zid());
                let link = FusionSession::open(session, &config.venue, config.mode, senders).await;
                return link.map_err(NodeError::Failed);
            }
            // A process that was killed closes one thing after the other.
            Err(error) if tries > 0 && session::is_taken(&error) => sleep(TRY_AGAIN).await,
            Err(error) => return Err(NodeError::Failed(name_who_listens(config, error).await)),
        }
    }
}

/// Listens where it was asked for, or where that is taken, wherever else whoever started this node lets it.
async fn listen(config: &FusionConfig) -> anyhow::Result<Session> {
    let listening = FusionSession::listen(&config.venue, &config.reach).await;
    match (listening, &config.reach_else) {
        (Err(error), Some(reach)) if session::is_taken(&error) => {
            debug!(%error, "listening elsewhere");
            FusionSession::listen(&config.venue, reach).await
        }
        (listening, _) => listening,
    }
}

/// The same error, with who has the place where this node could not listen, if it is another fusion of the venue.
async fn name_who_listens(config: &FusionConfig, error: anyhow::Error) -> anyhow::Error {
    if !session::is_taken(&error) {
        return error;
    }
    let (tasks, leave) = (TaskTracker::new(), CancellationToken::new());
    let others = OtherFusionWatch::at_taken(&config.venue, &config.reach, &tasks, &leave);
    let other = others.first().await;
    leave.cancel();
    match other {
        Some(other) => error.context(format!(
            "a fusion of venue {} is there already: {other}; end it, or let this one listen elsewhere (--listen)",
            config.venue.name
        )),
        None => error,
    }
}

/// The folder of the results: the parent's, or one of its own.
fn claim_folder(config: &FusionConfig) -> Result<FolderClaim, NodeError> {
    match (&config.out, config.managed) {
        (Some(out), Managed::Yes) => Ok(FolderClaim::of_parent(out.clone())),
        (out, _) => FolderClaim::take(out.as_deref(), &config.venue.name).map_err(not_made),
    }
}

/// Why a file or folder cannot be made: a disk without room may have some when the node is started again; all else has to be
/// mended.
pub(super) fn not_made(error: anyhow::Error) -> NodeError {
    let of_system = error.downcast_ref::<io::Error>().map(io::Error::kind);
    match of_system {
        Some(io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded) => NodeError::Failed(error),
        _ => NodeError::Refused(error),
    }
}

/// Begins the recording, if one is wanted, of a run whose results lie in `folder`.
fn record(
    config: &FusionConfig,
    session: SessionId,
    (pipeline, folder): (&Pipeline, &Path),
) -> Result<Option<RecordingThread>, NodeError> {
    let Some(place) = &config.record else {
        return Ok(None);
    };
    let venue = &config.venue;
    let head = head(
        (venue, &config.venue_path),
        pipeline.keypoints(),
        FUSION,
        &config.subjects,
    );
    let head = head.map_err(NodeError::Failed)?;
    let file = RecordingFile::make(&place.path(folder), &venue.name).map_err(not_made)?;
    let parameters = &venue.parameters.recording;
    let started = RecordingThread::start(file, head, session, config.mode, parameters);
    started.map(Some).map_err(NodeError::Failed)
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use farfield_node::endpoints::Reach;

    use super::super::live::tests::venue;
    use super::*;

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn where_the_place_is_taken_another_will_do_if_one_was_named() {
        let holder = TcpListener::bind("127.0.0.1:0").unwrap();
        let taken = format!("tcp/{}", holder.local_addr().unwrap());
        let reach = |endpoint: &str| Reach {
            endpoints: vec![endpoint.to_owned()],
            identity: None,
            validity: None,
        };
        let config = FusionConfig {
            reach: reach(&taken),
            ..FusionConfig::of_venue(venue())
        };
        let refused = listen(&config).await.err();
        assert!(refused.is_some_and(|error| session::is_taken(&error)));
        let config = FusionConfig {
            reach_else: Some(reach("tcp/127.0.0.1:0")),
            ..config
        };
        let session = listen(&config).await.unwrap();
        let locators = session.info().locators().await;
        assert_ne!(locators[0].to_string(), taken);
        session.close().await.unwrap();
    }

    #[test]
    fn a_full_disk_may_have_room_later_and_a_place_that_is_taken_is_wrong_input() {
        let of = |kind: io::ErrorKind| {
            let error = anyhow::Error::new(io::Error::from(kind)).context("making out/run.lock");
            not_made(error)
        };
        assert!(matches!(
            of(io::ErrorKind::StorageFull),
            NodeError::Failed(_)
        ));
        for kind in [io::ErrorKind::ReadOnlyFilesystem, io::ErrorKind::NotFound] {
            assert!(matches!(of(kind), NodeError::Refused(_)), "{kind}");
        }
        let taken = anyhow::anyhow!("output folder out is not empty");
        assert!(matches!(not_made(taken), NodeError::Refused(_)));
    }
}
