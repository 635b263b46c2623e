//! Model cards: TOML files that describe the input and output of a network in the same folder.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::keypoints::KeypointSet;
use crate::patch::{MAX_KEYPOINTS, MAX_SIDE};
use crate::toml_file::{FileError, Place, TomlFile, unknown_name, unread};

/// The two kinds of cards.
#[derive(Debug, Clone, PartialEq)]
pub enum ModelCard {
    /// One person's crop in, part confidence maps out.
    Heatmap(HeatmapCard),
    /// A picture in, boxes of people out.
    Detector(DetectorCard),
}

/// Description of a card for errors about other files.
const EXPECTED_CARD: &str = "the network's card, a TOML file next to it (docs/venue.md)";

/// Why the card at `path` could not be read, with the remedy for an installed network, whose card
/// is `NAME/NAME.toml`.
pub fn unread_card(error: &io::Error, path: &Path) -> String {
    let name = path.file_stem().and_then(OsStr::to_str);
    let folder = path.parent().and_then(Path::file_name);
    match name.filter(|name| folder == Some(OsStr::new(name))) {
        Some(name) if error.kind() == ErrorKind::NotFound => {
            format!(
                "the network is not installed: `farfield networks install {name}` installs it, if it is a known one (docs/networks.md)"
            )
        }
        _ => unread(error, EXPECTED_CARD),
    }
}

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
    /// Error of keypoints that the network places worse or better than others do, by name: a factor
    /// on the usual one.
    pub relative_sigma: BTreeMap<String, f64>,
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

/// The maps: [batch, keypoint, row, column], or what they are made of.
#[derive(Debug, Clone, PartialEq)]
pub struct HeatmapOutput {
    /// Names of the tensors.
    pub tensors: HeatmapTensors,
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

/// The tensors of a keypoint network.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum HeatmapTensors {
    /// Maps, by name.
    Maps(String),
    /// Two distributions per keypoint, along the columns and along the rows of the input (`SimCC`).
    Simcc(Simcc),
}

/// Distributions of the columns and of the rows of keypoints: [batch, keypoint, bin]. Bin i is
/// the input pixel i / `bins_per_pixel`.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Simcc {
    /// Name of the tensor for columns.
    pub x: String,
    /// Name of the tensor for rows.
    pub y: String,
    /// Bins of an input pixel.
    pub bins_per_pixel: u32,
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

/// Most bins of an input pixel; usual networks have 2.
const MOST_BINS_PER_PIXEL: u32 = 16;
/// Bounds of `relative_sigma`.
const RELATIVE_SIGMAS: [f64; 2] = [0.2, 5.0];
/// Largest side of a network's input, pixels.
const MAX_INPUT_SIDE: u32 = 8192;
/// Largest margin of a crop: networks are trained with 1.25, and at 2 the tested networks find
/// other people.
const MAX_BOX_MARGIN: f64 = 2.0;
/// Largest number after normalisation. Pixels reach 255; with mean and deviation for another pixel
/// scale, the numbers reach about 500.
const MOST_GIVEN: f32 = 300.0;
/// Smallest difference between black and white in the input: networks expect about 1 to 5.
const LEAST_CONTRAST: f32 = 0.1;

