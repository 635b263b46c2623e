//! Reads a recording: once completely for an index, then tick by tick.
//!
//! Memory: 48 bytes per set, and the decisions; the sets are read at their ticks.

use std::collections::BTreeMap;
use std::io::{Read, Seek};

use farfield_proto::id::{SessionId, ViewpointIndex};
use farfield_proto::message::decision::Decision;
use farfield_proto::message::fill::SetKind;
use farfield_proto::message::identity_event::IdentityEventSet;
use farfield_proto::message::live::MAX_EDGES;
use farfield_proto::message::naming::NamingSet;
use farfield_proto::message::{PatchSet, PoseSet, SightingSet};
use farfield_proto::tick::Tick;
use farfield_proto::wire;
use mcap::records::Record;
use serde::Deserialize;

pub use super::RecordingError;

use super::attached::Attached;
use super::{ChunkNumbers, MessagePosition, PlacedMessages};
use crate::identity::known::KnownPeople;
use crate::recording::channels::{Content, channels};
use crate::recording::expected::ExpectedPeople;
use crate::recording::framing::{FileEnd, RecordPlace, walk};

/// One recorded set, in the order in which the sets of a tick are used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct SetEntry {
    session: SessionId,
    tick: Tick,
    kind: SetKind,
    viewpoint: ViewpointIndex,
    part: u16,
    /// Whether it was requested after an outage.
    filled: bool,
    position: MessagePosition,
}

/// A patch or sighting set of a recording.
#[derive(Debug, Clone, PartialEq)]
pub enum AnySet {
    /// Patches.
    Patches(PatchSet),
    /// Sightings.
    Sightings(SightingSet),
}

/// One session of fusion in a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct SessionPart {
    /// Its id.
    pub session: SessionId,
    /// The sets that fusion used, in the order of the ticks; empty if they were not recorded.
    pub decisions: Vec<Decision>,
    /// First and last tick with sets or a decision.
    pub ticks: [Tick; 2],
    /// The people that it expected from the previous session.
    pub expected: KnownPeople,
    /// Distinct sets, also filled ones.
    pub sets: usize,
    /// Distinct sets that exist only because they were requested after an outage.
    pub filled: usize,
}

/// A completely read recording.
pub struct Recording<R> {
    messages: PlacedMessages<R>,
    attached: Attached,
    sets: Vec<SetEntry>,
    poses: BTreeMap<(SessionId, Tick), MessagePosition>,
    sessions: Vec<SessionPart>,
    end: FileEnd,
    unreadable: u64,
    lost: u64,
}

impl<R: Read + Seek> Recording<R> {
    /// Reads the whole `file`.
    ///
    /// # Errors
    /// [`RecordingError`] if it is not our recording, or broken other than by an early end.
    pub fn open(mut file: R) -> Result<Self, RecordingError> {
        let attached = Attached::from_metadata(&mut file)?;
        let mut index = Index {
            topics: topics(attached.facts()),
            attached,
            ..Index::default()
        };
        let end = walk(&mut file, &mut |record, place| index.meet(record, place))?;
        let attached = index.attached.whole()?;
        index.sets.sort_unstable();
        index
            .sets
            .dedup_by_key(|set| (set.session, set.tick, set.kind, set.viewpoint, set.part));
        let sessions = sessions(&index.sets, index.decisions, index.expected);
        Ok(Self {
            messages: PlacedMessages::new(file, index.chunks),
            attached,
            sets: index.sets,
            poses: index.poses,
            sessions,
            end,
            unreadable: index.unreadable,
            lost: index.lost,
        })
    }

    /// Versions, fingerprints, recorder.
    pub fn facts(&self) -> &BTreeMap<String, String> {
        self.attached.facts()
    }

    /// The attached file `name`, as text.
    pub fn file(&self, name: &str) -> Option<&str> {
        self.attached.file(name)
    }

