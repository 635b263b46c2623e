//! Writes a recording: its head first, then messages in chunks, each readable once it is finished.

use std::collections::BTreeMap;
use std::io::{self, Write};

use farfield_proto::message::fill::SetKind;
use farfield_proto::message::{BoxSet, PatchSet, PoseSet};
use farfield_proto::wire;
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{Attachment, McapError, WriteOptions};

use super::channels::{Channel, Content, channels};
use super::{FACTS, PROFILE, WIRE_ENCODING, poses_json};
use crate::export::Layout;

/// Size at which a chunk is finished, at any age.
const CHUNK_BYTES: u64 = 4 << 20;

/// Metadata of a recording before the first message.
#[derive(Debug, Clone, PartialEq)]
pub struct Head {
    /// The venue's name: the first part of every topic.
    pub venue: String,
    /// The viewpoints' names, in the venue's order.
    pub viewpoints: Vec<String>,
    /// Ticks per second.
    pub rate_hz: f64,
    /// Unix time of the start, nanoseconds.
    pub started_ns: u64,
    /// Files to attach, by name.
    pub files: Vec<(String, Vec<u8>)>,
    /// Versions, fingerprints, recorder.
    pub facts: BTreeMap<String, String>,
    /// Names of a pose's numbers; `None`: poses are not recorded as JSON.
    pub json_poses: Option<Layout>,
}

/// One recorded message.
#[derive(Debug, Clone, Copy)]
pub struct PassedMessage<'a> {
    /// Its key, or the topic of a filled set.
    pub topic: &'a str,
    /// The original bytes.
    pub bytes: &'a [u8],
    /// Time of arrival or sending: Unix time, nanoseconds.
    pub log_ns: u64,
}

/// An open channel.
struct Open {
    id: u16,
    content: Content,
    sequence: u32,
}

/// A growing recording.
pub struct RecordingWriter<W: Write> {
    file: mcap::Writer<NoSeek<W>>,
    open: BTreeMap<String, Open>,
    json_topic: String,
    json_poses: Option<Layout>,
    rate_hz: f64,
    /// Unix time of tick 0, microseconds, from the first box set.
    epoch_us: Option<u64>,
    /// Whether a chunk is begun.
    unfinished: bool,
}

impl<W: Write> RecordingWriter<W> {
    /// Begins a recording in `sink`, which is written only sequentially.
    ///
    /// # Errors
    /// Those of `sink`.
    pub fn create(sink: W, head: Head) -> io::Result<Self> {
        let options = WriteOptions::new()
            .profile(PROFILE)
            .library(format!(
                "farfield {} with {}",
                env!("CARGO_PKG_VERSION"),
                mcap::LIBRARY_IDENTIFIER
            ))
            .compression(None)
            .chunk_size(Some(CHUNK_BYTES))
            // A chunk is written when it is complete: so a torn file is torn between records.
            .disable_seeking(true);
        let mut file = options.create(NoSeek::new(sink)).map_err(io_error)?;
        file.write_metadata(&Metadata {
            name: FACTS.to_owned(),
            metadata: head.facts,
        })
        .map_err(io_error)?;
        for (name, data) in head.files {
            file.attach(&Attachment {
                log_time: head.started_ns,
                create_time: head.started_ns,
                name,
                media_type: "application/toml".to_owned(),
                data: data.into(),
            })
            .map_err(io_error)?;
        }
        let schema = file
            .add_schema(
                poses_json::SCHEMA_NAME,
                "jsonschema",
                poses_json::SCHEMA.as_bytes(),
            )
            .map_err(io_error)?;
        let viewpoints: Vec<&str> = head.viewpoints.iter().map(String::as_str).collect();
        let (mut open, mut json_topic) = (BTreeMap::new(), String::new());
        for Channel { topic, content } in channels(&head.venue, &viewpoints) {
            let (schema, encoding) = match content {
                Content::JsonPoses => (schema, "json"),
                Content::Presence | Content::Recorder | Content::Expected => (0, "json"),
                _ => (0, WIRE_ENCODING),
            };
            let id = file
                .add_channel(schema, &topic, encoding, &BTreeMap::new())
                .map_err(io_error)?;
            if content == Content::JsonPoses {
                json_topic.clone_from(&topic);
            }
            let channel = Open {
                id,
                content,
                sequence: 0,
            };
            open.insert(topic, channel);
        }
        let mut this = Self {
            file,
            open,
            json_topic,
            json_poses: head.json_poses,
            rate_hz: head.rate_hz,
            epoch_us: None,
            unfinished: true,
        };
        this.flush()?;
        Ok(this)
    }

