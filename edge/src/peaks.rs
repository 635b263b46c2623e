//! Peaks of a map with sub-cell accuracy.
//!
//! A map is a slice of rows of `width` cells with values of about 0 to 1. Values that are not above
//! zero are ignored.

/// A local maximum of a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapPeak {
    /// Column and row in cells, fractional; (0, 0) is the centre of the first cell.
    pub cell: [f64; 2],
    /// Height of the highest cell.
    pub value: f32,
}

/// Smallest value for the logarithm; a smaller neighbour is noise.
const FLOOR: f32 = 1e-3;

/// The highest peak of a map above `threshold`, if any.
///
/// Of equal cells the first counts. NaN never counts.
pub fn best_peak(map: &[f32], width: usize, threshold: f32) -> Option<MapPeak> {
    let mut best: Option<(usize, f32)> = None;
    for (i, &value) in map.iter().enumerate() {
        if value > best.map_or(threshold, |(_, b)| b) {
            best = Some((i, value));
        }
    }
    best.map(|(i, _)| refined(map, width, i))
}

/// All local maxima (over the 8 neighbours) above `threshold`, the highest first.
///
/// A plateau counts once, at its first cell in reading order.
pub fn find_peaks(map: &[f32], width: usize, threshold: f32) -> Vec<MapPeak> {
    let mut peaks: Vec<MapPeak> = (0..map.len())
        .filter(|&i| map[i] > threshold && is_local_maximum(map, width, i))
        .map(|i| refined(map, width, i))
        .collect();
    // Stable: of equal peaks the first in reading order stays first.
    peaks.sort_by(|a, b| b.value.total_cmp(&a.value));
    peaks
}

fn is_local_maximum(map: &[f32], width: usize, index: usize) -> bool {
    let (x, y, height) = (index % width, index / width, map.len() / width);
    for other_y in y.saturating_sub(1)..(y + 2).min(height) {
        for other_x in x.saturating_sub(1)..(x + 2).min(width) {
            let other = other_y * width + other_x;
            // Of equal neighbours the first wins, so that a plateau counts once.
            let beaten = if other < index {
                map[other] >= map[index]
            } else {
                map[other] > map[index]
            };
            if other != index && beaten {
                return false;
            }
        }
    }
    true
}

/// The peak at `index`, moved to the maximum of a parabola through the logarithms of the
/// neighbours, per axis; exact for a Gaussian. At the map's border it is not moved in that axis.
fn refined(map: &[f32], width: usize, index: usize) -> MapPeak {
    let (x, y, height) = (index % width, index / width, map.len() / width);
    let along = |inside: bool, stride: usize| {
        if inside {
            top(map[index - stride], map[index], map[index + stride])
        } else {
            0.0
        }
    };
    let dx = along(x > 0 && x + 1 < width, 1);
    let dy = along(y > 0 && y + 1 < height, width);
    MapPeak {
        cell: [x as f64 + dx, y as f64 + dy],
        value: map[index],
    }
}

/// The maximum of the parabola through the logarithms of three neighbours, -0.5 to 0.5.
fn top(before: f32, at: f32, after: f32) -> f64 {
    let [a, b, c] = [before, at, after].map(|v| f64::from(v.max(FLOOR)).ln());
    let bend = a - 2.0 * b + c;
    if bend < 0.0 {
        (0.5 * (a - c) / bend).clamp(-0.5, 0.5)
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const WIDTH: usize = 24;
    const HEIGHT: usize = 32;

    fn gaussians(centers: &[([f64; 2], f64)]) -> Vec<f32> {
        let value = |i: usize| {
            let (x, y) = ((i % WIDTH) as f64, (i / WIDTH) as f64);
            let heights = centers
                .iter()
                .map(|([cx, cy], h)| h * (-((x - cx).powi(2) + (y - cy).powi(2)) / 8.0).exp());
            heights.fold(0.0, f64::max) as f32
        };
        (0..WIDTH * HEIGHT).map(value).collect()
    }

    proptest! {
        #[test]
        fn a_gaussian_is_found_exactly(x in 2.0f64..21.0, y in 2.0f64..29.0, h in 0.05f64..1.0) {
            let peak = best_peak(&gaussians(&[([x, y], h)]), WIDTH, 0.0).unwrap();
            prop_assert!((peak.cell[0] - x).abs() < 1e-3 && (peak.cell[1] - y).abs() < 1e-3);
        }
    }

    #[test]
    fn second_peaks_are_listed_below_the_best() {
        let map = gaussians(&[([5.0, 6.0], 0.4), ([15.3, 20.0], 0.9)]);
        let peaks = find_peaks(&map, WIDTH, 0.1);
        assert_eq!(peaks.len(), 2);
        assert_eq!(Some(peaks[0]), best_peak(&map, WIDTH, 0.1));
        assert!((peaks[1].cell[0] - 5.0).hypot(peaks[1].cell[1] - 6.0) < 1e-3);
        assert_eq!(find_peaks(&map, WIDTH, 0.5).len(), 1);
    }

    #[test]
    fn an_empty_map_has_no_peak() {
        let map = vec![0.0; WIDTH * HEIGHT];
        assert_eq!(best_peak(&map, WIDTH, 0.05), None);
        assert!(find_peaks(&map, WIDTH, 0.0).is_empty());
        assert_eq!(best_peak(&vec![f32::NAN; WIDTH * HEIGHT], WIDTH, 0.0), None);
    }

    #[test]
    fn a_plateau_counts_once() {
        let mut map = vec![0.0; WIDTH * HEIGHT];
        for i in [50, 51, 50 + WIDTH, 51 + WIDTH] {
            map[i] = 0.7;
        }
        assert_eq!(find_peaks(&map, WIDTH, 0.1).len(), 1);
    }

    #[test]
    fn a_peak_on_the_border_stays_on_its_cell() {
        let peak = best_peak(&gaussians(&[([-0.4, 10.2], 0.9)]), WIDTH, 0.1).unwrap();
        assert!(peak.cell[0].abs() < 1e-9 && (peak.cell[1] - 10.2).abs() < 1e-3);
    }
}
