//! MCAP: the messages of a run in one file, one moment at a time, in constant memory.

use std::collections::BTreeMap;
use std::io::{self, Write};

use ::mcap::records::MessageHeader;
use ::mcap::write::NoSeek;
use ::mcap::{McapError, WriteOptions, Writer};
use farfield_proto::camera::CameraModel;

use super::{
    Body, CAMERA_FRAMES_TOPIC, Content, FRAMES_TOPIC, PEOPLE_TOPIC, Stamp, angles, angles_topic,
    calibration_topic, camera_calibration, camera_frames, people, person_frames,
};

/// Size at which a chunk is finished, bytes; readers load a chunk at once.
const CHUNK_BYTES: u64 = 1 << 20;
/// Minimum lifetime of a drawn person that is not updated, seconds and frames.
const LIFETIME_S: f64 = 1.0;
const LIFETIME_FRAMES: f64 = 2.0;

/// Writes poses as an MCAP file for Foxglove.
pub struct FoxgloveWriter<W: Write> {
    file: Writer<NoSeek<W>>,
    people: Open,
    frames: Open,
    angles: BTreeMap<u32, Open>,
    /// People present at the previous moment.
    present: Vec<u32>,
    lifetime_s: f64,
}

/// An open channel.
#[derive(Debug)]
struct Open {
    id: u16,
    sequence: u32,
}

impl<W: Write> FoxgloveWriter<W> {
    /// Starts the file with the frames of these people at `rate_hz`, the first at `start`;
    /// `cameras` are written once, at `start`.
    ///
    /// # Errors
    /// Errors of `out`; more people than a file has channels.
    pub fn new<'a>(
        out: W,
        persons: impl IntoIterator<Item = u32>,
        cameras: impl IntoIterator<Item = &'a CameraModel>,
        rate_hz: f64,
        start: Stamp,
    ) -> io::Result<Self> {
        let options = WriteOptions::new()
            .library(concat!("farfield ", env!("CARGO_PKG_VERSION")))
            .compression(None)
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true);
        let mut file = options.create(NoSeek::new(out)).map_err(io_error)?;
        let people = open(&mut file, PEOPLE_TOPIC, Content::People)?;
        let frames = open(&mut file, FRAMES_TOPIC, Content::Frames)?;
        let mut by_person = BTreeMap::new();
        for person in persons {
            let channel = open(&mut file, &angles_topic(person), Content::Angles)?;
            by_person.insert(person, channel);
        }
        let cameras: Vec<&CameraModel> = cameras.into_iter().collect();
        if !cameras.is_empty() {
            let mut channel = open(&mut file, CAMERA_FRAMES_TOPIC, Content::Frames)?;
            let message = camera_frames(start, cameras.iter().copied());
            put(&mut file, &mut channel, start, &message)?;
        }
        for camera in cameras {
            let topic = calibration_topic(camera.name());
            let mut channel = open(&mut file, &topic, Content::Calibration)?;
            let message = camera_calibration(start, camera);
            put(&mut file, &mut channel, start, &message)?;
        }
        Ok(Self {
            file,
            people,
            frames,
            angles: by_person,
            present: Vec::new(),
            lifetime_s: LIFETIME_S.max(LIFETIME_FRAMES / rate_hz),
        })
    }

    /// Writes a moment, later than the previous one, with all present people.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn moment(&mut self, stamp: Stamp, tick: i64, bodies: &[Body<'_>]) -> io::Result<()> {
        let present: Vec<u32> = bodies.iter().map(|body| body.id).collect();
        let before = std::mem::replace(&mut self.present, present);
        let gone: Vec<u32> = before
            .into_iter()
            .filter(|id| !self.present.contains(id))
            .collect();
        if bodies.is_empty() && gone.is_empty() {
            return Ok(());
        }
        let scene = people(stamp, bodies, &gone, self.lifetime_s);
        put(&mut self.file, &mut self.people, stamp, &scene)?;
        let frames = person_frames(stamp, bodies);
        put(&mut self.file, &mut self.frames, stamp, &frames)?;
        for body in bodies {
            if let Some(channel) = self.angles.get_mut(&body.id) {
                put(&mut self.file, channel, stamp, &angles(tick, body))?;
            }
        }
        Ok(())
    }

    /// Writes the index and the end.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn finish(mut self) -> io::Result<()> {
        self.file.finish().map_err(io_error)?;
        self.file.into_inner().into_inner().flush()
    }
}

