//! The ring on disk: messages that a live edge sent or could not send. Fusion fetches them after an
//! outage.
//!
//! Its own thread writes and reads it, so the pipeline never waits for the disk.

mod store;
mod thread;

use std::time::Duration;

use farfield_node::session::zenoh_error;
use farfield_proto::key::Keys;
use farfield_proto::message::fill::{FillRequest, Filled};
use farfield_proto::wire;
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;
use tracing::debug;
use zenoh::Session;
use zenoh::handlers::RingChannel;
use zenoh::query::Query;

pub(super) use self::thread::{RingHandle, RingThread};

/// Waiting requests. If there are more, the oldest are dropped, because their senders time out
/// first. Zenoh's threads must not wait.
const QUEUE: usize = 4;
/// Longest time for the disk; less than fusion waits for an answer.
const PATIENCE: Duration = Duration::from_secs(2);

/// Task: answers requests on `{venue}/fill/{viewpoint}` until `stop`. An answer has the priority of
/// the request, which fusion makes the lowest. It is sent only if `admit` accepts its size in
/// bytes.
///
/// # Errors
/// The error of Zenoh if the key cannot be served.
pub(super) async fn answer_questions(
    session: Session,
    [venue, viewpoint]: [String; 2],
    ring: RingHandle,
    admit: impl Fn(usize) -> bool + Send,
    stop: CancellationToken,
) -> anyhow::Result<()> {
    let key = Keys::new(&venue).fill(&viewpoint);
    let questions = session
        .declare_queryable(&key)
        .with(RingChannel::new(QUEUE))
        .await
        .map_err(zenoh_error)?;
    loop {
        let question = tokio::select! {
            question = questions.recv_async() => question,
            () = stop.cancelled() => return Ok(()),
        };
        let Ok(question) = question else {
            return Ok(());
        };
        let Some(request) = read(&question) else {
            debug!("a question that cannot be read");
            continue;
        };
        let Ok(Some(filled)) = timeout(PATIENCE, ring.answer(request)).await else {
            debug!("the ring is busy, or the disk hangs");
            continue;
        };
        let mut bytes = wire::encode_for_anyone(&filled);
        if !admit(bytes.len()) {
            bytes = wire::encode_for_anyone(&later(&request));
        }
        if let Err(error) = question.reply(&key, bytes).await {
            debug!(%error, "not answered");
        }
    }
}

fn read(question: &Query) -> Option<FillRequest> {
    let payload = question.payload()?.to_bytes();
    wire::decode(&payload).ok()
}

/// The answer if the link has no room now.
fn later(request: &FillRequest) -> Filled {
    Filled {
        to: request.from,
        stored: Vec::new(),
    }
}
