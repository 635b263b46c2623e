//! The BVH file: a tree of bones with Euler channels, and their values frame by frame.
//!
//! The parser accepts any order of channels, three or six channels on any bone, tabs, CRLF, and
//! names with spaces. A bone's rotation is the product of its rotation channels in file order.
//! Position channels of the root are added to its offset. Position channels of other bones replace
//! the offset or are added to it, because programs write both; the parser takes the reading that
//! keeps the bone nearer to its offset in the first frame.
//!
//! Numbers in a file never cause a large allocation: counts are checked against the actual content,
//! and [`MAX_BONES`] limits the tree.

use std::path::Path;

use farfield_proto::toml_file::FileError;
use nalgebra::{UnitQuaternion, Vector3};

/// More bones than any skeleton of a person, including face and fingers.
pub const MAX_BONES: usize = 1000;

/// Larger values are no coordinate or angle in any unit.
const MAX_VALUE: f64 = 1e9;

/// Range of plausible frame times, seconds.
const FRAME_TIMES_S: [f64; 2] = [1e-5, 10.0];

/// The effect of one number of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BvhChannel {
    /// Moves along an axis (0 to 2), file units.
    Position(usize),
    /// Turns about an axis (0 to 2), degrees.
    Rotation(usize),
}

/// A bone. Its origin is the joint with its parent.
#[derive(Debug, Clone, PartialEq)]
pub struct Bone {
    /// Name in the file.
    pub name: String,
    /// Index of the parent, always below its own; `None` for the root.
    pub parent: Option<usize>,
    /// Offset from the parent's origin, in the parent's axes, file units.
    pub offset: Vector3<f64>,
    /// Its end site, in its own axes, file units.
    pub end: Option<Vector3<f64>>,
    /// Its channels, in the order of the numbers in a frame.
    pub channels: Vec<BvhChannel>,
    /// Index of its first number in a frame.
    first_value: usize,
    /// Whether its positions replace the offset.
    replaces_offset: bool,
}

/// A whole file; not empty, all numbers are finite.
#[derive(Debug, Clone, PartialEq)]
pub struct Bvh {
    /// Parents before children.
    pub bones: Vec<Bone>,
    /// Seconds between two frames.
    pub frame_time_s: f64,
    /// Numbers of all frames, one frame after the other.
    values: Vec<f64>,
    n_channels: usize,
}

/// Pose of a bone: its origin and its axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedBone {
    /// The origin, file units.
    pub origin: Vector3<f64>,
    /// Rotation from the bone's axes.
    pub rotation: UnitQuaternion<f64>,
}

impl Bvh {
    /// Parses `text`; errors name `path`.
    ///
    /// # Errors
    /// [`FileError`] with line, found and expected text.
    pub fn parse(text: &str, path: &Path) -> Result<Self, FileError> {
        let mut reader = BvhReader::new(text, path);
        let bones = reader.hierarchy()?;
        let n_channels = bones.iter().map(|bone| bone.channels.len()).sum();
        let (frame_time_s, values) = reader.motion(n_channels)?;
        let mut bvh = Self {
            bones,
            frame_time_s,
            values,
            n_channels,
        };
        bvh.decide_offsets();
        Ok(bvh)
    }

    /// Number of frames; above zero.
    pub fn n_frames(&self) -> usize {
        self.values.len() / self.n_channels
    }

    /// The pose of `bone` in its parent's axes in `frame`, file units.
    pub fn local(&self, frame: usize, bone: usize) -> PlacedBone {
        let bone = &self.bones[bone];
        let mut origin = bone.offset;
        let mut rotation = UnitQuaternion::identity();
        let start = frame * self.n_channels + bone.first_value;
        for (channel, value) in bone.channels.iter().zip(&self.values[start..]) {
            match *channel {
                BvhChannel::Position(axis) if bone.replaces_offset => origin[axis] = *value,
                BvhChannel::Position(axis) => origin[axis] += *value,
                BvhChannel::Rotation(axis) => {
                    let axis = Vector3::ith_axis(axis);
                    rotation *= UnitQuaternion::from_axis_angle(&axis, value.to_radians());
                }
            }
        }
        PlacedBone { origin, rotation }
    }

    /// The pose of every bone in `frame`, in the file's axes and units.
    pub fn placed(&self, frame: usize) -> Vec<PlacedBone> {
        let mut placed: Vec<PlacedBone> = Vec::with_capacity(self.bones.len());
        for (i, bone) in self.bones.iter().enumerate() {
            let local = self.local(frame, i);
            placed.push(match bone.parent {
                None => local,
                Some(parent) => placed[parent].then(&local),
            });
        }
        placed
    }