fn open<W: Write>(file: &mut Writer<NoSeek<W>>, topic: &str, content: Content) -> io::Result<Open> {
    let schema = content.schema();
    // Equal schemas get the same id.
    let schema = file.add_schema(&schema.name, &schema.encoding, &schema.data);
    let schema = schema.map_err(io_error)?;
    let id = file.add_channel(schema, topic, content.encoding(), &BTreeMap::new());
    Ok(Open {
        id: id.map_err(io_error)?,
        sequence: 0,
    })
}

fn put<W: Write>(
    file: &mut Writer<NoSeek<W>>,
    channel: &mut Open,
    stamp: Stamp,
    message: &[u8],
) -> io::Result<()> {
    let header = MessageHeader {
        channel_id: channel.id,
        sequence: channel.sequence,
        log_time: stamp.nanos,
        publish_time: stamp.nanos,
    };
    channel.sequence = channel.sequence.wrapping_add(1);
    file.write_to_known_channel(&header, message)
        .map_err(io_error)
}

fn io_error(error: McapError) -> io::Error {
    match error {
        McapError::Io(error) => error,
        other => io::Error::other(other),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::fixture::{line_at, sample_at};
    use crate::skeleton::{Bone, RestPose};

    /// Topics, times in nanoseconds and schemas of the messages in a file.
    fn read(bytes: &[u8]) -> Vec<(String, u64, String)> {
        let messages = ::mcap::MessageStream::new(bytes).unwrap();
        let read = messages.map(|message| {
            let message = message.unwrap();
            let schema = message.channel.schema.as_ref().unwrap().name.clone();
            (message.channel.topic.clone(), message.log_time, schema)
        });
        read.collect()
    }

    #[test]
    fn people_who_leave_are_deleted_once() {
        let (sample, line) = (sample_at(0.5), line_at(4, 30));
        let joints_m = sample.joints_m(RestPose::TPose);
        let body = Body {
            id: 4,
            name: "Ada",
            state: sample.state,
            views: sample.views,
            joints_m: &joints_m,
            pelvis: &sample.motion.rotations[Bone::Hips.index()],
            angles: &line.angles,
            unobserved: 0,
        };
        let mut bytes = Vec::new();
        let mut writer =
            FoxgloveWriter::new(&mut bytes, [4], [], 60.0, Stamp::from_seconds(0.0)).unwrap();
        for (tick, bodies) in (0..).zip([&[body][..], &[body], &[], &[], &[body]]) {
            let stamp = Stamp::from_seconds(tick as f64);
            writer.moment(stamp, tick, bodies).unwrap();
        }
        writer.finish().unwrap();
        let read = read(&bytes);
        let times = |topic: &str| {
            let matching = read.iter().filter(|(found, ..)| found == topic);
            matching
                .map(|(_, time, _)| time / 1_000_000_000)
                .collect::<Vec<_>>()
        };
        assert_eq!(times(PEOPLE_TOPIC), [0, 1, 2, 4]);
        assert_eq!(times("/person_4/angles"), [0, 1, 4]);
        let schemas: BTreeSet<&str> = read.iter().map(|(.., schema)| schema.as_str()).collect();
        let expected = [
            "farfield.Angles",
            "foxglove.FrameTransforms",
            "foxglove.SceneUpdate",
        ];
        assert_eq!(schemas, expected.into());
    }
}
