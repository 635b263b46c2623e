//! Recordings: MCAP files of everything that fusion received and sent, and of what it used for each
//! tick.
//!
//! [`writer`] writes to any sink, [`reader`] reads from any source, [`replay`] computes a recording
//! again, [`messages`] returns the messages in order of time, [`published`] the poses. No file is
//! opened here, and no clock is read: times come with the messages. A recording has no pictures.
//!
//! Channels are Zenoh keys with the original bytes (message encoding `farfield-wire`); log time is
//! arrival, publish time sending. Sets that an edge delivered after an outage are in separate
//! channels, `{venue}/fill/{viewpoint}/patch` and `.../sighting`. Poses are also stored as JSON.

use mcap::records::Record;

pub mod channels;
mod compression;
pub mod expected;
mod framing;
pub mod holes;
pub mod poses_json;
mod reading;
mod renumber;
pub mod replay;
mod tick_ranges;
pub mod writer;

pub use self::reading::{attached, messages, published, reader};

/// Profile of the files' header: it distinguishes our recordings from other MCAP files.
pub const PROFILE: &str = "farfield";
/// Message encoding of the original bytes.
pub const WIRE_ENCODING: &str = "farfield-wire";
/// Name of the metadata record with [`writer::Head::facts`].
pub const FACTS: &str = "farfield";
/// Name of the attached venue file.
pub const VENUE_FILE: &str = "venue.toml";
/// Name of the attached calibration.
pub const CALIBRATION_FILE: &str = "calibration.toml";
/// Name of the attached card of the keypoint network.
pub const CARD_FILE: &str = "network.toml";

/// Most profiles of subjects in a recording.
const MAX_SUBJECT_FILES: usize = 256;

/// Name of the attached profile of the venue's subject with that number, from 1, in the order of
/// the venue file.
pub fn subject_file(number: usize) -> String {
    format!("subject-{number}.toml")
}

/// Whether an attached file with that name is the profile of a subject.
fn is_subject_file(name: &str) -> bool {
    let number = name.strip_prefix("subject-");
    let number = number.and_then(|rest| rest.strip_suffix(".toml"));
    let number = number.and_then(|digits| digits.parse().ok());
    number.is_some_and(|n| (1..=MAX_SUBJECT_FILES).contains(&n) && subject_file(n) == name)
}

/// Most bytes of an attached file that a replay accepts.
pub const MAX_ATTACHED_BYTES: u64 = framing::MAX_RECORD_BYTES - 4096;

/// Venue of a file that begins with `head`; `None` if it is not our recording, or `head` is too
/// short. Fusion and recorder write the metadata first: some thousands of bytes suffice.
pub fn venue_of(head: &[u8]) -> Option<String> {
    let mut venue = None;
    let mut meet = |record: Record<'_>, _| {
        if let Record::Metadata(mut facts) = record
            && facts.name == FACTS
        {
            venue = venue.take().or(facts.metadata.remove("venue"));
        }
    };
    // The data after the metadata is cut off somewhere, which does not matter here.
    drop(framing::walk(&mut std::io::Cursor::new(head), &mut meet));
    venue.filter(|_| is_ours(head))
}

/// Whether a file that begins with `head` (64 bytes suffice) is our recording.
pub fn is_ours(head: &[u8]) -> bool {
    // Magic, opcode and length of the header, length of the profile.
    let profile_at = mcap::MAGIC.len() + 1 + 8 + 4;
    let profile = head.get(profile_at..profile_at + PROFILE.len());
    let len = head.get(profile_at - 4..profile_at);
    head.starts_with(mcap::MAGIC)
        && len == Some(&(PROFILE.len() as u32).to_le_bytes()[..])
        && profile == Some(PROFILE.as_bytes())
}

#[cfg(test)]
mod chunk_tests;
#[cfg(test)]
mod tests;