    /// Adds a message, and returns its content; `None` if its topic does not belong to the
    /// recording.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn write(&mut self, passed: &PassedMessage<'_>) -> io::Result<Option<Content>> {
        let Some(content) = self.open.get(passed.topic).map(|open| open.content) else {
            return Ok(None);
        };
        if content == Content::Boxes && self.epoch_us.is_none() {
            let boxes = wire::decode::<BoxSet>(passed.bytes);
            self.epoch_us = boxes.ok().and_then(|set| Some(set.live?.epoch_us));
        }
        let sent_ns = self.sent_ns(content, passed.bytes);
        self.put(
            passed.topic,
            passed.bytes,
            passed.log_ns,
            sent_ns.unwrap_or(passed.log_ns),
        )?;
        if let (Content::Poses, Some(layout)) = (content, &self.json_poses)
            && let Ok(poses) = wire::decode::<PoseSet>(passed.bytes)
        {
            let json = poses_json::to_json(&poses, layout);
            let topic = std::mem::take(&mut self.json_topic);
            let put = self.put(&topic, &json, passed.log_ns, passed.log_ns);
            self.json_topic = topic;
            put?;
        }
        Ok(Some(content))
    }

    /// Finishes the chunk, so that everything so far stays readable.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn flush(&mut self) -> io::Result<()> {
        if std::mem::take(&mut self.unfinished) {
            self.file.flush().map_err(io_error)?;
        }
        Ok(())
    }

    /// Writes index and end.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn finish(mut self) -> io::Result<W> {
        self.file.finish().map_err(io_error)?;
        let mut sink = self.file.into_inner().into_inner();
        sink.flush()?;
        Ok(sink)
    }

    fn put(&mut self, topic: &str, bytes: &[u8], log_ns: u64, sent_ns: u64) -> io::Result<()> {
        let Some(open) = self.open.get_mut(topic) else {
            return Ok(());
        };
        let header = MessageHeader {
            channel_id: open.id,
            sequence: open.sequence,
            log_time: log_ns,
            publish_time: sent_ns,
        };
        open.sequence = open.sequence.wrapping_add(1);
        self.unfinished = true;
        self.file
            .write_to_known_channel(&header, bytes)
            .map_err(io_error)
    }

    /// The sender's time of sending, Unix time.
    fn sent_ns(&self, content: Content, bytes: &[u8]) -> Option<u64> {
        let is_patches = matches!(
            content,
            Content::Sets(SetKind::Patches) | Content::Filled(SetKind::Patches)
        );
        let epoch_us = self.epoch_us.filter(|_| is_patches)?;
        let set = wire::decode::<PatchSet>(bytes).ok()?;
        let after_us = i64::from(set.timing?.sent_after_us);
        let tick_us = (set.tick.seconds(self.rate_hz) * 1e6) as i64;
        let us = i64::try_from(epoch_us).ok()?.checked_add(tick_us)?;
        u64::try_from(us.checked_add(after_us)?)
            .ok()?
            .checked_mul(1000)
    }
}

fn io_error(error: McapError) -> io::Error {
    match error {
        McapError::Io(error) => error,
        other => io::Error::other(other),
    }
}
