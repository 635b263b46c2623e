//! Model cards: what a network beside it expects and gives, as a TOML file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::keypoints::{COCO17, KeypointSet};
use crate::patch::{MAX_KEYPOINTS, MAX_SIDE};
use crate::toml_file::{FileError, Place, TomlFile, unknown_name};

/// Largest side of a network's input, pixels.
const MAX_INPUT_SIDE: u32 = 8192;

/// What kind of network a card describes, and how it is used.
#[derive(Debug, Clone, PartialEq)]
pub enum ModelCard {
    /// One person's crop in, part confidence maps out.
    Heatmap(HeatmapCard),
    /// A picture in, persons' boxes out.
    Detector(DetectorCard),
}

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
    /// Factor on the pixel (0 to 255).
    pub scale: f32,
    /// Subtracted then.
    pub mean: [f32; 3],
    /// Divided by last.
    pub std: [f32; 3],
}

/// The maps: [batch, keypoint, row, column].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HeatmapOutput {
    /// Name of the tensor.
    pub name: String,
    /// Cells in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The maps' keypoints.
    pub keypoints: KeypointSet,
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
    cell_to_input: CellToInput,
    box_margin: f64,
    #[serde(default)]
    keypoint_offsets: BTreeMap<String, [f64; 3]>,
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
    name: String,
    width: u32,
    height: u32,
    keypoints: RawKeypoints,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected \"coco17\" or a list of names")]
enum RawKeypoints {
    Known(String),
    Names(Vec<String>),
}