    /// Its metadata.
    pub fn attached(&self) -> &Attached {
        &self.attached
    }

    /// The sessions in it, the one with the most ticks first.
    pub fn sessions(&self) -> &[SessionPart] {
        &self.sessions
    }

    /// How the file ended.
    pub fn end(&self) -> &FileEnd {
        &self.end
    }

    /// Messages of another version of the wire, or broken.
    pub fn unreadable(&self) -> u64 {
        self.unreadable
    }

    /// Messages that its recorder reported as lost.
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// The ticks of a session with sets, in order.
    pub fn ticks(&self, session: SessionId) -> Vec<Tick> {
        let own = self.sets.iter().filter(|set| set.session == session);
        let mut ticks: Vec<Tick> = own.map(|set| set.tick).collect();
        ticks.dedup();
        ticks
    }

    /// Every recorded set of a tick, by kind, viewpoint and part; of two equal parts, the
    /// unrequested one that came first.
    ///
    /// # Errors
    /// If the file cannot be read any more.
    pub fn sets(&mut self, session: SessionId, tick: Tick) -> Result<Vec<AnySet>, RecordingError> {
        let from = self
            .sets
            .partition_point(|set| (set.session, set.tick) < (session, tick));
        let mut found = Vec::new();
        for i in from..self.sets.len() {
            let set = self.sets[i];
            if (set.session, set.tick) != (session, tick) {
                break;
            }
            let bytes = self.messages.bytes(set.position)?;
            let changed = |_| RecordingError::Changed(set.position.at);
            found.push(match set.kind {
                SetKind::Patches => AnySet::Patches(wire::decode(&bytes).map_err(changed)?),
                SetKind::Sightings => AnySet::Sightings(wire::decode(&bytes).map_err(changed)?),
            });
        }
        Ok(found)
    }

    /// The poses that fusion published for a tick, if they were recorded.
    ///
    /// # Errors
    /// If the file cannot be read any more.
    pub fn poses(
        &mut self,
        session: SessionId,
        tick: Tick,
    ) -> Result<Option<PoseSet>, RecordingError> {
        let Some(&position) = self.poses.get(&(session, tick)) else {
            return Ok(None);
        };
        let bytes = self.messages.bytes(position)?;
        let poses = wire::decode(&bytes).map_err(|_| RecordingError::Changed(position.at))?;
        Ok(Some(poses))
    }
}

/// Data collected while reading.
#[derive(Default)]
struct Index {
    attached: Attached,
    /// Contents by topic, from the facts.
    topics: BTreeMap<String, Content>,
    contents: BTreeMap<u16, Content>,
    chunks: ChunkNumbers,
    sets: Vec<SetEntry>,
    poses: BTreeMap<(SessionId, Tick), MessagePosition>,
    decisions: Vec<Decision>,
    expected: Vec<ExpectedPeople>,
    unreadable: u64,
    lost: u64,
}

#[derive(Deserialize)]
struct RecorderStatus {
    lost: u64,
}

impl Index {
    fn meet(&mut self, record: Record<'_>, place: RecordPlace) {
        match record {
            Record::Header(header) => self.attached.header(header.profile),
            Record::Attachment { header, data, .. } => {
                self.attached.attachment(header, data.into_owned());
            }
            Record::Channel(channel) => {
                if let Some(&content) = self.topics.get(&channel.topic) {
                    self.contents.insert(channel.id, content);
                }
            }
            Record::Message { header, data } => {
                if let Some(&content) = self.contents.get(&header.channel_id)
                    && let Some(position) = self.chunks.position(place, &data)
                {
                    self.message(content, position, &data);
                }
            }
            _ => {}
        }
    }

