//! Converts detectors that find the centres of people to ONNX, with the boxes decoded.
//!
//! The network draws one grid. Each cell has the score of a person's centre, the size of that person, and the position
//! of the centre relative to the cell. All cells become detections. The edge takes those with enough score, and one of
//! those that overlap.

use super::ConvertError;
use super::tfjs::{GraphConversion, Image};
use crate::onnx::{Batch, Node};
use crate::tfjs::{Model, TfjsError};

/// Name of the converted network's output.
pub const BOXES: &str = "dets";

/// Least score of a detection in the edge, for all detectors.
const EDGE_MIN_SCORE: f32 = 0.3;

/// The nodes of a TensorFlow.js graph that find centres, and its grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CentreBoxes {
    /// The node with the image.
    pub image: &'static str,
    /// The node with the logits of centres.
    pub centre: &'static str,
    /// The node with height and width, cells.
    pub size: &'static str,
    /// The node with row and column of the centre relative to the cell, cells.
    pub offset: &'static str,
    /// Rows and columns of the grid.
    pub cells: usize,
    /// Side of a cell, input pixels.
    pub cell_px: usize,
    /// Least score of a detection, 0 to 1. The converted network maps it to the edge's.
    pub min_score: f32,
}

impl CentreBoxes {
    /// Side of the input, pixels.
    pub fn side_px(&self) -> usize {
        self.cells * self.cell_px
    }

    /// Refuses a value that has another shape than [channels, cells, cells].
    fn check(&self, node: &str, value: &Image, channels: usize) -> Result<(), TfjsError> {
        let expected = [channels, self.cells, self.cells];
        if value.shape == expected {
            return Ok(());
        }
        Err(TfjsError::Grid {
            node: node.to_owned(),
            found: value.shape,
            expected,
        })
    }
}

/// Converts the detector in `json` and `weights` to an ONNX file.
///
/// Its input [`INPUT`](super::INPUT) is [1, 3, rows, columns], as the node `image` of the graph. Its output [`BOXES`] is
/// [1, cells, 5]: left, top, right and bottom in input pixels, and the score.
///
/// # Errors
/// [`ConvertError`] for damaged files, and for a network that this module does not know.
pub fn centre_boxes(
    json: &[u8],
    weights: &[u8],
    boxes: &CentreBoxes,
) -> Result<Vec<u8>, ConvertError> {
    let model = Model::read(json, weights)?;
    let mut conversion = GraphConversion::new(&model, boxes.image, boxes.side_px())?;
    let centre = conversion.value(boxes.centre)?;
    let size = conversion.value(boxes.size)?;
    let offset = conversion.value(boxes.offset)?;
    boxes.check(boxes.centre, &centre, 1)?;
    boxes.check(boxes.size, &size, 2)?;
    boxes.check(boxes.offset, &offset, 2)?;
    let mut graph = conversion.graph;
    // `min_score` becomes the edge's, and 1 stays 1.
    let slope = (1.0 - EDGE_MIN_SCORE) / (1.0 - boxes.min_score);
    graph.floats("score_slope", &[], &[slope]);
    graph.floats("score_at_zero", &[], &[1.0 - slope]);
    let n = boxes.cells;
    let rows = (0..n * n).map(|i| (i / n) as f32);
    let columns = (0..n * n).map(|i| (i % n) as f32);
    let places: Vec<f32> = rows.chain(columns).collect();
    graph.floats("cell_places", &[1, 2, n, n], &places);
    graph.floats("cell_px", &[], &[boxes.cell_px as f32]);
    graph.floats("half_cell_px", &[], &[boxes.cell_px as f32 / 2.0]);
    // Row before column becomes x before y.
    graph.whole_numbers("x_before_y", &[1, 0, 3, 2, 4]);
    let all = i64::try_from(n * n).unwrap_or(i64::MAX);
    graph.whole_numbers("one_list", &[1, 5, all]);
    let (centre, size, offset) = (&*centre.name, &*size.name, &*offset.name);
    graph.nodes.extend([
        Node::new("Sigmoid", &[centre], "probability"),
        Node::new("Mul", &["probability", "score_slope"], "scaled_probability"),
        Node::new("Add", &["scaled_probability", "score_at_zero"], "score"),
        Node::new("Add", &[offset, "cell_places"], "place_cells"),
        Node::new("Mul", &["place_cells", "cell_px"], "place"),
        Node::new("Relu", &[size], "size_cells"),
        Node::new("Mul", &["size_cells", "half_cell_px"], "half_size"),
        Node::new("Sub", &["place", "half_size"], "least"),
        Node::new("Add", &["place", "half_size"], "greatest"),
        Node::new("Concat", &["least", "greatest", "score"], "grid").int("axis", 1),
        Node::new("Gather", &["grid", "x_before_y"], "grid_x_before_y").int("axis", 1),
        Node::new("Reshape", &["grid_x_before_y", "one_list"], "list"),
        Node::new("Transpose", &["list"], BOXES).ints("perm", &[0, 2, 1]),
    ]);
    graph.output(BOXES, Batch::One, &[n * n, 5]);
    Ok(graph.into_file())
}

#[cfg(test)]
mod tests;
