//! Who takes part: which node speaks for each viewpoint, whether it holds the same files as fusion, and
//! what its recordings hold. Statuses in, answers out; edges come and go.

use std::ops::Range;

use farfield_proto::message::Status;
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use farfield_proto::venue::same_files::{OtherFile, OwnFiles};

use super::{Micros, SECOND_US};

/// A node that says once a second how it is, and is silent for so long, is not there any more.
const SILENT_US: Micros = 3 * SECOND_US;

/// What a status has changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Said {
    /// Nothing that matters to links.
    Nothing,
    /// Another process speaks for the viewpoint of this index: nothing is known of its clock.
    NewNode(usize),
    /// No viewpoint of the venue has this name.
    Unknown,
}

/// One process that speaks under a name.
#[derive(Debug, Clone, Copy)]
struct Speaker {
    process: u64,
    heard_us: Micros,
}

#[derive(Debug, Clone, Default)]
struct Member {
    name: String,
    speaker: Option<Speaker>,
    rival: Option<Speaker>,
    /// Whether the speaker was heard after the rival: both are there.
    is_contested: bool,
    refused: Option<String>,
    last_word: Option<Status>,
}

/// All viewpoints of a venue.
#[derive(Debug, Clone)]
pub struct Membership {
    venue_hash: String,
    calibration_hash: String,
    /// How the fingerprint of an edge's networks must begin, where that is known.
    models: Option<String>,
    members: Vec<Member>,
}

impl Membership {
    /// No status has come yet.
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

    /// Refuses edges whose networks' fingerprint does not begin with `models`, where that is known.
    pub fn expect_models(&mut self, models: Option<&str>) {
        self.models = models.map(str::to_owned);
    }

    /// Takes the word of an edge.
    pub fn hear(&mut self, status: &Status, now_us: Micros) -> Said {
        let Some(index) = self.members.iter().position(|m| m.name == status.node) else {
            return Said::Unknown;
        };
        let process = status.process;
        let now = Speaker {
            process,
            heard_us: now_us,
        };
        let member = &mut self.members[index];
        let said = match member.speaker {
            Some(speaker) if speaker.process == process => {
                member.is_contested = member.rival.is_some();
                Said::Nothing
            }
            Some(speaker) if now_us - speaker.heard_us < SILENT_US => {
                member.rival = Some(now);
                return Said::Nothing;
            }
            _ => {
                (member.rival, member.is_contested) = (None, false);
                Said::NewNode(index)
            }
        };
        member.speaker = Some(now);
        if member
            .rival
            .is_some_and(|rival| now_us - rival.heard_us >= SILENT_US)
        {
            (member.rival, member.is_contested) = (None, false);
        }
        let refused = self
            .other_file(status)
            .or_else(|| self.other_network(index, status));
        let member = &mut self.members[index];
        member.refused = refused;
        member.last_word = Some(status.clone());
        said
    }

    /// The node has left, as its token says.
    pub fn leave(&mut self, node: &str) -> Option<usize> {
        let index = self.members.iter().position(|m| m.name == node)?;
        let member = &mut self.members[index];
        // Its last word is kept: it says what the recordings hold.
        (member.speaker, member.rival, member.is_contested) = (None, None, false);
        Some(index)
    }

    /// Whether the viewpoint's patches may be used, as far as its statuses say.
    pub fn is_welcome(&self, index: usize) -> bool {
        let member = self.members.get(index);
        member.is_some_and(|m| m.last_word.is_some() && m.refused.is_none())
    }

    /// Why the viewpoint is refused, if it is.
    pub fn refused(&self, index: usize) -> Option<&str> {
        self.members.get(index)?.refused.as_deref()
    }

    /// Why the viewpoint's edge has given up, if it has. (What it says of being refused by fusion is told by
    /// whoever refused it.)
    pub fn failure(&self, index: usize) -> Option<&str> {
        let failure = self
            .members
            .get(index)?
            .last_word
            .as_ref()?
            .failure
            .as_deref();
        failure.filter(|text| !text.starts_with("refused by fusion"))
    }

    /// The second process of the viewpoint's name, if both speak.
    pub fn second(&self, index: usize) -> Option<u64> {
        let member = self.members.get(index).filter(|m| m.is_contested)?;
        member.rival.map(|rival| rival.process)
    }

    /// The last word of every viewpoint that ever spoke, in the venue's order.
    pub fn last_words(&self) -> impl Iterator<Item = &Status> {
        self.members.iter().filter_map(|m| m.last_word.as_ref())
    }

    /// The viewpoints that are not ready, as far as they have said.
    pub fn missing(&self) -> Vec<&str> {
        let is_ready = |m: &&Member| !m.last_word.as_ref().is_some_and(|status| status.ready);
        let missing = self.members.iter().filter(is_ready);
        missing.map(|m| m.name.as_str()).collect()
    }

    /// The epoch that a welcome edge goes by: fusion was here before. `tick_by` says which tick it is now by an
    /// epoch; that must be one that the edge's recordings hold and that was `asked` for, or the run would be
    /// over before it begins.
    pub fn epoch_us(
        &self,
        tick_by: impl Fn(u64) -> Tick,
        asked: Option<&Range<Tick>>,
    ) -> Option<u64> {
        let welcome = self.members.iter().filter(|m| m.refused.is_none());
        let mut words = welcome.filter_map(|m| m.last_word.as_ref());
        words.find_map(|status| {
            let epoch_us = status.live.as_ref()?.epoch_us?;
            let now = tick_by(epoch_us);
            let is_held = status
                .ticks
                .is_none_or(|[from, to]| (from..to).contains(&now));
            let is_asked = asked.is_none_or(|asked| asked.contains(&now));
            (is_held && is_asked).then_some(epoch_us)
        })
    }

    /// All ticks that any of the recordings holds; `None` while no edge has said that it plays one.
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

    /// Maps of different networks do not compare. Whoever came first goes on.
    fn other_network(&self, index: usize, status: &Status) -> Option<String> {
        let (name, hash) = self.others_with_network(index, status).find(|(_, hash)| {
            // Another backend computes the same maps but for the last bits.
            models_and_backend(hash).0 != models_and_backend(&status.network_hash).0
        })?;
        Some(format!(
            "it runs another network than {name}: {} and {hash}",
            status.network_hash
        ))
    }

    /// A warning where the viewpoint of this index computes with another backend than the first of the others.
    pub fn other_backend(&self, index: usize) -> Option<String> {
        let status = self.members.get(index)?.last_word.as_ref()?;
        let (name, hash) = self.others_with_network(index, status).next()?;
        let backends = [hash, &status.network_hash].map(|hash| models_and_backend(hash).1);
        (backends[0] != backends[1]).then(|| {
            format!(
                "it computes with {}, {name} with {}: both take part; tract is several times slower, and is what an edge falls back on where it finds no ONNX Runtime",
                backends[1], backends[0]
            )
        })
    }

    /// The other viewpoints that take part and run a network, with its fingerprint; none where `status` has no network:
    /// a viewpoint of keypoint files fits any.
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
                Some((m.name.as_str(), m.last_word.as_ref()?.network_hash.as_str()))
            })
            .filter(|(_, hash)| !hash.is_empty() && !status.network_hash.is_empty())
    }
}

/// The two parts of a fingerprint of networks: which, and what computes them.
fn models_and_backend(network_hash: &str) -> (&str, &str) {
    network_hash.rsplit_once('+').unwrap_or((network_hash, ""))
}

#[cfg(test)]
#[path = "membership_tests.rs"]
mod tests;
