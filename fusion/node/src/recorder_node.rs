//! `farfield record`: a separate node that subscribes to all keys of the venue and records the messages.
//!
//! It receives what fusion receives, except for losses on the links, and possibly later. The messages used for each tick come
//! from fusion's own decisions ([`farfield_proto::message::decision`]).

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use farfield_node::clock::VenueClock;
use farfield_node::endpoints::{LinkEnd, LinkRequest, Reach};
use farfield_node::files::load_venue;
use farfield_node::log::start_log_with;
use farfield_node::process::{Ending, Managed, NodeError, exit_code, say, stop_on_signal};
use farfield_node::runtime;
use farfield_node::session::{self, zenoh_error};
use farfield_proto::id::SessionId;
use farfield_proto::key::Keys;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::Status;
use farfield_proto::transport::{EdgeTransport, FUSION, RECORDER};
use farfield_proto::venue::same_files::{OtherFile, OwnFiles};
use farfield_proto::venue::{Venue, VenueHash};
use farfield_proto::wire;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use zenoh::Session;
use zenoh::sample::{Sample, SampleKind};

use super::config::{check_names, load_card};
use super::recording::{RecordingFile, RecordingThread, check_place, head};
use super::run::not_made;
use super::session::authentication_log;
use super::session::messages::RunMode;
use super::subjects::{KnownSubjects, load_subjects};

/// Messages queued between Zenoh and the recorder's own queue.
const QUEUE: usize = 1024;
/// The time for which every status of fusion must report other files before the recorder accepts it, microseconds: several
/// statuses.
const DIFFERS_US: i64 = 5_000_000;
/// Interval of progress reports.
const REPORT_EVERY: Duration = Duration::from_secs(5);

/// Reports between two reminders of a full disk.
const REMIND_EVERY: u32 = 12;

/// Arguments of the recording node.
#[derive(Debug, Clone, clap::Args)]
pub struct RecordArgs {
    /// The venue file.
    pub venue: PathBuf,
    /// Endpoint of fusion [default: the venue file's].
    ///
    /// For example `quic/10.0.0.1:7447`.
    #[arg(long, value_name = "ENDPOINT")]
    pub connect: Vec<String>,
    /// Communicate with other machines without TLS.
    ///
    /// Every machine in the network can then read and send messages.
    #[arg(long)]
    pub allow_plaintext: bool,
    /// Folder of the recorder's keys [default: the venue file's].
    #[arg(long, value_name = "DIR")]
    pub certificates: Option<PathBuf>,
    /// The recording: a new file, or a folder for one.
    ///
    /// A path with a slash at its end creates the folder.
    #[arg(long, value_name = "FILE.mcap")]
    pub out: PathBuf,
}

/// Records until it is stopped, and prints errors on standard error.
pub fn main(args: RecordArgs) -> ExitCode {
    start_log_with(authentication_log::layer());
    exit_code(load_and_record(args))
}

fn load_and_record(args: RecordArgs) -> Result<Ending, NodeError> {
    let venue = load_venue(&args.venue).map_err(NodeError::refused)?;
    check_names(&venue).map_err(NodeError::Refused)?;
    check_place(&args.out).map_err(NodeError::Refused)?;
    let request = LinkRequest {
        side: LinkEnd::Connect,
        node: RECORDER,
        endpoints: &args.connect,
        certificates: args.certificates.as_deref(),
        allow_plaintext: args.allow_plaintext,
    };
    let reach = request.in_venue(&venue)?;
    let card = load_card(&venue).map_err(NodeError::Refused)?;
    let recorded = Recorded {
        keypoints: card.map_or_else(|| venue.keypoints.clone(), |card| card.output.keypoints),
        subjects: load_subjects(&venue).map_err(NodeError::refused)?,
        venue,
    };
    runtime::block_on(2, record(args, &recorded, &reach))
}

/// Facts for the head of the recording.
struct Recorded {
    venue: Venue,
    keypoints: KeypointSet,
    subjects: KnownSubjects,
}

async fn record(args: RecordArgs, recorded: &Recorded, reach: &Reach) -> Result<Ending, NodeError> {
    let venue = &recorded.venue;
    let (tasks, stop) = (TaskTracker::new(), CancellationToken::new());
    stop_on_signal(&tasks, &stop, Managed::No)
        .context("listening for signals")
        .map_err(NodeError::Failed)?;
    let transport = EdgeTransport {
        venue: &venue.name,
        connect: &reach.endpoints,
        identity: reach.identity.as_ref(),
    };
    say(format_args!(
        "waiting for fusion at {}",
        reach.endpoints.join(", ")
    ));
    let Some(session) = stop.run_until_cancelled(session::connect(&transport)).await else {
        return Ok(Ending::Interrupted);
    };
    let session = session.map_err(NodeError::Failed)?;
    let recording = begin(&args, recorded)?;
    let outcome = listen(venue, &session, &recording, &stop).await;
    stop.cancel();
    tasks.close();
    let summary = recording.finish().await.map_err(NodeError::Failed)?;
    say(format_args!("recorded in {}", summary.file.display()));
    session::close(&session).await;
    outcome?;
    match summary.failure {
        Some(failure) => Err(NodeError::Failed(anyhow!(failure))),
        None => Ok(Ending::Done),
    }
}

