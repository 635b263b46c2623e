//! glTF 2.0: all people in one file, each a skeleton with a skinned stick body, and one animation.
//!
//! Metres, y up, facing +z, independent of the preset, since the format allows nothing else. Rest
//! rotations are the identity and rest scales 1; quaternions have consistent signs from key to key.
//! Time 0 is the first exported tick; `start_s` in a person's `extras` is its time since the run's
//! first tick. While a person is absent there are no keys except the one that holds the last pose
//! to the end of the gap. The person's `extras` list absent and filled times.
//!
//! The format stores every track in one piece, so all keys stay in memory until the end: about 300
//! bytes per frame and person.

mod bytes;
mod keys;
mod stick_body;

use std::io::{self, Write};

use base64::Engine as _;
use gltf_json as json;
use json::validation::Checked::Valid;
use nalgebra::Vector3;

use self::bytes::{Bytes, Shape};
use self::keys::Keys;
use crate::axes::{Axes, Orientation, Unit};
use crate::options::Lengths;
use crate::skeleton::{Bone, Rig};
use crate::subject::Subject;
use crate::timeline::Frame;

/// Metres, y up.
const AXES: Axes = Axes {
    unit: Unit::Metre,
    orientation: Orientation::YUp,
};
/// First word of a binary file: "glTF".
const MAGIC: u32 = 0x4654_6C67;
/// Its chunks: JSON, and the buffer.
const CHUNK_JSON: u32 = 0x4E4F_534A;
const CHUNK_BIN: u32 = 0x004E_4942;

/// Container of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Container {
    /// One binary file.
    Binary,
    /// JSON with embedded data.
    Json,
}

/// Collects all people.
#[derive(Debug)]
pub struct GltfWriter {
    root: json::Root,
    bytes: Bytes,
    animation: json::Animation,
    scene: Vec<json::Index<json::Node>>,
}

/// Collects one person's frames.
#[derive(Debug)]
pub struct GltfPerson<'a> {
    subject: Subject<'a>,
    keys: Keys,
}

impl<'a> GltfPerson<'a> {
    /// A person without frames.
    pub fn new(subject: Subject<'a>) -> Self {
        Self {
            subject,
            keys: Keys::new(subject.options.lengths),
        }
    }

    /// Adds a frame.
    pub fn frame(&mut self, frame: &Frame) {
        self.keys.push(frame, &self.subject);
    }
}

impl Default for GltfWriter {
    fn default() -> Self {
        let asset = json::Asset {
            generator: Some(format!("Farfield {}", env!("CARGO_PKG_VERSION"))),
            ..json::Asset::default()
        };
        Self {
            root: json::Root {
                asset,
                ..json::Root::default()
            },
            bytes: Bytes::default(),
            animation: json::Animation {
                extensions: None,
                extras: None,
                channels: Vec::new(),
                name: Some("motion".to_owned()),
                samplers: Vec::new(),
            },
            scene: Vec::new(),
        }
    }
}

impl GltfWriter {
    /// Adds a person with all frames.
    ///
    /// # Errors
    /// If two times are equal as f32, which happens days after the first frame.
    pub fn add(&mut self, person: GltfPerson<'_>) -> io::Result<()> {
        let GltfPerson { subject, keys } = person;
        let rig = subject.rig();
        let hips_m = Vector3::new(0.0, 0.0, subject.survey.offsets.pelvis_height_m());
        let joints = self.push_bones(&rig, &hips_m, &subject);
        let armature = self.root.push(json::Node {
            name: Some(format!("person_{}", subject.name)),
            children: joints.first().map(|hips| vec![*hips]),
            extras: extras(&subject, &keys)?,
            ..json::Node::default()
        });
        let skin = self.push_skin(&rig, &hips_m, &joints, armature, subject.name);
        let mesh = stick_body::push(&mut self.root, &mut self.bytes, &rig, &hips_m, subject.name);
        // At the scene's root: parent nodes do not move a skinned mesh, and readers warn about
        // them.
        let body = self.root.push(json::Node {
            name: Some(format!("body_{}", subject.name)),
            mesh: Some(mesh),
            skin: Some(skin),
            ..json::Node::default()
        });
        self.scene.extend([armature, body]);
        keys.push_channels(
            &mut self.root,
            &mut self.bytes,
            &mut self.animation,
            &joints,
        )
    }

