//! Detection of people by an ONNX network, before fusion has boxes for them.
//!
//! Two output layouts are supported: YOLOX's raw grid, whose overlapping boxes are suppressed here,
//! and RTMDet's final detections.

use std::path::Path;

use farfield_proto::model_card::{Decode, DetectorCard, Letterbox};
use farfield_proto::venue::Provider;

use crate::crop::{CropGeometry, CropShape, Cropper, PixelFormat};
use crate::inference::{Detection, DetectorInput, DetectorWindow, NetworkError, PersonDetector};
use crate::network::{Contract, OnnxModel, OutputTensor, TensorAxis, read_card};
use crate::picture::Picture;
use crate::tiles::thinned_out;

/// Least confidence of a detection, 0 to 1. It is low, because fusion requires a second viewpoint
/// and several keypoints for a new track.
const MIN_SCORE: f32 = 0.3;

/// Strides of YOLOX's three grids, input pixels.
const YOLOX_STRIDES: [usize; 3] = [8, 16, 32];

/// Values of a YOLOX cell before its class scores: x, y, width, height, objectness.
const YOLOX_HEAD: usize = 5;

/// Box and score in input pixels: x0, y0, x1, y1 counted from the outer edge of the first pixel.
type RawDetection = ([f32; 4], f32);

/// A detector from an ONNX file and its card.
#[derive(Debug)]
pub struct OnnxDetector {
    card: DetectorCard,
    model: OnnxModel,
    format: PixelFormat,
    cropper: Cropper,
    input: Vec<f32>,
}

impl OnnxDetector {
    /// Reads the card at `card_path` and loads its detector. One empty picture is run to check the
    /// real output.
    ///
    /// # Errors
    /// [`NetworkError`] with the file, if a file cannot be read, the model is not ONNX, or its
    /// input or output does not match the card; also if no backend starts.
    pub fn load(card_path: &Path) -> Result<Self, NetworkError> {
        let text = read_card(card_path)?;
        let card = DetectorCard::parse(&text, card_path)?;
        let cells = yolox_cells(&card);
        let axes = match card.decode {
            Decode::Yolox => [
                TensorAxis::Batch,
                TensorAxis::Fixed("cells, three grids of the input's size", cells),
                TensorAxis::Any,
            ],
            Decode::Rtmdet => [
                TensorAxis::Batch,
                TensorAxis::Any,
                TensorAxis::Fixed("values per detection", 5),
            ],
        };
        let contract = Contract {
            input: &card.input,
            outputs: &[(&card.output.name, axes.to_vec())],
        };
        let mut model = OnnxModel::load(&card.file, text.as_bytes(), &contract, Provider::Cpu)?;
        model.try_out(&contract)?;
        let format = PixelFormat::new(&card.input, &card.normalize);
        let input = vec![0.0; 3 * card.input.width as usize * card.input.height as usize];
        Ok(Self {
            card,
            model,
            format,
            cropper: Cropper::default(),
            input,
        })
    }

    /// Fingerprint of the model's file and its card: 16 hexadecimal digits.
    pub fn model_hash(&self) -> &str {
        self.model.hash()
    }
}

impl PersonDetector for OnnxDetector {
    fn input(&self) -> DetectorInput {
        DetectorInput {
            size_px: [self.card.input.width, self.card.input.height],
            letterbox: self.card.input.letterbox.unwrap_or(Letterbox::TopLeft),
        }
    }

    fn detect(
        &mut self,
        picture: &Picture,
        window: &DetectorWindow,
    ) -> Result<Vec<Detection>, NetworkError> {
        let size_px = [
            self.card.input.width as usize,
            self.card.input.height as usize,
        ];
        let shape = CropShape::without_maps(size_px);
        let Some(crop) = CropGeometry::new(&window.bounding_box(), shape) else {
            return Ok(Vec::new());
        };
        self.cropper
            .crop(picture, None, &crop, &self.format, &mut self.input);
        let (decode, person) = (self.card.decode, self.card.output.person_class);
        let batch = self.model.batch().unwrap_or(1);
        self.input.resize(batch * 3 * size_px[0] * size_px[1], 0.0);
        let mut found = self.model.run(batch, &self.input, |outputs, labels| {
            let Some(OutputTensor { shape, values }) = outputs.first() else {
                return Ok(Vec::new());
            };
            let [_, n, length] = [0, 1, 2].map(|i| shape.get(i).map_or(0, |&s| s.max(0) as usize));
            // Only the first entry of a fixed batch is a picture.
            let values = values.get(..n * length).unwrap_or_default();
            Ok(match decode {
                Decode::Yolox => decode_yolox(values, length, size_px, person),
                Decode::Rtmdet => decode_rtmdet(values, labels, person),
            })
        })?;
        self.input.truncate(3 * size_px[0] * size_px[1]);
        found.retain(|([x0, y0, x1, y1], _)| {
            x1 > x0 && y1 > y0 && (x1 - x0).is_finite() && (y1 - y0).is_finite()
        });
        let to_image = |x: f32, y: f32| {
            let p = crop.pixel(f64::from(x) - 0.5, f64::from(y) - 0.5);
            [p.x() as f32, p.y() as f32]
        };
        let detection = |([x0, y0, x1, y1], score): RawDetection| Detection {
            min_px: to_image(x0, y0),
            max_px: to_image(x1, y1),
            score: score.min(1.0),
        };
        let mut found: Vec<Detection> = found.into_iter().map(detection).collect();
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        Ok(thinned_out(found))
    }
}

