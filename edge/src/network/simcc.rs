//! Maps from the distributions of a `SimCC` network (`RTMPose`): one along the columns, a, and one
//! along the rows, b, of each keypoint.
//!
//! ```text
//!   m(u, v) = a(u) b(v) / max(max a, max b)
//! ```
//!
//! So the peak has the value of the lower maximum, which is the score of these networks. Negative
//! values count as 0. The peaks of the distributions are narrower than those of maps and would fall
//! between cells: a and b are blurred to the usual width ([`PEAK_SIGMA_OF_WIDTH`]) and keep their
//! maxima.
//!
//! The product cannot tell two peaks of one keypoint from their mirror images: peaks at (u, v) and
//! (u', v') also give (u, v') and (u', v).

use farfield_proto::model_card::{HeatmapCard, PEAK_SIGMA_OF_WIDTH, Simcc};

/// Where the kernel ends, in sigmas.
const REACH: f64 = 3.0;

/// The decoder of one network.
#[derive(Debug)]
pub(super) struct SimccMaps {
    columns: Axis,
    rows: Axis,
    a: Vec<f32>,
    b: Vec<f32>,
}

impl SimccMaps {
    pub(super) fn new(card: &HeatmapCard, simcc: &Simcc) -> Self {
        let (bins, output) = (simcc.bins_per_pixel, &card.output);
        let sigma_bins = PEAK_SIGMA_OF_WIDTH * f64::from(card.input.width * bins);
        Self {
            columns: Axis::new(card.input.width * bins, output.width, sigma_bins),
            rows: Axis::new(card.input.height * bins, output.height, sigma_bins),
            a: Vec::new(),
            b: Vec::new(),
        }
    }

    /// Number of bins along the columns and along the rows.
    pub(super) fn n_bins(&self) -> [usize; 2] {
        [self.columns.n_bins, self.rows.n_bins]
    }

    /// Appends the maps of `n` keypoints to `maps`; `x` and `y` are their distributions.
    pub(super) fn decode(&mut self, n: usize, x: &[f32], y: &[f32], maps: &mut Vec<f32>) {
        let pairs = x
            .chunks_exact(self.columns.n_bins)
            .zip(y.chunks_exact(self.rows.n_bins));
        for (x, y) in pairs.take(n) {
            let highest_a = self.columns.blur(x, &mut self.a);
            let highest_b = self.rows.blur(y, &mut self.b);
            let scale = 1.0 / highest_a.max(highest_b).max(f32::MIN_POSITIVE);
            for b in &self.b {
                maps.extend(self.a.iter().map(|a| a * b * scale));
            }
        }
    }
}

/// One direction.
#[derive(Debug)]
struct Axis {
    n_bins: usize,
    cells: Vec<Window>,
}

/// The bins of a cell.
#[derive(Debug)]
struct Window {
    first: usize,
    weights: Vec<f32>,
}

impl Axis {
    fn new(n_bins: u32, n_cells: u32, sigma_bins: f64) -> Self {
        let bins_per_cell = f64::from(n_bins) / f64::from(n_cells);
        let window = |cell: u32| {
            let centre = (f64::from(cell) + 0.5) * bins_per_cell - 0.5;
            let reach = REACH * sigma_bins;
            let first = (centre - reach).ceil().max(0.0) as u32;
            let last = ((centre + reach).floor() as u32).min(n_bins.saturating_sub(1));
            let weight = |bin: u32| {
                let away = (f64::from(bin) - centre) / sigma_bins;
                (-0.5 * away * away).exp() as f32
            };
            Window {
                first: first as usize,
                weights: (first..=last).map(weight).collect(),
            }
        };
        Self {
            n_bins: n_bins as usize,
            cells: (0..n_cells).map(window).collect(),
        }
    }