    fn message(&mut self, content: Content, position: MessagePosition, data: &[u8]) {
        let read = match content {
            Content::Sets(kind) => self.set(kind, false, position, data),
            Content::Filled(kind) => self.set(kind, true, position, data),
            Content::Decisions => wire::decode(data).map(|decision| self.decisions.push(decision)),
            Content::Poses => wire::decode::<PoseSet>(data).map(|poses| {
                self.poses
                    .entry((poses.session, poses.tick))
                    .or_insert(position);
            }),
            // A replay decides identities again.
            Content::Events => wire::decode::<IdentityEventSet>(data).map(drop),
            Content::Namings => wire::decode::<NamingSet>(data).map(drop),
            Content::Recorder => {
                let status = serde_json::from_slice::<RecorderStatus>(data);
                self.lost = status.map_or(self.lost, |status| status.lost);
                Ok(())
            }
            Content::Expected => {
                let expected = serde_json::from_slice(data);
                let expected = expected.ok().and_then(ExpectedPeople::checked);
                let unreadable = wire::WireError::Invalid("implausible people");
                expected
                    .map(|people| self.expected.push(people))
                    .ok_or(unreadable)
            }
            _ => Ok(()),
        };
        self.unreadable += u64::from(read.is_err());
    }

    fn set(
        &mut self,
        kind: SetKind,
        filled: bool,
        position: MessagePosition,
        data: &[u8],
    ) -> Result<(), wire::WireError> {
        let (session, tick, viewpoint, part) = match kind {
            SetKind::Patches => {
                let set: PatchSet = wire::decode(data)?;
                (set.session, set.tick, set.viewpoint, set.part)
            }
            SetKind::Sightings => {
                let set: SightingSet = wire::decode(data)?;
                (set.session, set.tick, set.viewpoint, set.part)
            }
        };
        self.sets.push(SetEntry {
            session,
            tick,
            kind,
            viewpoint,
            part,
            filled,
            position,
        });
        Ok(())
    }
}

/// The topics of the venue in `facts`.
pub(super) fn topics(facts: &BTreeMap<String, String>) -> BTreeMap<String, Content> {
    let (Some(venue), Some(viewpoints)) = (facts.get("venue"), facts.get("viewpoints")) else {
        return BTreeMap::new();
    };
    let viewpoints: Vec<&str> = viewpoints.split(' ').take(MAX_EDGES).collect();
    channels(venue, &viewpoints)
        .into_iter()
        .map(|channel| (channel.topic, channel.content))
        .collect()
}

/// The sessions, from all sets (in order) and decisions.
fn sessions(
    sets: &[SetEntry],
    decisions: Vec<Decision>,
    expected: Vec<ExpectedPeople>,
) -> Vec<SessionPart> {
    let mut parts: BTreeMap<SessionId, SessionPart> = BTreeMap::new();
    for set in sets {
        let part = entry(&mut parts, set.session, set.tick);
        part.sets += 1;
        part.filled += usize::from(set.filled);
    }
    for decision in decisions {
        let part = entry(&mut parts, decision.session, decision.tick);
        part.decisions.push(decision);
    }
    for ExpectedPeople { session, known } in expected {
        if let Some(part) = parts.get_mut(&session) {
            part.expected = known;
        }
    }
    let mut parts: Vec<SessionPart> = parts.into_values().collect();
    for part in &mut parts {
        part.decisions.sort_by_key(|decision| decision.tick);
        part.decisions.dedup_by_key(|decision| decision.tick);
    }
    parts.sort_by_key(|part| std::cmp::Reverse((part.decisions.len(), part.sets)));
    parts
}

/// The session `session`, extended to `tick`.
fn entry(
    parts: &mut BTreeMap<SessionId, SessionPart>,
    session: SessionId,
    tick: Tick,
) -> &mut SessionPart {
    let part = parts.entry(session).or_insert_with(|| SessionPart {
        session,
        decisions: Vec::new(),
        ticks: [tick, tick],
        expected: KnownPeople::default(),
        sets: 0,
        filled: 0,
    });
    part.ticks = [part.ticks[0].min(tick), part.ticks[1].max(tick)];
    part
}
