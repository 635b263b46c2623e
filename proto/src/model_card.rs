//! Model cards: what a network beside it expects and gives, as a TOML file.

mod read;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use self::read::{detector, heatmap, kind_of};
use crate::keypoints::KeypointSet;
use crate::toml_file::{FileError, Place, TomlFile, unknown_name};

/// What kind of network a card describes, and how it is used.
#[derive(Debug, Clone, PartialEq)]
pub enum ModelCard {
    /// One person's crop in, part confidence maps out.
    Heatmap(HeatmapCard),
    /// A picture in, persons' boxes out.
    Detector(DetectorCard),
}

/// What a card is, for whoever has named another file in its place.
pub const EXPECTED_CARD: &str = "the network's card, a TOML file beside it (docs/venue.md)";

/// Card of a keypoint network.
#[derive(Debug, Clone, PartialEq)]
pub struct HeatmapCard {
    /// The ONNX file.
    pub file: PathBuf,
    /// What goes in.
    pub input: NetworkInput,
    /// How pixels become numbers.
    pub normalize: Normalize,
    /// What comes out.
    pub output: HeatmapOutput,
    /// Where cells lie in the input.
    pub cell_to_input: CellToInput,
    /// The margin around the person that the network was trained with, as a factor on the box.
    pub box_margin: f64,
    /// Where keypoints sit on the model, off their joints: metres in the link's axes, by name.
    pub keypoint_offsets: BTreeMap<String, [f64; 3]>,
}

/// Card of a person detector.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectorCard {
    /// The ONNX file.
    pub file: PathBuf,
    /// What goes in.
    pub input: NetworkInput,
    /// How pixels become numbers.
    pub normalize: Normalize,
    /// What comes out.
    pub output: DetectorOutput,
    /// How the output is laid out.
    pub decode: Decode,
}

/// The input tensor: [batch, channel, row, column].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NetworkInput {
    /// Name of the tensor.
    pub name: String,
    /// Columns, pixels.
    pub width: u32,
    /// Rows, pixels.
    pub height: u32,
    /// Order of the colours.
    pub channels: Channels,
    /// Where a picture of another aspect is put (detectors).
    pub letterbox: Option<Letterbox>,
    /// Value of the pixels around it (detectors).
    pub pad: Option<u8>,
}

/// Order of colours in the input tensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Channels {
    /// Red first.
    Rgb,
    /// Blue first.
    Bgr,
}

/// Where a picture lies in an input of another aspect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Letterbox {
    /// At the top left; padding is right and below.
    TopLeft,
    /// In the middle; padding is on both sides.
    Centre,
}

/// value = (pixel x scale - mean) / std, per channel in the order of the tensor.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Normalize {
    /// Factor on the pixel (0 to 255); dimensionless.
    pub scale: f32,
    /// Subtracted then, per channel, in units of the scaled pixel.
    pub mean: [f32; 3],
    /// Divided by last, per channel, in units of the scaled pixel.
    pub std: [f32; 3],
}

/// The maps: [batch, keypoint, row, column].
#[derive(Debug, Clone, PartialEq)]
pub struct HeatmapOutput {
    /// Name of the tensor.
    pub name: String,
    /// Cells in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The maps' keypoints.
    pub keypoints: KeypointSet,
    /// Sigma of the peaks that the network was trained to draw, cells; `None`: as usual, see
    /// [`Self::peak_sigma_of_width`].
    pub peak_sigma_cells: Option<f64>,
}

/// Sigma of a peak as a share of the width of the maps, where no card says it: 2 cells of 48, 3 of 72.
pub const PEAK_SIGMA_OF_WIDTH: f64 = 1.0 / 24.0;

impl HeatmapOutput {
    /// Sigma of the network's peaks, as a share of the width of its maps.
    pub fn peak_sigma_of_width(&self) -> f64 {
        let stated = self.peak_sigma_cells;
        stated.map_or(PEAK_SIGMA_OF_WIDTH, |sigma| sigma / f64::from(self.width))
    }
}

/// Where a cell lies in the input: input pixel = scale x cell + offset, both axes.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CellToInput {
    /// Input pixels per cell.
    pub scale: f64,
    /// Input pixel of the centre of cell 0.
    pub offset: f64,
}

/// What a detector gives.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DetectorOutput {
    /// Name of the tensor.
    pub name: String,
    /// Which of its classes is a person.
    pub person_class: usize,
}

/// Layout of a detector's output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Decode {
    /// Raw grid at strides 8, 16 and 32; score = objectness x class; suppression is ours.
    Yolox,
    /// [n, 5] boxes with score, suppression done inside the network.
    Rtmdet,
}

impl ModelCard {
    /// Reads the text of a card; `path` gives the folder of its ONNX file and is named in errors.
    ///
    /// # Errors
    /// [`FileError`] naming line and field. Whether the ONNX file is there is not looked at.
    pub fn parse(text: &str, path: &Path) -> Result<Self, FileError> {
        let file = TomlFile::parse(text, path)?;
        let kind = kind_of(&file)?;
        match kind.as_str() {
            "heatmap" => heatmap(&file).map(Self::Heatmap),
            "detector" => detector(&file).map(Self::Detector),
            other => Err(file.error(
                &Place::field("kind"),
                unknown_name("kind", other, &["heatmap", "detector"]),
            )),
        }
    }
}

impl HeatmapCard {
    /// Reads the card of a keypoint network, as [`ModelCard::parse`] does.
    ///
    /// # Errors
    /// As [`ModelCard::parse`], and when the card is of another kind.
    pub fn parse(text: &str, path: &Path) -> Result<Self, FileError> {
        match ModelCard::parse(text, path)? {
            ModelCard::Heatmap(card) => Ok(card),
            ModelCard::Detector(_) => Err(wrong_kind(path, "detector", "heatmap")),
        }
    }
}

impl DetectorCard {
    /// Reads the card of a detector, as [`ModelCard::parse`] does.
    ///
    /// # Errors
    /// As [`ModelCard::parse`], and when the card is of another kind.
    pub fn parse(text: &str, path: &Path) -> Result<Self, FileError> {
        match ModelCard::parse(text, path)? {
            ModelCard::Detector(card) => Ok(card),
            ModelCard::Heatmap(_) => Err(wrong_kind(path, "heatmap", "detector")),
        }
    }
}

fn wrong_kind(path: &Path, found: &str, expected: &str) -> FileError {
    FileError::new(path, format!("found \"{found}\", expected \"{expected}\"")).at_field("kind")
}

#[cfg(test)]
mod tests;