    fn decide_offsets(&mut self) {
        let frame = &self.values[..self.n_channels];
        for bone in self.bones.iter_mut().filter(|bone| bone.parent.is_some()) {
            let mut position = Vector3::zeros();
            let mut moved_offset = Vector3::zeros();
            for (channel, value) in bone.channels.iter().zip(&frame[bone.first_value..]) {
                if let BvhChannel::Position(axis) = *channel {
                    position[axis] = *value;
                    moved_offset[axis] = bone.offset[axis];
                }
            }
            bone.replaces_offset = (position - moved_offset).norm() < position.norm();
        }
    }
}

impl PlacedBone {
    /// Composes with a pose that is relative to this one.
    #[must_use]
    pub fn then(&self, inner: &Self) -> Self {
        Self {
            origin: self.at(inner.origin),
            rotation: self.rotation * inner.rotation,
        }
    }

    /// Transforms a point from these axes to the outer axes.
    pub fn at(&self, point: Vector3<f64>) -> Vector3<f64> {
        self.origin + self.rotation * point
    }

    /// Transforms a point from the outer axes to these axes.
    pub fn inside(&self, point: Vector3<f64>) -> Vector3<f64> {
        self.rotation.inverse() * (point - self.origin)
    }
}

/// The non-blank lines with their numbers, and the remaining words of the current line.
struct BvhReader<'a> {
    path: &'a Path,
    lines: std::iter::Enumerate<std::str::Lines<'a>>,
    line: usize,
    words: Vec<&'a str>,
}

impl<'a> BvhReader<'a> {
    fn new(text: &'a str, path: &'a Path) -> Self {
        Self {
            path,
            lines: text.lines().enumerate(),
            line: 0,
            words: Vec::new(),
        }
    }

    fn refuse(&self, found: &str, expected: &str) -> FileError {
        let found: String = found.chars().take(40).collect();
        let problem = format!("found {found}, expected {expected}");
        FileError::new(self.path, problem).at_line(self.line)
    }

    /// Advances to the next non-blank line. Its words are in reverse order, the next one last.
    fn next_line(&mut self) -> bool {
        for (i, line) in self.lines.by_ref() {
            self.line = i + 1;
            self.words.clear();
            self.words.extend(line.split_whitespace().rev());
            if !self.words.is_empty() {
                return true;
            }
        }
        false
    }

