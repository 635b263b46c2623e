//! Membership of nodes: which process represents each viewpoint, whether it has the same files as
//! fusion, and what its recordings contain. Statuses in, answers out; edges come and go.

use std::ops::Range;

use farfield_proto::message::Status;
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use farfield_proto::venue::same_files::{OtherFile, OwnFiles};

use super::{Micros, SECOND_US};

/// A node sends a status once a second; after this silence it is gone.
const SILENT_US: Micros = 3 * SECOND_US;

/// The change that a status caused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StatusChange {
    /// None that matters to links.
    Nothing,
    /// A new process represents the viewpoint of this index: its clock is unknown.
    NewNode(usize),
    /// No viewpoint of the venue has this name.
    Unknown,
}

/// One process with a node's name.
#[derive(Debug, Clone, Copy)]
struct Speaker {
    process: u64,
    last_status_us: Micros,
}

#[derive(Debug, Clone, Default)]
struct Member {
    name: String,
    speaker: Option<Speaker>,
    rival: Option<Speaker>,
    /// Whether the speaker sent a status after the rival: both run.
    is_contested: bool,
    refused: Option<String>,
    last_status: Option<Status>,
}

/// All viewpoints of a venue.
#[derive(Debug, Clone)]
pub struct Membership {
    venue_hash: String,
    calibration_hash: String,
    /// Expected prefix of the fingerprint of an edge's networks, if known.
    models: Option<String>,
    members: Vec<Member>,
}

impl Membership {
    /// Before the first status.
    pub fn new(venue: &Venue) -> Self {
        let member = |name: &String| Member {
            name: name.clone(),
            ..Member::default()
        };
        let names = venue.viewpoints.iter().map(|viewpoint| &viewpoint.name);
        Self {
            venue_hash: venue.hashes.venue.clone(),
            calibration_hash: venue.hashes.calibration.clone(),
            models: None,
            members: names.map(member).collect(),
        }
    }

    /// Refuses edges whose networks' fingerprint does not begin with `models`, if that is known.
    pub fn expect_models(&mut self, models: Option<&str>) {
        self.models = models.map(str::to_owned);
    }

    /// Processes the status of an edge.
    pub fn update(&mut self, status: &Status, now_us: Micros) -> StatusChange {
        let Some(index) = self.members.iter().position(|m| m.name == status.node) else {
            return StatusChange::Unknown;
        };
        let process = status.process;
        let now = Speaker {
            process,
            last_status_us: now_us,
        };
        let member = &mut self.members[index];
        let change = match member.speaker {
            Some(speaker) if speaker.process == process => {
                member.is_contested = member.rival.is_some();
                StatusChange::Nothing
            }
            Some(speaker) if now_us - speaker.last_status_us < SILENT_US => {
                member.rival = Some(now);
                return StatusChange::Nothing;
            }
            _ => {
                (member.rival, member.is_contested) = (None, false);
                StatusChange::NewNode(index)
            }
        };
        member.speaker = Some(now);
        if member
            .rival
            .is_some_and(|rival| now_us - rival.last_status_us >= SILENT_US)
        {
            (member.rival, member.is_contested) = (None, false);
        }
        let refused = self
            .other_file(status)
            .or_else(|| self.other_network(index, status));
        let member = &mut self.members[index];
        member.refused = refused;
        member.last_status = Some(status.clone());
        change
    }

    /// The node has left, by its liveliness token.
    pub fn leave(&mut self, node: &str) -> Option<usize> {
        let index = self.members.iter().position(|m| m.name == node)?;
        let member = &mut self.members[index];
        // Its last status is kept: it has the contents of the recordings.
        (member.speaker, member.rival, member.is_contested) = (None, None, false);
        Some(index)
    }

    /// Whether the viewpoint's patches may be used, by its statuses.
    pub fn is_welcome(&self, index: usize) -> bool {
        let member = self.members.get(index);
        member.is_some_and(|m| m.last_status.is_some() && m.refused.is_none())
    }

    /// Why the viewpoint is refused, if it is.
    pub fn refused(&self, index: usize) -> Option<&str> {
        self.members.get(index)?.refused.as_deref()
    }

    /// Why the viewpoint's edge has failed, if it has. (A refusal by fusion is reported by the
    /// refusing node.)
    pub fn failure(&self, index: usize) -> Option<&str> {
        let failure = self
            .members
            .get(index)?
            .last_status
            .as_ref()?
            .failure
            .as_deref();
        failure.filter(|text| !text.starts_with("refused by fusion"))
    }

