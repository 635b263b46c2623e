//! A fusion node from its arguments to its exit code.

use std::io;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use farfield_fusion::pipeline::Pipeline;
use farfield_node::clock;
use farfield_node::log::start_log_with;
use farfield_node::process::{
    Ending, LineKind, Managed, NodeError, exit_code, say, say_as, stop_on_signal,
    write_lines_for_parent,
};
use farfield_node::{runtime, service_manager, session};
use farfield_proto::id::SessionId;
use farfield_proto::transport::FUSION;
use tokio::time::{sleep, timeout};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::{Instrument as _, debug, error_span, warn};
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
use super::session::messages::RunMode;
use super::session::other_fusion::{OtherFusionWatch, Place};
use super::session::wiretap::{Wiretap, WiretapHandle};

/// Time for the tasks to end.
const DRAIN: Duration = Duration::from_secs(5);

/// Attempts to listen on an endpoint that another fusion of the venue may just have left, and their interval.
const LISTEN_ATTEMPTS: u32 = 20;
const LISTEN_RETRY: Duration = Duration::from_millis(250);

/// Time before an unneeded session is closed, so that connecting nodes have finished. If Zenoh closes a session while a peer
/// opens one with it, the peer's link stays open, with its socket, until the process ends. Two fusions started together find
/// each other within a millisecond.
const SETTLE: Duration = Duration::from_millis(500);

/// Runs a fusion node to its end, and prints errors on standard error.
pub fn main(args: FusionArgs) -> ExitCode {
    main_with(args, Box::new(NoListeners))
}

/// As [`main`]; the observers that `listeners` opens get copies of all messages.
pub fn main_with(args: FusionArgs, listeners: Box<dyn OpenListeners>) -> ExitCode {
    start_log_with(authentication_log::layer());
    if args.lines_for_parent {
        write_lines_for_parent();
    }
    exit_code(load_and_run(args, listeners))
}

fn load_and_run(args: FusionArgs, listeners: Box<dyn OpenListeners>) -> Result<Ending, NodeError> {
    let config = FusionConfig::load(args)?;
    listeners.check(config.reach.identity.as_ref())?;
    if let Some(identity) = &config.reach.identity {
        authentication_log::set_generations(&identity.generations);
    }
    let session = new_session();
    let mut pipeline = Pipeline::new(&config.venue, config.card.as_ref(), session);
    pipeline.know(config.subjects.subjects.clone());
    let span = error_span!("fusion", venue = config.venue.name);
    let work = run(&config, session, pipeline, listeners).instrument(span);
    let ending = runtime::block_on(2, work);
    authentication_log::sum_up();
    ending
}

/// A unique number. Its top bit is set so that its encoded length is constant: equal runs send equal numbers of bytes.
fn new_session() -> SessionId {
    SessionId(clock::unix_time().as_nanos() as u64 | 1 << 63)
}