    fn word(&mut self, expected: &str) -> Result<&'a str, FileError> {
        if self.words.is_empty() && !self.next_line() {
            return Err(self.refuse("the end of the file", expected));
        }
        let word = self.words.pop();
        word.ok_or_else(|| self.refuse("nothing", expected))
    }

    fn keyword(&mut self, keyword: &str) -> Result<(), FileError> {
        let expected = format!("`{keyword}`");
        let word = self.word(&expected)?;
        if word.eq_ignore_ascii_case(keyword) {
            return Ok(());
        }
        Err(self.refuse(&format!("`{word}`"), &expected))
    }

    fn number(&mut self, expected: &str) -> Result<f64, FileError> {
        let word = self.word(expected)?;
        self.as_number(word, expected)
    }

    fn as_number(&self, word: &str, expected: &str) -> Result<f64, FileError> {
        let number = word.parse::<f64>().ok();
        number
            .filter(|x| x.abs() <= MAX_VALUE)
            .ok_or_else(|| self.refuse(&format!("`{word}`"), expected))
    }

    fn vector(&mut self) -> Result<Vector3<f64>, FileError> {
        let mut vector = Vector3::zeros();
        for axis in 0..3 {
            vector[axis] = self.number("a length of an offset")?;
        }
        Ok(vector)
    }

    /// The rest of the line up to a brace; names may contain spaces.
    fn name(&mut self) -> String {
        let mut name = String::new();
        while self.words.last().is_some_and(|word| *word != "{") {
            if !name.is_empty() {
                name.push(' ');
            }
            name.push_str(self.words.pop().unwrap_or_default());
        }
        name
    }

    fn hierarchy(&mut self) -> Result<Vec<Bone>, FileError> {
        self.keyword("HIERARCHY")?;
        self.keyword("ROOT")?;
        let mut bones = Vec::new();
        let mut n_channels = 0;
        let mut open = vec![self.bone(&mut bones, None, &mut n_channels)?];
        let expected = "`JOINT`, `End Site` or `}`";
        while let Some(&around) = open.last() {
            let word = self.word(expected)?;
            if word == "}" {
                open.pop();
            } else if word.eq_ignore_ascii_case("JOINT") {
                open.push(self.bone(&mut bones, Some(around), &mut n_channels)?);
            } else if word.eq_ignore_ascii_case("End") {
                self.keyword("Site")?;
                self.keyword("{")?;
                self.keyword("OFFSET")?;
                bones[around].end = Some(self.vector()?);
                self.keyword("}")?;
            } else {
                return Err(self.refuse(&format!("`{word}`"), expected));
            }
        }
        if n_channels == 0 {
            return Err(self.refuse("no channels", "at least one"));
        }
        Ok(bones)
    }

    /// Parses the head of a bone, from its name to its channels, and appends it to `bones`.
    fn bone(
        &mut self,
        bones: &mut Vec<Bone>,
        parent: Option<usize>,
        n_channels: &mut usize,
    ) -> Result<usize, FileError> {
        if bones.len() == MAX_BONES {
            let expected = format!("at most {MAX_BONES} bones");
            return Err(self.refuse("one more", &expected));
        }
        let name = self.name();
        self.keyword("{")?;
        self.keyword("OFFSET")?;
        let offset = self.vector()?;
        self.keyword("CHANNELS")?;
        let channels = self.channels()?;
        let first_value = *n_channels;
        *n_channels += channels.len();
        bones.push(Bone {
            name,
            parent,
            offset,
            end: None,
            channels,
            first_value,
            replaces_offset: false,
        });
        Ok(bones.len() - 1)
    }

    fn channels(&mut self) -> Result<Vec<BvhChannel>, FileError> {
        let expected = "a number of channels from 0 to 6";
        let word = self.word(expected)?;
        let count = word.parse::<usize>().ok().filter(|count| *count <= 6);
        let count = count.ok_or_else(|| self.refuse(&format!("`{word}`"), expected))?;
        let mut channels = Vec::with_capacity(count);
        for _ in 0..count {
            let expected = "a channel, as `Xposition` or `Zrotation`, each once";
            let word = self.word(expected)?;
            let channel = channel(word).filter(|channel| !channels.contains(channel));
            channels.push(channel.ok_or_else(|| self.refuse(&format!("`{word}`"), expected))?);
        }
        Ok(channels)
    }

    fn motion(&mut self, n_channels: usize) -> Result<(f64, Vec<f64>), FileError> {
        self.keyword("MOTION")?;
        self.keyword("Frames:")?;
        let expected = "a number of frames above 0";
        let word = self.word(expected)?;
        let n_frames = word.parse::<usize>().ok().filter(|n| *n > 0);
        let n_frames = n_frames.ok_or_else(|| self.refuse(&format!("`{word}`"), expected))?;
        self.keyword("Frame")?;
        self.keyword("Time:")?;
        let [least, most] = FRAME_TIMES_S;
        let expected = "seconds between two frames, from 0.00001 to 10";
        let word = self.word(expected)?;
        let frame_time_s = self.as_number(word, expected)?;
        if !(least..=most).contains(&frame_time_s) {
            return Err(self.refuse(&format!("`{word}`"), expected));
        }
        let mut values = Vec::new();
        let mut found = 0;
        while self.next_line() {
            found += 1;
            if found > n_frames {
                return Err(self.refuse("one more frame", &format!("{n_frames} frames")));
            }
            if self.words.len() != n_channels {
                let found = format!("{} values", self.words.len());
                return Err(self.refuse(&found, &format!("{n_channels}, one for each channel")));
            }
            while let Some(word) = self.words.pop() {
                values.push(self.as_number(word, "a number")?);
            }
        }
        if found < n_frames {
            return Err(self.refuse(&format!("{found} frames"), &format!("{n_frames}")));
        }
        Ok((frame_time_s, values))
    }
}

fn channel(word: &str) -> Option<BvhChannel> {
    let (axis, kind) = word.split_at_checked(1)?;
    let axis = match axis {
        "X" | "x" => 0,
        "Y" | "y" => 1,
        "Z" | "z" => 2,
        _ => return None,
    };
    match kind.to_ascii_lowercase().as_str() {
        "position" => Some(BvhChannel::Position(axis)),
        "rotation" => Some(BvhChannel::Rotation(axis)),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