    /// Nodes of all bones, in order.
    fn push_bones(
        &mut self,
        rig: &Rig,
        hips_m: &Vector3<f64>,
        subject: &Subject<'_>,
    ) -> Vec<json::Index<json::Node>> {
        let first = self.root.nodes.len() as u32;
        let index = |bone: Bone| json::Index::new(first + bone.index() as u32);
        for bone in Bone::ALL {
            let at_m = if bone == Bone::Hips {
                *hips_m
            } else {
                rig.offset_m[bone.index()]
            };
            let children: Vec<_> = bone.children().map(index).collect();
            self.root.push(json::Node {
                name: Some(subject.options.names.name(bone).to_owned()),
                translation: Some(single(&at_m)),
                children: (!children.is_empty()).then_some(children),
                ..json::Node::default()
            });
        }
        Bone::ALL.map(index).to_vec()
    }

    fn push_skin(
        &mut self,
        rig: &Rig,
        hips_m: &Vector3<f64>,
        joints: &[json::Index<json::Node>],
        armature: json::Index<json::Node>,
        name: &str,
    ) -> json::Index<json::Skin> {
        // Bones have no rest rotation, so the inverse of their rest is a translation. Matrices are
        // stored by column.
        let heads_m = rig.rest_heads_m();
        let inverse = heads_m.iter().flat_map(|head_m| {
            let [x, y, z] = single(&-(head_m + hips_m));
            [
                1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, x, y, z, 1.0,
            ]
        });
        let inverse: Vec<f32> = inverse.collect();
        let matrices = self
            .bytes
            .push_floats(&mut self.root, &inverse, Shape::Mat4);
        self.root.push(json::Skin {
            extensions: None,
            extras: None,
            inverse_bind_matrices: Some(matrices),
            joints: joints.to_vec(),
            name: Some(format!("skin_{name}")),
            skeleton: Some(armature),
        })
    }

    /// Writes the file.
    ///
    /// # Errors
    /// Errors of `out`, and more than 4 GiB, the limit of the format.
    pub fn finish(mut self, mut out: impl Write, container: Container) -> io::Result<()> {
        let scene = self.root.push(json::Scene {
            extensions: None,
            extras: None,
            name: None,
            nodes: self.scene,
        });
        self.root.scene = Some(scene);
        if !self.animation.channels.is_empty() {
            self.root.push(self.animation);
        }
        let data = self.bytes.into_data();
        let uri = match container {
            Container::Binary => None,
            Container::Json => {
                let text = base64::engine::general_purpose::STANDARD.encode(&data);
                Some(format!("data:application/octet-stream;base64,{text}"))
            }
        };
        self.root.push(json::Buffer {
            byte_length: data.len().into(),
            name: None,
            uri,
            extensions: None,
            extras: None,
        });
        let mut text = json::serialize::to_vec(&self.root)?;
        if container == Container::Json {
            text.push(b'\n');
            return out.write_all(&text);
        }
        text.resize(text.len().next_multiple_of(4), b' ');
        let size = |n: usize| {
            u32::try_from(n).map_err(|_| io::Error::other("a binary glTF file holds at most 4 GiB"))
        };
        let total = size(12 + 8 + text.len() + 8 + data.len())?;
        for word in [MAGIC, 2, total, size(text.len())?, CHUNK_JSON] {
            out.write_all(&word.to_le_bytes())?;
        }
        out.write_all(&text)?;
        for word in [size(data.len())?, CHUNK_BIN] {
            out.write_all(&word.to_le_bytes())?;
        }
        out.write_all(&data)
    }
}

/// Converts a point from metres in our axes to the file's axes.
fn single(ours_m: &Vector3<f64>) -> [f32; 3] {
    // Adding 0 removes the sign of a zero.
    let [x, y, z]: [f64; 3] = AXES.point(ours_m).into();
    [x, y, z].map(|v| v as f32 + 0.0)
}

/// Id, name, and the times when the person is absent or filled.
fn extras(subject: &Subject<'_>, keys: &Keys) -> io::Result<json::Extras> {
    let value = serde_json::json!({
        "person": subject.id,
        "name": subject.name,
        "start_s": subject.clock.seconds(0),
        "constant_lengths": subject.options.lengths == Lengths::Settled,
        "absent_s": keys.absent_s,
        "filled_s": keys.filled_s,
    });
    Ok(Some(serde_json::value::to_raw_value(&value)?))
}

/// Adds a channel of `animation` that moves `node`.
fn push_channel(
    animation: &mut json::Animation,
    node: json::Index<json::Node>,
    path: json::animation::Property,
    input: json::Index<json::Accessor>,
    output: json::Index<json::Accessor>,
) {
    let sampler = json::Index::new(animation.samplers.len() as u32);
    animation.samplers.push(json::animation::Sampler {
        extensions: None,
        extras: None,
        input,
        interpolation: Valid(json::animation::Interpolation::Linear),
        output,
    });
    animation.channels.push(json::animation::Channel {
        sampler,
        target: json::animation::Target {
            extensions: None,
            extras: None,
            node,
            path: Valid(path),
        },
        extensions: None,
        extras: None,
    });
}