fn kind_of(file: &TomlFile<'_>) -> Result<String, FileError> {
    #[derive(Deserialize)]
    struct Kind {
        kind: String,
    }
    Ok(file.read::<Kind>()?.kind)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawHeatmap {
    #[serde(rename = "kind")]
    _kind: String,
    file: String,
    input: RawInput,
    normalize: Normalize,
    output: RawHeatmapOutput,
    cell_to_input: Option<CellToInput>,
    box_margin: f64,
    #[serde(default)]
    keypoint_offsets: BTreeMap<String, [f64; 3]>,
    #[serde(default)]
    relative_sigma: BTreeMap<String, f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawDetector {
    #[serde(rename = "kind")]
    _kind: String,
    file: String,
    decode: Decode,
    input: RawInput,
    normalize: Normalize,
    output: DetectorOutput,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawInput {
    name: String,
    #[serde(default = "nchw")]
    layout: String,
    width: u32,
    height: u32,
    channels: Channels,
    letterbox: Option<Letterbox>,
    pad: Option<u8>,
}

fn nchw() -> String {
    "nchw".to_owned()
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawHeatmapOutput {
    name: Option<String>,
    simcc: Option<Simcc>,
    width: u32,
    height: u32,
    keypoints: RawKeypoints,
    peak_sigma_cells: Option<f64>,
}

#[derive(Deserialize)]
#[serde(
    untagged,
    expecting = "expected \"coco17\", \"coco23\", \"halpe26\" or a list of names"
)]
enum RawKeypoints {
    Known(String),
    Names(Vec<String>),
}

fn heatmap(file: &TomlFile<'_>) -> Result<HeatmapCard, FileError> {
    let raw: RawHeatmap = file.read()?;
    let input = input(file, raw.input)?;
    check_normalize(file, &raw.normalize)?;
    for (field, side) in [("width", raw.output.width), ("height", raw.output.height)] {
        if !(1..=MAX_SIDE as u32).contains(&side) {
            let place = Place::field("output").key(field);
            return Err(file.error(
                &place,
                format!("found {side}, expected 1 to {MAX_SIDE} cells"),
            ));
        }
    }
    check_simcc_output(file, &raw.output, &input)?;
    if let Some(sigma_cells) = raw.output.peak_sigma_cells {
        let place = Place::field("output").key("peak_sigma_cells");
        check_range(file, &place, sigma_cells, 0.1, MAX_SIDE as f64)?;
    }
    let cells = [raw.output.width, raw.output.height];
    let tensors = tensors(file, raw.output.name, raw.output.simcc)?;
    let cell_to_input = cell_to_input(file, raw.cell_to_input, &tensors, &input, cells)?;
    check_cells(file, cell_to_input, &input, cells)?;
    let margin = Place::field("box_margin");
    check_range(file, &margin, raw.box_margin, 1.0, MAX_BOX_MARGIN)?;
    let keypoints = keypoints(file, raw.output.keypoints)?;
    for (name, offset) in &raw.keypoint_offsets {
        let place = known_keypoint(file, "keypoint_offsets", name, &keypoints)?;
        for (i, &value) in offset.iter().enumerate() {
            check_range(file, &place.index(i), value, -0.5, 0.5)?;
        }
    }
    for (name, factor) in &raw.relative_sigma {
        let place = known_keypoint(file, "relative_sigma", name, &keypoints)?;
        check_range(
            file,
            &place,
            *factor,
            RELATIVE_SIGMAS[0],
            RELATIVE_SIGMAS[1],
        )?;
    }
    Ok(HeatmapCard {
        file: network_file(file, &raw.file)?,
        input,
        normalize: raw.normalize,
        output: HeatmapOutput {
            tensors,
            width: raw.output.width,
            height: raw.output.height,
            keypoints,
            peak_sigma_cells: raw.output.peak_sigma_cells,
        },
        cell_to_input,
        box_margin: raw.box_margin,
        keypoint_offsets: raw.keypoint_offsets,
        relative_sigma: raw.relative_sigma,
    })
}

/// The place of the keypoint `name` in the table `field`.
fn known_keypoint(
    file: &TomlFile<'_>,
    field: &str,
    name: &str,
    keypoints: &KeypointSet,
) -> Result<Place, FileError> {
    let place = Place::field(field).key(name);
    if keypoints.index_of(name).is_none() {
        let known: Vec<&str> = keypoints.names().iter().map(String::as_str).collect();
        return Err(file.error(&place, unknown_name("keypoint", name, &known)));
    }
    Ok(place)
}

fn tensors(
    file: &TomlFile<'_>,
    name: Option<String>,
    simcc: Option<Simcc>,
) -> Result<HeatmapTensors, FileError> {
    match (name, simcc) {
        (Some(name), None) => Ok(HeatmapTensors::Maps(name)),
        (None, Some(simcc)) => {
            let place = Place::field("output").key("simcc").key("bins_per_pixel");
            let bins = f64::from(simcc.bins_per_pixel);
            check_range(file, &place, bins, 1.0, f64::from(MOST_BINS_PER_PIXEL))?;
            Ok(HeatmapTensors::Simcc(simcc))
        }
        (found, _) => {
            let found = if found.is_some() { "both" } else { "neither" };
            let problem = format!(
                "found {found}, expected `name`, the tensor of the maps, or `simcc`, the two tensors of a SimCC network"
            );
            Err(file.error(&Place::field("output"), problem))
        }
    }
}

/// Of a `SimCC` network, the cells are square, and the width of peaks is ours.
fn check_simcc_output(
    file: &TomlFile<'_>,
    output: &RawHeatmapOutput,
    input: &NetworkInput,
) -> Result<(), FileError> {
    let place = Place::field("output");
    if output.simcc.is_none() {
        return Ok(());
    }
    if output.peak_sigma_cells.is_some() {
        let problem = "expected no such field with `simcc`: its peaks get the usual width";
        return Err(file.error(&place.key("peak_sigma_cells"), problem));
    }
    let expected = u64::from(output.width) * u64::from(input.height);
    if u64::from(output.height) * u64::from(input.width) != expected {
        let problem = format!(
            "found {} x {} cells for an input of {} x {}, expected the same ratio of sides",
            output.width, output.height, input.width, input.height
        );
        return Err(file.error(&place.key("height"), problem));
    }
    Ok(())
}

/// Of maps as the card says. Of a `SimCC` network, cells divide the bins evenly, and a cell's centre
/// is that of its bins.
fn cell_to_input(
    file: &TomlFile<'_>,
    stated: Option<CellToInput>,
    tensors: &HeatmapTensors,
    input: &NetworkInput,
    [columns, _]: [u32; 2],
) -> Result<CellToInput, FileError> {
    let place = Place::field("cell_to_input");
    match (stated, tensors) {
        (Some(stated), HeatmapTensors::Maps(_)) => Ok(stated),
        (None, HeatmapTensors::Simcc(simcc)) => {
            let scale = f64::from(input.width) / f64::from(columns);
            let offset = 0.5 * (scale - 1.0 / f64::from(simcc.bins_per_pixel));
            Ok(CellToInput { scale, offset })
        }
        (None, HeatmapTensors::Maps(_)) => {
            Err(file.error(&place, "the field is missing, expected { scale, offset }"))
        }
        (Some(_), HeatmapTensors::Simcc(_)) => Err(file.error(
            &place,
            "expected no such field with `simcc`: the bins determine it",
        )),
    }
}

fn detector(file: &TomlFile<'_>) -> Result<DetectorCard, FileError> {
    let raw: RawDetector = file.read()?;
    check_normalize(file, &raw.normalize)?;
    Ok(DetectorCard {
        file: network_file(file, &raw.file)?,
        input: input(file, raw.input)?,
        normalize: raw.normalize,
        output: raw.output,
        decode: raw.decode,
    })
}

/// Refuses cells outside the input: all keypoints would be shifted by the same rule in all cameras.
fn check_cells(
    file: &TomlFile<'_>,
    cell_to_input: CellToInput,
    input: &NetworkInput,
    [columns, rows]: [u32; 2],
) -> Result<(), FileError> {
    let place = Place::field("cell_to_input");
    let CellToInput { scale, offset } = cell_to_input;
    check_range(file, &place.key("scale"), scale, 1e-3, 1e3)?;
    let sides = [(columns, input.width, "wide"), (rows, input.height, "high")];
    for (cells, input_px, way) in sides {
        // As many cells as pixels over the scale, or from the first pixel to the last.
        let reach_px = scale * f64::from(cells);
        if (reach_px - f64::from(input_px)).abs() > scale.max(1.0) {
            return Err(file.error(
                &place.key("scale"),
                format!(
                    "found {scale}, with which {cells} cells are {reach_px} pixels {way}, expected {}: the input is {input_px} pixels {way}",
                    f64::from(input_px) / f64::from(cells)
                ),
            ));
        }
    }
    check_range(file, &place.key("offset"), offset, -scale, scale)
}

fn network_file(file: &TomlFile<'_>, name: &str) -> Result<PathBuf, FileError> {
    if name.is_empty() {
        return Err(file.error(
            &Place::field("file"),
            "found \"\", expected the name of an ONNX file",
        ));
    }
    Ok(file.resolve(name))
}

fn input(file: &TomlFile<'_>, raw: RawInput) -> Result<NetworkInput, FileError> {
    let place = Place::field("input");
    if raw.layout != "nchw" {
        let problem = format!(
            "found \"{}\", expected \"nchw\", the only layout that is read",
            raw.layout
        );
        return Err(file.error(&place.key("layout"), problem));
    }
    for (field, side) in [("width", raw.width), ("height", raw.height)] {
        if !(1..=MAX_INPUT_SIDE).contains(&side) {
            return Err(file.error(
                &place.key(field),
                format!("found {side}, expected 1 to {MAX_INPUT_SIDE} pixels"),
            ));
        }
    }
    let RawInput {
        name,
        width,
        height,
        channels,
        letterbox,
        pad,
        ..
    } = raw;
    Ok(NetworkInput {
        name,
        width,
        height,
        channels,
        letterbox,
        pad,
    })
}

fn keypoints(file: &TomlFile<'_>, raw: RawKeypoints) -> Result<KeypointSet, FileError> {
    let place = Place::field("output").key("keypoints");
    match raw {
        RawKeypoints::Known(name) => KeypointSet::named(&name)
            .map_err(|problem| file.error(&place, format!("{problem}, or a list of names"))),
        RawKeypoints::Names(names) => {
            if !(1..=MAX_KEYPOINTS).contains(&names.len()) {
                return Err(file.error(
                    &place,
                    format!("found {} names, expected 1 to {MAX_KEYPOINTS}", names.len()),
                ));
            }
            if let Some(i) =
                (0..names.len()).find(|&i| names[i].is_empty() || names[..i].contains(&names[i]))
            {
                return Err(file.error(
                    &place.index(i),
                    format!("found \"{}\", expected names that differ", names[i]),
                ));
            }
            Ok(KeypointSet::new(names))
        }
    }
}

fn check_normalize(file: &TomlFile<'_>, normalize: &Normalize) -> Result<(), FileError> {
    let place = Place::field("normalize");
    check_range(file, &place.key("scale"), normalize.scale.into(), 1e-6, 1e6)?;
    for (i, &mean) in normalize.mean.iter().enumerate() {
        check_range(file, &place.key("mean").index(i), mean.into(), -1e6, 1e6)?;
    }
    for (i, &std) in normalize.std.iter().enumerate() {
        check_range(file, &place.key("std").index(i), std.into(), 1e-6, 1e6)?;
    }
    for (&mean, &std) in normalize.mean.iter().zip(&normalize.std) {
        let given = |pixel: f32| (pixel * normalize.scale - mean) / std;
        let [black, white] = [0.0, 255.0].map(given);
        if black.abs().max(white.abs()) > MOST_GIVEN || (white - black).abs() < LEAST_CONTRAST {
            return Err(file.error(
                &place,
                format!(
                    "a black pixel becomes {black:.3} and a white one {white:.3}, expected numbers up to {MOST_GIVEN} that are {LEAST_CONTRAST} apart: `scale` is 1 where `mean` and `std` are of pixels from 0 to 255, and 1/255 where they are of pixels from 0 to 1"
                ),
            ));
        }
    }
    Ok(())
}

fn check_range(
    file: &TomlFile<'_>,
    place: &Place,
    value: f64,
    min: f64,
    max: f64,
) -> Result<(), FileError> {
    // NaN is in no range.
    if (min..=max).contains(&value) {
        Ok(())
    } else {
        Err(file.error(
            place,
            format!("found {value}, expected a number from {min} to {max}"),
        ))
    }
}

#[cfg(test)]
mod tests;
