//! The published poses of a recording, without computing them again.
//!
//! They are read in order; only the number of ticks of each session is stored.

use std::collections::BTreeMap;
use std::io::{Read, Seek};

use farfield_proto::id::SessionId;
use farfield_proto::message::PoseSet;
use farfield_proto::tick::Tick;
use farfield_proto::wire;
use mcap::records::Record;

use super::RecordingError;
use super::attached::Attached;
use super::reader::topics;
use crate::recording::channels::Content;
use crate::recording::framing::{FileEnd, walk};

/// Most sessions that are distinguished; later ones are ignored.
const MOST_SESSIONS: usize = 1024;

/// The ticks of one session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PublishedTicks {
    /// The session.
    pub session: SessionId,
    /// First and last tick.
    pub span: [Tick; 2],
    /// Number of ticks.
    pub n: u64,
}

/// Summary of the published poses of a recording.
#[derive(Debug, Clone)]
pub struct Published {
    /// Metadata of the recording.
    pub attached: Attached,
    /// Its sessions, the one with the most ticks first; of equal ones the earlier.
    pub sessions: Vec<PublishedTicks>,
    /// How the file ended.
    pub end: FileEnd,
}

/// Reads the whole `file` and calls `visit` for every published tick, as live listeners got it.
/// Ticks of a session rise: repeated and late ones are skipped. Tentative people are not included.
///
/// # Errors
/// [`RecordingError`] if it is not our recording, or broken other than by an early end.
pub fn published<R: Read + Seek>(
    file: &mut R,
    visit: &mut dyn FnMut(PoseSet),
) -> Result<Published, RecordingError> {
    let mut attached = Attached::from_metadata(file)?;
    let mut topics = topics(attached.facts()).into_iter();
    let poses_topic = topics.find_map(|(key, of)| (of == Content::Poses).then_some(key));
    let mut channels = Vec::new();
    let mut sessions = BTreeMap::<SessionId, (usize, PublishedTicks)>::new();
    let end = walk(file, &mut |record, _| match record {
        Record::Header(header) => attached.header(header.profile),
        Record::Attachment { header, data, .. } => attached.attachment(header, data.into_owned()),
        Record::Channel(channel) if poses_topic.as_ref() == Some(&channel.topic) => {
            channels.push(channel.id);
        }
        Record::Message { header, data } if channels.contains(&header.channel_id) => {
            if let Ok(poses) = wire::decode::<PoseSet>(&data)
                && is_next(&mut sessions, &poses)
            {
                visit(poses);
            }
        }
        _ => {}
    })?;
    let mut sessions: Vec<(usize, PublishedTicks)> = sessions.into_values().collect();
    sessions.sort_by_key(|(number, ticks)| (std::cmp::Reverse(ticks.n), *number));
    Ok(Published {
        attached: attached.whole()?,
        sessions: sessions.into_iter().map(|(_, ticks)| ticks).collect(),
        end,
    })
}

/// Records the tick of `poses`; true if it is later than all before in its session.
fn is_next(sessions: &mut BTreeMap<SessionId, (usize, PublishedTicks)>, poses: &PoseSet) -> bool {
    let (n_sessions, tick) = (sessions.len(), poses.tick);
    if let Some((_, ticks)) = sessions.get_mut(&poses.session) {
        if tick <= ticks.span[1] {
            return false;
        }
        (ticks.span[1], ticks.n) = (tick, ticks.n + 1);
        return true;
    }
    let ticks = PublishedTicks {
        session: poses.session,
        span: [tick, tick],
        n: 1,
    };
    let has_room = n_sessions < MOST_SESSIONS;
    if has_room {
        sessions.insert(poses.session, (n_sessions, ticks));
    }
    has_room
}
