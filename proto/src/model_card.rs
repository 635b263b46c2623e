//! Model cards: TOML files that describe the input and output of a network in the same folder.

mod read;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use self::read::{detector, heatmap, kind_of};
use crate::keypoints::KeypointSet;
use crate::toml_file::{FileError, Place, TomlFile, unknown_name};

/// The two kinds of cards.
#[derive(Debug, Clone, PartialEq)]
pub enum ModelCard {
    /// One person's crop in, part confidence maps out.
    Heatmap(HeatmapCard),
    /// A picture in, boxes of people out.
    Detector(DetectorCard),
}

/// Description of a card for errors about other files.
pub const EXPECTED_CARD: &str = "the network's card, a TOML file next to it (docs/venue.md)";

/// Card of a keypoint network.
#[derive(Debug, Clone, PartialEq)]
pub struct HeatmapCard {
    /// The ONNX file.
    pub file: PathBuf,
    /// The input tensor.
    pub input: NetworkInput,
    /// Conversion of pixels to numbers.
    pub normalize: Normalize,
    /// The output tensor.
    pub output: HeatmapOutput,
    /// Position of cells in the input.
    pub cell_to_input: CellToInput,
    /// The margin around the person in the training of the network, as a factor on the box.
    pub box_margin: f64,
    /// Keypoint sites relative to their joints: metres in the link's axes, by name.
    pub keypoint_offsets: BTreeMap<String, [f64; 3]>,
}

/// Card of a person detector.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectorCard {
    /// The ONNX file.
    pub file: PathBuf,
    /// The input tensor.
    pub input: NetworkInput,
    /// Conversion of pixels to numbers.
    pub normalize: Normalize,
    /// The output tensor.
    pub output: DetectorOutput,
    /// The layout of the output.
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
    /// Placement of a picture with another aspect ratio (detectors).
    pub letterbox: Option<Letterbox>,
    /// Value of the padding (detectors).
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

/// Placement of a picture in an input with another aspect ratio.
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
    /// Subtracted next, per channel, in units of the scaled pixel.
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
    /// Sigma of the peaks in the training of the network, cells; `None`: the default, see
    /// [`Self::peak_sigma_of_width`].
    pub peak_sigma_cells: Option<f64>,
}

/// Default sigma of a peak relative to the width of the maps: 2 cells of 48, 3 of 72.
pub const PEAK_SIGMA_OF_WIDTH: f64 = 1.0 / 24.0;

impl HeatmapOutput {
    /// Sigma of the network's peaks relative to the width of its maps.
    pub fn peak_sigma_of_width(&self) -> f64 {
        let stated = self.peak_sigma_cells;
        stated.map_or(PEAK_SIGMA_OF_WIDTH, |sigma| sigma / f64::from(self.width))
    }
}

/// Position of a cell in the input: input pixel = scale x cell + offset, both axes.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CellToInput {
    /// Input pixels per cell.
    pub scale: f64,
    /// Input pixel of the centre of cell 0.
    pub offset: f64,
}

/// The output of a detector.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DetectorOutput {
    /// Name of the tensor.
    pub name: String,
    /// Index of the class of people.
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
    /// Parses the text of a card. `path` gives the folder of its ONNX file, and errors name it.
    ///
    /// # Errors
    /// [`FileError`] with line and field. The existence of the ONNX file is not checked.
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
    /// Parses the card of a keypoint network, as [`ModelCard::parse`].
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
    /// Parses the card of a detector, as [`ModelCard::parse`].
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