fn begin(args: &RecordArgs, recorded: &Recorded) -> Result<RecordingThread, NodeError> {
    let Recorded {
        venue,
        keypoints,
        subjects,
    } = recorded;
    let head = head(venue, args.venue.as_path(), keypoints, "record", subjects);
    let head = head.map_err(NodeError::Failed)?;
    let file = RecordingFile::make(&args.out, &venue.name).map_err(not_made)?;
    // The session is known from the messages. The recorder never requests missing messages from the edges.
    let (session, parameters) = (SessionId::default(), &venue.parameters.recording);
    RecordingThread::start(file, head, session, RunMode::Live, parameters)
        .map_err(NodeError::Failed)
}

/// Records all messages until it is stopped.
async fn listen(
    venue: &Venue,
    session: &Session,
    recording: &RecordingThread,
    stop: &CancellationToken,
) -> Result<(), NodeError> {
    let keys = Keys::new(&venue.name);
    let failed = |error: zenoh::Error| NodeError::Failed(zenoh_error(error));
    let messages = session::subscriber(session, keys.all(), QUEUE).await;
    let messages = messages.map_err(NodeError::Failed)?;
    let nodes = session::liveliness(session, keys.all_alive(), QUEUE).await;
    let nodes = nodes.map_err(NodeError::Failed)?;
    let (clock, queue) = (VenueClock::start(), recording.queue());
    let fusion = keys.status(FUSION);
    let mut agreement = Agreement::default();
    let mut reports = tokio::time::interval(REPORT_EVERY);
    let (mut n_messages, mut n_waits) = (0u64, 0u32);
    let disk = recording.disk_watch();
    loop {
        let sample: Sample = tokio::select! {
            () = stop.cancelled() => return Ok(()),
            sample = messages.recv_async() => sample.map_err(failed)?,
            node = nodes.recv_async() => {
                let node = node.map_err(failed)?;
                let presence: &[u8] = match node.kind() {
                    SampleKind::Put => b"{\"there\":true}",
                    SampleKind::Delete => b"{\"there\":false}",
                };
                queue.note(node.key_expr().as_str(), presence, clock.now_us());
                continue;
            }
            _ = reports.tick() => {
                clock.discipline();
                if recording.so_far().failure.is_some() {
                    // The recording has failed, and the failure was reported.
                    return Ok(());
                }
                n_waits = disk.notice().map_or(0, |_| n_waits + 1);
                if let Some(notice) = disk.notice()
                    && n_waits.is_multiple_of(REMIND_EVERY)
                {
                    let lost = recording.so_far().lost;
                    say(format_args!("{notice}; {lost} messages are lost so far"));
                }
                tracing::info!(n_messages, "recording");
                continue;
            }
        };
        let (key, payload) = (sample.key_expr().as_str(), sample.payload().to_bytes());
        queue.note(key, &payload, clock.now_us());
        n_messages += 1;
        if key == fusion
            && let Ok(status) = wire::decode::<Status>(&payload)
        {
            let different = difference(&venue.hashes, &status);
            match agreement.compare(different, clock.now_us()) {
                Comparison::Same => {}
                Comparison::Differs(what) => say(format_args!("{what}")),
                Comparison::StillDiffers(what) => return Err(NodeError::Refused(anyhow!(what))),
            }
        }
    }
}

/// Whether fusion uses the files that the recording contains.
#[derive(Debug, Default)]
struct Agreement {
    /// Time since which every status reported other files, microseconds.
    differs_since_us: Option<i64>,
    is_reported: bool,
}

/// The result of comparing a status with the own files.
#[derive(Debug, PartialEq, Eq)]
enum Comparison {
    /// Nothing new.
    Same,
    /// The first difference: only a warning, because without keys any node may send a status.
    Differs(String),
    /// The difference has lasted long enough to be certain.
    StillDiffers(String),
}

impl Agreement {
    /// Adds a status received at `now_us`; `different` describes how it differs from the own files.
    fn compare(&mut self, different: Option<String>, now_us: i64) -> Comparison {
        let Some(what) = different else {
            self.differs_since_us = None;
            return Comparison::Same;
        };
        match self.differs_since_us {
            None => {
                self.differs_since_us = Some(now_us);
                if std::mem::replace(&mut self.is_reported, true) {
                    Comparison::Same
                } else {
                    Comparison::Differs(what)
                }
            }
            Some(since_us) if now_us - since_us >= DIFFERS_US => Comparison::StillDiffers(what),
            Some(_) => Comparison::Same,
        }
    }
}

/// The first of fusion's files that differs from `ours`.
fn difference(ours: &VenueHash, fusion: &Status) -> Option<String> {
    let other = OwnFiles::from(ours).other_file(fusion);
    other.map(|OtherFile { what, theirs, ours }| {
        format!(
            "fusion holds another {what}: its fingerprint there is {theirs}, here {ours}; copy the same file to both"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_lasting_difference_ends_a_recording() {
        let other = || Some("another venue file".to_owned());
        let mut agreement = Agreement::default();
        let second = |n: i64| n * 1_000_000;
        let first = agreement.compare(other(), second(0));
        assert!(matches!(first, Comparison::Differs(_)));
        // Fusion's own status comes in between, once a second.
        for n in 1..20 {
            assert_eq!(agreement.compare(None, second(n)), Comparison::Same);
            assert_eq!(agreement.compare(other(), second(n) + 1), Comparison::Same);
        }
        assert_eq!(agreement.compare(None, second(20) - 1), Comparison::Same);
        assert_eq!(agreement.compare(other(), second(20)), Comparison::Same);
        assert_eq!(agreement.compare(other(), second(21)), Comparison::Same);
        let last = agreement.compare(other(), second(20) + DIFFERS_US);
        assert!(matches!(last, Comparison::StillDiffers(_)));
    }
}