    /// The second process of the viewpoint's name, if both run.
    pub fn second(&self, index: usize) -> Option<u64> {
        let member = self.members.get(index).filter(|m| m.is_contested)?;
        member.rival.map(|rival| rival.process)
    }

    /// The last status of every viewpoint that sent one, in the venue's order.
    pub fn last_words(&self) -> impl Iterator<Item = &Status> {
        self.members.iter().filter_map(|m| m.last_status.as_ref())
    }

    /// The viewpoints that are not ready, by their statuses.
    pub fn missing(&self) -> Vec<&str> {
        let is_ready = |m: &&Member| !m.last_status.as_ref().is_some_and(|status| status.ready);
        let missing = self.members.iter().filter(is_ready);
        missing.map(|m| m.name.as_str()).collect()
    }

    /// The epoch of an accepted edge, if fusion ran before. `tick_by` gives the current tick by an
    /// epoch. That tick must be in the edge's recordings and in the `requested` range, or the run
    /// would end before it begins.
    pub fn epoch_us(
        &self,
        tick_by: impl Fn(u64) -> Tick,
        requested: Option<&Range<Tick>>,
    ) -> Option<u64> {
        let welcome = self.members.iter().filter(|m| m.refused.is_none());
        let mut statuses = welcome.filter_map(|m| m.last_status.as_ref());
        statuses.find_map(|status| {
            let epoch_us = status.live.as_ref()?.epoch_us?;
            let now = tick_by(epoch_us);
            let is_held = status
                .ticks
                .is_none_or(|[from, to]| (from..to).contains(&now));
            let is_requested = requested.is_none_or(|requested| requested.contains(&now));
            (is_held && is_requested).then_some(epoch_us)
        })
    }

    /// All ticks of all recordings; `None` before an edge has reported one.
    pub fn recorded(&self) -> Option<Range<Tick>> {
        let ticks = self.last_words().filter_map(|status| status.ticks);
        ticks
            .map(|[from, to]| from..to)
            .reduce(|a, b| a.start.min(b.start)..a.end.max(b.end))
    }

    fn other_file(&self, status: &Status) -> Option<String> {
        let own = OwnFiles {
            venue: &self.venue_hash,
            calibration: &self.calibration_hash,
            networks: self.models.as_deref(),
        };
        own.other_file(status).map(|OtherFile { what, theirs, ours }| {
            format!(
                "it holds another {what} than fusion: its fingerprint there is {theirs}, here {ours}; start that edge with --from-fusion to fetch it, or copy the same file to both"
            )
        })
    }

    /// Maps of different networks are not comparable. The network that came first is kept.
    fn other_network(&self, index: usize, status: &Status) -> Option<String> {
        let (name, hash) = self.others_with_network(index, status).find(|(_, hash)| {
            // Another backend computes the same maps except for the last bits.
            models_and_backend(hash).0 != models_and_backend(&status.network_hash).0
        })?;
        Some(format!(
            "it runs another network than {name}: {} and {hash}",
            status.network_hash
        ))
    }

    /// A warning if this viewpoint uses another backend than the first of the others.
    pub fn other_backend(&self, index: usize) -> Option<String> {
        let status = self.members.get(index)?.last_status.as_ref()?;
        let (name, hash) = self.others_with_network(index, status).next()?;
        let backends = [hash, &status.network_hash].map(|hash| models_and_backend(hash).1);
        (backends[0] != backends[1]).then(|| {
            format!(
                "it computes with {}, {name} with {}: both take part; tract is several times slower; an edge uses it if it finds no ONNX Runtime",
                backends[1], backends[0]
            )
        })
    }

    /// The other viewpoints that take part and run a network, with its fingerprint. None if
    /// `status` has no network: keypoint files are compatible with any.
    fn others_with_network<'a>(
        &'a self,
        index: usize,
        status: &'a Status,
    ) -> impl Iterator<Item = (&'a str, &'a str)> {
        let others = self.members.iter().enumerate();
        let others =
            others.filter(move |(i, m)| *i != index && m.speaker.is_some() && m.refused.is_none());
        others
            .filter_map(|(_, m)| {
                Some((
                    m.name.as_str(),
                    m.last_status.as_ref()?.network_hash.as_str(),
                ))
            })
            .filter(|(_, hash)| !hash.is_empty() && !status.network_hash.is_empty())
    }
}

/// The two parts of a fingerprint of networks: models and backend.
fn models_and_backend(network_hash: &str) -> (&str, &str) {
    network_hash.rsplit_once('+').unwrap_or((network_hash, ""))
}

#[cfg(test)]
#[path = "membership_tests.rs"]
mod tests;
