//! Every message of a recording in order of time, without computing poses.
//!
//! Memory: 32 bytes per message; the bytes of a message are read on request.

use std::collections::BTreeMap;
use std::io::{Read, Seek};
use std::ops::Range;

use mcap::records::Record;

use super::attached::Attached;
use super::reader::topics;
use super::{ChunkNumbers, MessagePosition, PlacedMessages, RecordingError};
use crate::recording::framing::{RecordPlace, walk};

/// A message that is not read yet.
#[derive(Debug, Clone, Copy)]
struct Entry {
    at_us: i64,
    topic: u16,
    position: MessagePosition,
}

/// A recording as a sequence of messages.
#[derive(Debug)]
pub struct MessagesInTime<R> {
    messages: PlacedMessages<R>,
    attached: Attached,
    /// Keys of the venue, by their number in entries.
    topics: Vec<String>,
    /// By time; equal times in the order of the file.
    entries: Vec<Entry>,
}

impl<R: Read + Seek> MessagesInTime<R> {
    /// Reads the whole `file`.
    ///
    /// # Errors
    /// [`RecordingError`] if it is not our recording, or broken other than by an early end.
    pub fn open(mut file: R) -> Result<Self, RecordingError> {
        let attached = Attached::from_metadata(&mut file)?;
        let mut index = Index {
            known: topics(attached.facts()).into_keys().collect(),
            attached,
            ..Index::default()
        };
        walk(&mut file, &mut |record, place| index.meet(record, place))?;
        let attached = index.attached.whole()?;
        index.entries.sort_by_key(|entry| entry.at_us);
        Ok(Self {
            messages: PlacedMessages::new(file, index.chunks),
            attached,
            topics: index.topics,
            entries: index.entries,
        })
    }

    /// Its metadata.
    pub fn attached(&self) -> &Attached {
        &self.attached
    }

    /// Times of the first and the last message, microseconds of Unix time; `None` without any.
    pub fn span_us(&self) -> Option<[i64; 2]> {
        Some([self.entries.first()?.at_us, self.entries.last()?.at_us])
    }

    /// Calls `visit` for every message in `times_us`, in order: key, bytes, time.
    ///
    /// # Errors
    /// If the file cannot be read any more; earlier calls are valid.
    pub fn read(
        &mut self,
        times_us: Range<i64>,
        visit: &mut dyn FnMut(&str, &[u8], i64),
    ) -> Result<(), RecordingError> {
        let place = |at_us| self.entries.partition_point(|entry| entry.at_us < at_us);
        let (from, to) = (place(times_us.start), place(times_us.end));
        for entry in self.entries.get(from..to).unwrap_or_default() {
            let bytes = self.messages.bytes(entry.position)?;
            if let Some(topic) = self.topics.get(usize::from(entry.topic)) {
                visit(topic, &bytes, entry.at_us);
            }
        }
        Ok(())
    }
}

/// Data collected while reading.
#[derive(Default)]
struct Index {
    attached: Attached,
    /// The keys of the recording's venue.
    known: Vec<String>,
    topics: Vec<String>,
    /// Number of the topic, by the number of the channel.
    channels: BTreeMap<u16, u16>,
    chunks: ChunkNumbers,
    entries: Vec<Entry>,
}

impl Index {
    fn meet(&mut self, record: Record<'_>, place: RecordPlace) {
        match record {
            Record::Header(header) => self.attached.header(header.profile),
            Record::Attachment { header, data, .. } => {
                self.attached.attachment(header, data.into_owned());
            }
            Record::Channel(channel) if self.known.contains(&channel.topic) => {
                let known = self.topics.iter().position(|topic| *topic == channel.topic);
                let number = known.unwrap_or_else(|| {
                    self.topics.push(channel.topic);
                    self.topics.len() - 1
                });
                if let Ok(number) = u16::try_from(number) {
                    self.channels.insert(channel.id, number);
                }
            }
            Record::Message { header, data } => {
                if let Some(&topic) = self.channels.get(&header.channel_id)
                    && let Some(position) = self.chunks.position(place, &data)
                {
                    self.entries.push(Entry {
                        at_us: (header.log_time / 1000).cast_signed(),
                        topic,
                        position,
                    });
                }
            }
            _ => {}
        }
    }
}
