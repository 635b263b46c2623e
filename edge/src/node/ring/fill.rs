//! Answers fusion's questions for what an outage has kept from it.

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

use super::thread::RingHandle;

/// Questions that wait; of more, the oldest are dropped: who asked has given them up first, and Zenoh's
/// threads must not wait.
const QUEUE: usize = 4;
/// How long the disk may take for an answer: less than fusion waits for it.
const PATIENCE: Duration = Duration::from_secs(2);

/// Task: answers what is asked for under `{venue}/fill/{viewpoint}` until `stop`. An answer goes out
/// with the question's priority, which fusion makes the lowest, and only when `admit` lets so many bytes pass.
///
/// # Errors
/// What Zenoh says when the questions cannot be listened for.
pub(in crate::node) async fn answer_questions(
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

/// There is no room on the link now.
fn later(request: &FillRequest) -> Filled {
    Filled {
        to: request.from,
        stored: Vec::new(),
    }
}
