//! `farfield record`: a node of its own that listens to everything under the venue's name, and records it.
//!
//! It receives what fusion receives, but for what the links between lose, and not always in time: what fusion
//! used for each tick it takes from fusion's own word ([`farfield_proto::message::decision`]).

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use farfield_node::clock::VenueClock;
use farfield_node::endpoints::{Asked, LinkEnd, Reach};
use farfield_node::files::load_venue;
use farfield_node::log::start_log_with;
use farfield_node::process::{Ending, Managed, NodeError, exit_code, say, stop_when_told};
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
use super::session::mode::RunMode;
use super::subjects::{KnownSubjects, load_subjects};

/// Messages that wait between Zenoh and the recorder's own queue.
const QUEUE: usize = 1024;
/// For how long every status of fusion must name other files than ours until that is believed, microseconds:
/// some statuses.
const DIFFERS_US: i64 = 5_000_000;
/// How often somebody who watches is told how it goes.
const TELL_EVERY: Duration = Duration::from_secs(5);

/// Such times between two reminders that the disk is full.
const REMIND_EVERY: u32 = 12;

/// Arguments of the recording node.
#[derive(Debug, Clone, clap::Args)]
pub struct RecordArgs {
    /// The venue file.
    pub venue: PathBuf,
    /// Where fusion listens; the venue file's, if left out.
    ///
    /// For example `quic/10.0.0.1:7447`.
    #[arg(long, value_name = "ENDPOINT")]
    pub connect: Vec<String>,
    /// Talk to other machines without TLS.
    ///
    /// Everyone in the network may read and send along.
    #[arg(long)]
    pub allow_plaintext: bool,
    /// Folder of the recorder's keys; the venue file's, if left out.
    #[arg(long, value_name = "DIR")]
    pub certificates: Option<PathBuf>,
    /// The recording: a new file, or a folder for one.
    ///
    /// A folder is made where a slash ends its path.
    #[arg(long, value_name = "FILE.mcap")]
    pub out: PathBuf,
}

/// Records until it is told to stop, and says on standard error what went wrong.
pub fn main(args: RecordArgs) -> ExitCode {
    start_log_with(authentication_log::layer());
    exit_code(load_and_record(args))
}

fn load_and_record(args: RecordArgs) -> Result<Ending, NodeError> {
    let venue = load_venue(&args.venue).map_err(NodeError::refused)?;
    check_names(&venue).map_err(NodeError::Refused)?;
    check_place(&args.out).map_err(NodeError::Refused)?;
    let asked = Asked {
        side: LinkEnd::Connect,
        node: RECORDER,
        endpoints: &args.connect,
        certificates: args.certificates.as_deref(),
        allow_plaintext: args.allow_plaintext,
    };
    let reach = asked.in_venue(&venue)?;
    let card = load_card(&venue).map_err(NodeError::Refused)?;
    let recorded = Recorded {
        keypoints: card.map_or_else(KeypointSet::coco17, |card| card.output.keypoints),
        subjects: load_subjects(&venue).map_err(NodeError::refused)?,
        venue,
    };
    runtime::block_on(2, record(args, &recorded, &reach))
}

/// What a recording says of itself.
struct Recorded {
    venue: Venue,
    keypoints: KeypointSet,
    subjects: KnownSubjects,
}

async fn record(args: RecordArgs, recorded: &Recorded, reach: &Reach) -> Result<Ending, NodeError> {
    let venue = &recorded.venue;
    let (tasks, stop) = (TaskTracker::new(), CancellationToken::new());
    stop_when_told(&tasks, &stop, Managed::No)
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
    let of = (venue, args.venue.as_path());
    let head = head(of, keypoints, "record", subjects).map_err(NodeError::Failed)?;
    let file = RecordingFile::make(&args.out, &venue.name).map_err(not_made)?;
    // Whose session it is comes with the messages; nobody asks the edges for what is missing.
    let (session, parameters) = (SessionId::default(), &venue.parameters.recording);
    RecordingThread::start(file, head, session, RunMode::Live, parameters)
        .map_err(NodeError::Failed)
}

/// Notes all that is said until somebody stops it.
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
    let mut tell = tokio::time::interval(TELL_EVERY);
    let (mut n_messages, mut n_waits) = (0u64, 0u32);
    let disk = recording.disk_watch();
    loop {
        let sample: Sample = tokio::select! {
            () = stop.cancelled() => return Ok(()),
            sample = messages.recv_async() => sample.map_err(failed)?,
            node = nodes.recv_async() => {
                let node = node.map_err(failed)?;
                let there: &[u8] = match node.kind() {
                    SampleKind::Put => b"{\"there\":true}",
                    SampleKind::Delete => b"{\"there\":false}",
                };
                queue.note(node.key_expr().as_str(), there, clock.now_us());
                continue;
            }
            _ = tell.tick() => {
                clock.discipline();
                if recording.so_far().failure.is_some() {
                    // It has been said why; there is nothing left to do.
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

/// Whether fusion works with the files that the recording carries.
#[derive(Debug, Default)]
struct Agreement {
    /// Since when every status said otherwise, microseconds.
    differs_since_us: Option<i64>,
    is_told: bool,
}

/// What a status means for the recording.
#[derive(Debug, PartialEq, Eq)]
enum Comparison {
    /// Nothing new.
    Same,
    /// For the first time: worth a warning, and no more, as without keys anybody may say so.
    Differs(String),
    /// For so long that it must be true.
    StillDiffers(String),
}

impl Agreement {
    /// Takes how a status of `now_us` differs from the own files, if it does.
    fn compare(&mut self, different: Option<String>, now_us: i64) -> Comparison {
        let Some(what) = different else {
            self.differs_since_us = None;
            return Comparison::Same;
        };
        match self.differs_since_us {
            None => {
                self.differs_since_us = Some(now_us);
                if std::mem::replace(&mut self.is_told, true) {
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

/// Which of fusion's files is not the one of `ours`.
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
    fn one_status_of_a_stranger_does_not_end_a_recording_but_fusion_with_other_files_does() {
        let other = || Some("another venue file".to_owned());
        let mut agreement = Agreement::default();
        let second = |n: i64| n * 1_000_000;
        let first = agreement.compare(other(), second(0));
        assert!(matches!(first, Comparison::Differs(_)));
        // Fusion's own word comes once a second between.
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