fn heatmap(file: &TomlFile<'_>) -> Result<HeatmapCard, FileError> {
    let raw: RawHeatmap = file.read()?;
    let input = input(file, raw.input)?;
    check_normalize(file, &raw.normalize)?;
    let keypoints = keypoints(file, raw.output.keypoints)?;
    for (field, side) in [("width", raw.output.width), ("height", raw.output.height)] {
        if !(1..=MAX_SIDE as u32).contains(&side) {
            let place = Place::field("output").key(field);
            return Err(file.error(
                &place,
                format!("found {side}, expected 1 to {MAX_SIDE} cells"),
            ));
        }
    }
    let cells = Place::field("cell_to_input");
    check_range(
        file,
        &cells.key("scale"),
        raw.cell_to_input.scale,
        1e-3,
        1e3,
    )?;
    check_range(
        file,
        &cells.key("offset"),
        raw.cell_to_input.offset,
        -1e3,
        1e3,
    )?;
    check_range(file, &Place::field("box_margin"), raw.box_margin, 1.0, 4.0)?;
    for (name, offset) in &raw.keypoint_offsets {
        let place = Place::field("keypoint_offsets").key(name);
        if keypoints.index_of(name).is_none() {
            let known: Vec<&str> = keypoints.names().iter().map(String::as_str).collect();
            return Err(file.error(&place, unknown_name("keypoint", name, &known)));
        }
        for (i, &value) in offset.iter().enumerate() {
            check_range(file, &place.index(i), value, -0.5, 0.5)?;
        }
    }
    Ok(HeatmapCard {
        file: network_file(file, &raw.file)?,
        input,
        normalize: raw.normalize,
        output: HeatmapOutput {
            name: raw.output.name,
            width: raw.output.width,
            height: raw.output.height,
            keypoints,
        },
        cell_to_input: raw.cell_to_input,
        box_margin: raw.box_margin,
        keypoint_offsets: raw.keypoint_offsets,
    })
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
        RawKeypoints::Known(name) if name == "coco17" => Ok(KeypointSet::coco17()),
        RawKeypoints::Known(name) => Err(file.error(
            &place,
            format!(
                "found \"{name}\", expected \"coco17\" or a list of names such as {:?}",
                &COCO17[..2]
            ),
        )),
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
mod tests {
    use super::*;

    const HEATMAP: &str = r#"kind = "heatmap"
file = "net.onnx"
input = { name = "image", layout = "nchw", width = 192, height = 256, channels = "rgb" }
normalize = { scale = 0.004, mean = [0.485, 0.456, 0.406], std = [0.229, 0.224, 0.225] }
output = { name = "heatmaps", width = 48, height = 64, keypoints = "coco17" }
cell_to_input = { scale = 4.0, offset = 0.0 }
box_margin = 1.25
keypoint_offsets = { left_hip = [0.0, 0.03, -0.02] }
"#;

    const DETECTOR: &str = r#"kind = "detector"
file = "det.onnx"
decode = "yolox"
input = { name = "images", width = 416, height = 416, channels = "bgr", letterbox = "top-left", pad = 114 }
normalize = { scale = 1.0, mean = [0.0, 0.0, 0.0], std = [1.0, 1.0, 1.0] }
output = { name = "output", person_class = 0 }
"#;

    fn parse(text: &str) -> Result<ModelCard, FileError> {
        ModelCard::parse(text, Path::new("models/card.toml"))
    }

    fn refusal(text: &str, from: &str, to: &str) -> String {
        assert!(text.contains(from));
        parse(&text.replace(from, to)).unwrap_err().to_string()
    }

    #[test]
    fn a_heatmap_card_is_read() {
        let card = HeatmapCard::parse(HEATMAP, Path::new("models/card.toml")).unwrap();
        assert_eq!(card.file, Path::new("models/net.onnx"));
        assert_eq!(
            (card.input.channels, card.input.letterbox),
            (Channels::Rgb, None)
        );
        assert_eq!(
            (
                card.output.width,
                card.output.height,
                card.output.keypoints.len()
            ),
            (48, 64, 17)
        );
        assert_eq!(card.keypoint_offsets.len(), 1);
    }

    #[test]
    fn a_detector_card_is_read() {
        let card = DetectorCard::parse(DETECTOR, Path::new("models/card.toml")).unwrap();
        assert_eq!((card.decode, card.output.person_class), (Decode::Yolox, 0));
        assert_eq!(
            (card.input.letterbox, card.input.pad),
            (Some(Letterbox::TopLeft), Some(114))
        );
    }

    #[test]
    fn a_list_of_keypoints_is_read() {
        let text = HEATMAP.replace("\"coco17\"", "[\"left_hip\", \"left_heel\"]");
        let ModelCard::Heatmap(card) = parse(&text).unwrap() else {
            panic!("a heatmap card")
        };
        assert_eq!(card.output.keypoints.index_of("left_heel"), Some(1));
    }

    #[test]
    fn a_card_of_the_other_kind_is_refused() {
        let refused = HeatmapCard::parse(DETECTOR, Path::new("d.toml"))
            .unwrap_err()
            .to_string();
        assert_eq!(
            refused,
            "d.toml: `kind`: found \"detector\", expected \"heatmap\""
        );
    }

    #[test]
    fn what_is_wrong_is_named_with_field_and_line() {
        let check = |text, from, to, expected: &str| {
            assert_eq!(
                refusal(text, from, to),
                format!("models/card.toml:{expected}")
            );
        };
        check(
            HEATMAP,
            "\"heatmap\"",
            "\"heat\"",
            "1: `kind`: unknown kind `heat`, expected one of `heatmap`, `detector`",
        );
        check(
            HEATMAP,
            "\"nchw\"",
            "\"nhwc\"",
            "3: `input.layout`: found \"nhwc\", expected \"nchw\", the only layout that is read",
        );
        check(
            HEATMAP,
            "width = 48",
            "width = 480",
            "5: `output.width`: found 480, expected 1 to 256 cells",
        );
        check(
            HEATMAP,
            "coco17",
            "coco18",
            "5: `output.keypoints`: found \"coco18\", expected \"coco17\" or a list of names such as [\"nose\", \"left_eye\"]",
        );
        check(
            HEATMAP,
            "box_margin",
            "box_margins",
            "7: `box_margins`: unknown field `box_margins`, did you mean `box_margin`?",
        );
        check(
            HEATMAP,
            "1.25",
            "nan",
            "7: `box_margin`: found NaN, expected a number from 1 to 4",
        );
        check(
            HEATMAP,
            "left_hip",
            "left_hips",
            "8: `keypoint_offsets.left_hips`: unknown keypoint `left_hips`, did you mean `left_hip`?",
        );
        check(
            HEATMAP,
            "0.229",
            "0.0",
            "4: `normalize.std[0]`: found 0, expected a number from 0.000001 to 1000000",
        );
        check(
            DETECTOR,
            "\"yolox\"",
            "\"yolo\"",
            "3: `decode`: unknown value `yolo`, did you mean `yolox`?",
        );
        check(
            DETECTOR,
            "pad = 114",
            "pad = 300",
            "4: `input.pad`: found integer `300`, expected u8",
        );
    }
}