    /// Writes the positive part of `distribution`, blurred, to `cells`, and returns its maximum.
    fn blur(&self, distribution: &[f32], cells: &mut Vec<f32>) -> f32 {
        cells.clear();
        cells.extend(self.cells.iter().map(|window| {
            let bins = distribution[window.first..].iter().zip(&window.weights);
            bins.map(|(value, weight)| value.max(0.0) * weight)
                .sum::<f32>()
        }));
        let highest = |values: &[f32]| values.iter().fold(0.0f32, |a, b| a.max(*b));
        let (before, after) = (highest(distribution), highest(cells));
        if after > 0.0 {
            for cell in cells.iter_mut() {
                *cell *= before / after;
            }
        }
        before
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use farfield_proto::model_card::HeatmapTensors;
    use proptest::prelude::*;

    use super::*;

    /// `RTMPose`'s card for 192 x 256, with its names of tensors.
    const CARD: &str = r#"kind = "heatmap"
file = "rtmpose.onnx"
input = { name = "input", width = 192, height = 256, channels = "rgb" }
normalize = { scale = 1.0, mean = [123.675, 116.28, 103.53], std = [58.395, 57.12, 57.375] }
output = { simcc = { x = "simcc_x", y = "simcc_y", bins_per_pixel = 2 }, width = 48, height = 64, keypoints = "halpe26" }
box_margin = 1.25
"#;
    /// Sigmas with which it is trained, bins.
    const TRAINED: [f64; 2] = [4.9, 5.66];

    fn rtmpose() -> (HeatmapCard, SimccMaps) {
        let card = HeatmapCard::parse(CARD, Path::new("card.toml")).unwrap();
        let HeatmapTensors::Simcc(simcc) = &card.output.tensors else {
            panic!("a SimCC card")
        };
        let maps = SimccMaps::new(&card, simcc);
        (card, maps)
    }

    /// A distribution with Gaussians, each at an input pixel with a height.
    fn distribution(n_bins: usize, sigma_bins: f64, peaks: &[(f64, f64)]) -> Vec<f32> {
        let at = |bin: usize| {
            let each = peaks.iter().map(|(px, height)| {
                let away = (bin as f64 - 2.0 * px) / sigma_bins;
                height * (-0.5 * away * away).exp()
            });
            each.sum::<f64>() as f32
        };
        (0..n_bins).map(at).collect()
    }

    fn map_of(x: &[(f64, f64)], y: &[(f64, f64)]) -> (HeatmapCard, Vec<f32>) {
        let (card, mut decoder) = rtmpose();
        let [columns, rows] = decoder.n_bins();
        let (a, b) = (
            distribution(columns, TRAINED[0], x),
            distribution(rows, TRAINED[1], y),
        );
        let mut maps = Vec::new();
        decoder.decode(1, &a, &b, &mut maps);
        assert_eq!(maps.len(), 48 * 64);
        (card, maps)
    }

    proptest! {
        #[test]
        fn a_gaussian_comes_back_where_it_was(x_px in 30.0..160.0f64, y_px in 30.0..220.0f64, a in 0.2..1.0f64, b in 0.2..1.0f64) {
            let (card, map) = map_of(&[(x_px, a)], &[(y_px, b)]);
            let cell = card.cell_to_input;
            let total: f64 = map.iter().map(|&value| f64::from(value)).sum();
            let mean = |along: fn(usize) -> usize| {
                let sum: f64 = map.iter().enumerate().map(|(at, &value)| along(at) as f64 * f64::from(value)).sum();
                cell.scale * sum / total + cell.offset
            };
            let found = [mean(|at| at % 48), mean(|at| at / 48)];
            prop_assert!((found[0] - x_px).hypot(found[1] - y_px) < 0.1, "{found:?}");
            // The highest cell has the lower of both maxima.
            let highest = f64::from(map.iter().fold(0.0f32, |a, &b| a.max(b)));
            prop_assert!((highest / a.min(b) - 1.0).abs() < 0.02, "{highest}");
        }
    }

    #[test]
    fn two_peaks_of_one_keypoint_give_their_mirror_images_too() {
        let (_, map) = map_of(&[(40.0, 0.9), (150.0, 0.6)], &[(60.0, 0.9), (200.0, 0.6)]);
        let at = |x: usize, y: usize| map[48 * (y / 4) + x / 4];
        assert!(at(40, 60) > 0.8 && at(150, 200) > 0.3);
        assert!(at(40, 200) > 0.5 && at(150, 60) > 0.5);
    }

    #[test]
    fn a_keypoint_that_is_nowhere_gives_an_empty_map() {
        let (_, mut decoder) = rtmpose();
        let [columns, rows] = decoder.n_bins();
        let mut maps = Vec::new();
        decoder.decode(1, &vec![-0.2; columns], &vec![0.0; rows], &mut maps);
        assert!(maps.iter().all(|&value| value == 0.0));
    }
}