async fn run(
    config: &FusionConfig,
    session: SessionId,
    pipeline: Pipeline,
    listeners: Box<dyn OpenListeners>,
) -> Result<Ending, NodeError> {
    // `stop` ends the run; `leave` ends the tasks that carry messages, after the last message.
    let tasks = TaskTracker::new();
    let (stop, leave) = (CancellationToken::new(), CancellationToken::new());
    stop_on_signal(&tasks, &stop, config.managed)
        .context("listening for signals")
        .map_err(NodeError::Failed)?;
    let others = watch_for_other_fusion(config, &tasks, &leave).await;
    let Some(place) = others.wait_until_alone(config.mode, &stop).await? else {
        return Ok(Ending::Interrupted);
    };
    let claim = claim_folder(config)?;
    let mut reporter = Reporter::new(config.managed, config.detail);
    let Some((mut link, senders)) = listen_alone(config, &others, place, &stop).await? else {
        return Ok(Ending::Interrupted);
    };
    hand_out(config, &link, &tasks, &leave);
    reporter.listening(&config.reach.endpoints, link.locators().await);
    let out = claim.folder();
    let on_demand = on_demand(config, session, &pipeline, out);
    let recordings = on_demand.as_ref();
    let opening = open_listeners(config, &pipeline, out, recordings, listeners, &reporter);
    let listeners = opening.await?;
    let on_demand = on_demand.filter(|_| listeners.has_viewers);
    let recording = record(config, session, &pipeline, out)?;
    let wiretap = wiretaps(recording.as_ref(), on_demand.as_ref(), listeners.wiretaps);
    accept_thumbnails(config, &wiretap, &mut link, &senders).await?;
    let interceptor = Interceptor::new(&config.venue, senders, wiretap);
    let mut summary = SummaryFile::in_folder(out);
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
                out,
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
                out,
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

/// Subscribes to thumbnails if they are allowed and an observer wants them.
async fn accept_thumbnails(
    config: &FusionConfig,
    wiretap: &WiretapHandle,
    link: &mut FusionSession,
    senders: &Senders,
) -> Result<(), NodeError> {
    if !(wiretap.wants_thumbnails() && config.allows_thumbnails()) {
        return Ok(());
    }
    let subscribed = link.accept_thumbnails(&config.venue, senders).await;
    subscribed.map_err(NodeError::Failed)
}

/// Starts the task that serves the venue's files to the edges until `leave`.
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

/// Opens the observers, before a refusal could leave a recording behind.
async fn open_listeners(
    config: &FusionConfig,
    pipeline: &Pipeline,
    out: &Path,
    recordings: Option<&Arc<RecordingsOnDemand>>,
    listeners: Box<dyn OpenListeners>,
    reporter: &Reporter,
) -> Result<Listeners, NodeError> {
    // Under a parent all nodes end together, and neither ids nor names are kept.
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
    reporter.notices(&opened.notices);
    Ok(opened)
}

/// All receivers of copies: the recorder, recordings on demand, and `listeners`, which are notified of recordings.
fn wiretaps(
    recording: Option<&RecordingThread>,
    on_demand: Option<&Arc<RecordingsOnDemand>>,
    listeners: Vec<Arc<dyn Wiretap>>,
) -> WiretapHandle {
    if let Some(on_demand) = on_demand {
        if let Some(recording) = recording {
            on_demand.set_run_recording(recording);
        }
        // From here on recordings may begin.
        on_demand.set_listeners(&listeners);
    }
    let recorder = recording.map(RecordingThread::wiretap);
    let on_demand = on_demand.map(|it| Arc::clone(it) as Arc<dyn Wiretap>);
    let wiretap = WiretapHandle::new(recorder.into_iter().chain(on_demand).chain(listeners));
    if let Some(recording) = recording {
        wiretap.recording_begins(recording.file());
    }
    wiretap
}

/// The recordings on demand of a live run, in `folder`.
fn on_demand(
    config: &FusionConfig,
    session: SessionId,
    pipeline: &Pipeline,
    folder: &Path,
) -> Option<Arc<RecordingsOnDemand>> {
    let is_live = config.mode == RunMode::Live;
    is_live.then(|| {
        let keypoints = pipeline.keypoints();
        let folder = folder.to_owned();
        let subjects = &config.subjects;
        let recordings = RecordingsOnDemand::of_run(
            &config.venue,
            &config.venue_path,
            keypoints,
            session,
            folder,
            subjects,
        );
        Arc::new(recordings)
    })
}

/// Ends the current recording on demand, and prints its path.
async fn end_on_demand(on_demand: Arc<RecordingsOnDemand>) {
    match tokio::task::spawn_blocking(move || on_demand.end()).await {
        Ok(None) => {}
        Ok(Some(last)) => match last.failure {
            None => say(format_args!("recorded in {}", last.file.display())),
            Some(failure) => say_as(LineKind::Error, format_args!("{failure}")),
        },
        Err(error) => warn!(%error, "waiting for the recorder"),
    }
}

/// Finishes the recording, then the summary, which contains its result.
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

/// Watches for another fusion of the venue. Not under a parent, which has given its edges the endpoint of this one.
async fn watch_for_other_fusion(
    config: &FusionConfig,
    tasks: &TaskTracker,
    leave: &CancellationToken,
) -> OtherFusionWatch {
    match config.managed {
        Managed::Yes => OtherFusionWatch::nowhere(),
        Managed::No => OtherFusionWatch::start(&config.venue, &config.reach, tasks, leave).await,
    }
}

/// Listens, unless another fusion began to listen at the same moment; then this one waits for it to end. `None` if stopped
/// before. The venue's clock starts after the wait, because the machine's clock may be set meanwhile, as after a power cut.
///
/// # Errors
/// As [`open_link`] and [`OtherFusionWatch::wait_until_alone`].
async fn listen_alone(
    config: &FusionConfig,
    others: &OtherFusionWatch,
    mut place: Place,
    stop: &CancellationToken,
) -> Result<Option<(FusionSession, Senders)>, NodeError> {
    loop {
        let senders = Senders::new(&config.venue, clock::VenueClock::start());
        let link = open_link(config, &senders, others, place).await?;
        let steps_back = match config.mode {
            RunMode::LockStep => Some(false),
            RunMode::Live => {
                let decided = others.must_step_back(link.zenoh_id());
                stop.run_until_cancelled(decided).await
            }
        };
        if steps_back == Some(false) {
            return Ok(Some((link, senders)));
        }
        sleep(SETTLE).await;
        link.close_unused().await;
        if steps_back.is_none() || others.wait_until_alone(config.mode, stop).await?.is_none() {
            return Ok(None);
        }
        // The endpoint that this node closed may still be closing.
        place = Place::Inherited;
    }
}

/// Listens, and registers the own session with `others`.
///
/// # Errors
/// An error of Zenoh; if the endpoint is taken, with the node that has it.
async fn open_link(
    config: &FusionConfig,
    senders: &Senders,
    others: &OtherFusionWatch,
    place: Place,
) -> Result<FusionSession, NodeError> {
    let mut attempts = match place {
        Place::Free => 1,
        Place::Inherited => LISTEN_ATTEMPTS,
    };
    loop {
        attempts -= 1;
        match listen(config).await {
            Ok(session) => {
                // Before the token is declared: a watch over an indirect route would take it for that of another fusion.
                others.set_own(session.zid());
                let link = FusionSession::open(session, &config.venue, config.mode, senders).await;
                return link.map_err(NodeError::Failed);
            }
            // A killed process closes its sockets one after the other.
            Err(error) if attempts > 0 && session::is_taken(&error) => sleep(LISTEN_RETRY).await,
            Err(error) => return Err(NodeError::Failed(with_holder(config, error).await)),
        }
    }
}

/// Listens on the requested endpoint, or on the fallback if that one is taken.
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

/// Adds to the error the other fusion that has the endpoint, if there is one.
async fn with_holder(config: &FusionConfig, error: anyhow::Error) -> anyhow::Error {
    if !session::is_taken(&error) {
        return error;
    }
    let (tasks, leave) = (TaskTracker::new(), CancellationToken::new());
    let others = OtherFusionWatch::at_taken(&config.venue, &config.reach, &tasks, &leave);
    let other = others.first().await;
    leave.cancel();
    match other {
        Some(other) => error.context(format!(
            "a fusion of venue {} is already running: {other}; stop it, or use another endpoint here (--listen)",
            config.venue.name
        )),
        None => error,
    }
}

/// The folder of the results: claimed by the parent or by this process.
fn claim_folder(config: &FusionConfig) -> Result<FolderClaim, NodeError> {
    match (&config.out, config.managed) {
        (Some(out), Managed::Yes) => Ok(FolderClaim::of_parent(out.clone())),
        (out, _) => FolderClaim::take(out.as_deref(), &config.venue.name).map_err(not_made),
    }
}

/// Classifies an error of creating a file or folder: a full disk may have room at the next start; other causes must be fixed.
pub(super) fn not_made(error: anyhow::Error) -> NodeError {
    let kind = error.downcast_ref::<io::Error>().map(io::Error::kind);
    match kind {
        Some(io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded) => NodeError::Failed(error),
        _ => NodeError::Refused(error),
    }
}

/// Begins the recording, if requested, of a run with its results in `folder`.
fn record(
    config: &FusionConfig,
    session: SessionId,
    pipeline: &Pipeline,
    folder: &Path,
) -> Result<Option<RecordingThread>, NodeError> {
    let Some(place) = &config.record else {
        return Ok(None);
    };
    let venue = &config.venue;
    let head = head(
        venue,
        &config.venue_path,
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
    async fn a_taken_endpoint_is_replaced_by_the_fallback() {
        let holder = TcpListener::bind("127.0.0.1:0").unwrap();
        let taken = format!("tcp/{}", holder.local_addr().unwrap());
        let reach = |endpoint: &str| Reach {
            endpoints: vec![endpoint.to_owned()],
            identity: None,
            validity: None,
        };
        let config = FusionConfig {
            reach: reach(&taken),
            ..FusionConfig::with_venue(venue())
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
    fn a_full_disk_is_a_failure_and_other_causes_are_wrong_input() {
        let classify = |kind: io::ErrorKind| {
            let error = anyhow::Error::new(io::Error::from(kind)).context("making out/run.lock");
            not_made(error)
        };
        assert!(matches!(
            classify(io::ErrorKind::StorageFull),
            NodeError::Failed(_)
        ));
        for kind in [io::ErrorKind::ReadOnlyFilesystem, io::ErrorKind::NotFound] {
            assert!(matches!(classify(kind), NodeError::Refused(_)), "{kind}");
        }
        let taken = anyhow::anyhow!("output folder out is not empty");
        assert!(matches!(not_made(taken), NodeError::Refused(_)));
    }
}