fn yolox_cells(card: &DetectorCard) -> usize {
    let [width, height] = [card.input.width as usize, card.input.height as usize];
    YOLOX_STRIDES
        .iter()
        .map(|stride| (width / stride) * (height / stride))
        .sum()
}

/// Reads YOLOX's grids: per cell x and y (strides from the cell's corner), log of width and height
/// (strides), objectness, one score per class.
fn decode_yolox(
    values: &[f32],
    length: usize,
    [width, height]: [usize; 2],
    person: usize,
) -> Vec<RawDetection> {
    let mut found = Vec::new();
    if length <= YOLOX_HEAD + person {
        return found;
    }
    let grids = YOLOX_STRIDES.iter().flat_map(|&stride| {
        let columns = width / stride;
        (0..columns * (height / stride))
            .map(move |i| (stride as f32, (i % columns) as f32, (i / columns) as f32))
    });
    for (cell, (stride, column, row)) in values.chunks_exact(length).zip(grids) {
        let score = cell[4] * cell[YOLOX_HEAD + person];
        if score >= MIN_SCORE {
            let (x, y) = ((cell[0] + column) * stride, (cell[1] + row) * stride);
            let (w, h) = (cell[2].exp() * stride, cell[3].exp() * stride);
            found.push(([x - w / 2.0, y - h / 2.0, x + w / 2.0, y + h / 2.0], score));
        }
    }
    found
}

/// Reads RTMDet's detections: x0, y0, x1, y1, score; without labels all are persons.
fn decode_rtmdet(values: &[f32], labels: Option<&[i64]>, person: usize) -> Vec<RawDetection> {
    let is_person = |i: usize| {
        labels
            .and_then(|l| l.get(i))
            .is_none_or(|&l| usize::try_from(l) == Ok(person))
    };
    let all = values.chunks_exact(5).enumerate();
    let persons = all.filter(|&(i, d)| d[4] >= MIN_SCORE && is_person(i));
    persons
        .map(|(_, d)| ([d[0], d[1], d[2], d[3]], d[4]))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_yolox_cell_is_decoded_on_its_own_grid() {
        // An input of 64 x 32: 32 + 8 + 2 cells. The third cell of the second row of stride 16.
        let (length, cells) = (YOLOX_HEAD + 2, 42);
        let mut values = vec![0.0; cells * length];
        let cell = 32 + 4 + 2;
        values[cell * length..][..length].copy_from_slice(&[0.5, 0.25, 1.0, 2.0, 0.9, 0.1, 0.8]);
        let found = decode_yolox(&values, length, [64, 32], 1);
        assert_eq!(found.len(), 1);
        let ([x0, y0, x1, y1], score) = found[0];
        assert!((score - 0.72).abs() < 1e-6);
        assert!((x0.midpoint(x1) - 40.0).abs() < 1e-3 && (y0.midpoint(y1) - 20.0).abs() < 1e-3);
        assert!(
            (x1 - x0 - 16.0 * 1f32.exp()).abs() < 1e-3
                && (y1 - y0 - 16.0 * 2f32.exp()).abs() < 1e-3
        );
        assert!(
            decode_yolox(&values, length, [64, 32], 0).is_empty(),
            "another class"
        );
    }

    #[test]
    fn rtmdet_detections_of_other_classes_are_left_out() {
        let values = [
            1.0, 2.0, 3.0, 4.0, 0.9, 5.0, 6.0, 7.0, 8.0, 0.8, 0.0, 0.0, 1.0, 1.0, 0.1,
        ];
        assert_eq!(decode_rtmdet(&values, Some(&[0, 3, 0]), 0).len(), 1);
        assert_eq!(decode_rtmdet(&values, None, 0).len(), 2);
    }
}
