//! Expected results of the networks in `testdata/`, computed without a network; see
//! `make_networks.py`.

use std::path::PathBuf;

use farfield_edge::detector::OnnxDetector;
use farfield_edge::inference::{
    DetectorInput, DetectorWindow, InputTensor, KeypointNetwork as _, PersonDetector as _,
};
use farfield_edge::network::OnnxKeypointNetwork;
use image::{Rgb, RgbImage};

const WIDTH: usize = 96;
const HEIGHT: usize = 128;
const MAPS: usize = 17;
/// Both backends sum 64 values of f32 in different orders.
const TOLERANCE: f32 = 1e-5;

/// A file of `testdata/`.
pub(crate) fn testdata(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("testdata")
        .join(name)
}

/// The pure hue of a keypoint, red first.
pub(crate) fn hue(keypoint: usize) -> [f32; 3] {
    let h = 6.0 * keypoint as f32 / MAPS as f32;
    let ramp = |offset: f32| (((h + offset) % 6.0 - 3.0).abs() - 1.0).clamp(0.0, 1.0);
    [ramp(0.0), ramp(4.0), ramp(2.0)]
}

/// Inputs with blobs of different hues.
fn inputs(n: usize) -> Vec<InputTensor> {
    let blob = |i: usize| {
        let mut values = vec![0.2; 3 * WIDTH * HEIGHT];
        for keypoint in 0..MAPS {
            let (left, top) = (3 + (keypoint * 17 + i * 5) % 80, 4 + (keypoint * 29) % 110);
            for (y, x) in (top..top + 9).flat_map(|y| (left..left + 11).map(move |x| (y, x))) {
                for (channel, value) in hue(keypoint).into_iter().enumerate() {
                    values[(channel * HEIGHT + y) * WIDTH + x] = value - 0.005 * (x - left) as f32;
                }
            }
        }
        InputTensor { values }
    };
    (0..n).map(blob).collect()
}

/// The maps of one input.
fn reference(input: &InputTensor) -> Vec<f32> {
    let gain = 1.0 / (0.17f32 * 0.17);
    // Counted from two pixels outside the input, which are empty.
    let pixel = |keypoint: usize, x: usize, y: usize| {
        if x < 2 || y < 2 || x >= WIDTH + 2 || y >= HEIGHT + 2 {
            return 0.0;
        }
        let at = (y - 2) * WIDTH + x - 2;
        let color = hue(keypoint);
        let square: f32 = (0..3)
            .map(|c| (input.values[c * WIDTH * HEIGHT + at] - color[c]).powi(2))
            .sum();
        (1.0 - gain * square).max(0.0)
    };
    let mut maps = Vec::new();
    for keypoint in 0..MAPS {
        for (row, column) in (0..32).flat_map(|row| (0..24).map(move |column| (row, column))) {
            let (left, top) = (4 * column, 4 * row);
            let window = (top..top + 8).flat_map(|y| (left..left + 8).map(move |x| (x, y)));
            maps.push(window.map(|(x, y)| pixel(keypoint, x, y)).sum::<f32>() / 64.0);
        }
    }
    maps
}

/// Loads the network and compares it with the reference, single and in a batch.
pub(crate) fn check_against_reference() {
    let mut network = OnnxKeypointNetwork::load(&testdata("hues17_128x96.toml"))
        .expect("the network fits its card");
    let inputs = inputs(3);
    let expected: Vec<f32> = inputs.iter().flat_map(reference).collect();
    assert!(
        expected.iter().fold(0.0f32, |a, &b| a.max(b)) > 0.5,
        "the blobs are seen"
    );
    let all = network.infer(&inputs).expect("a batch runs");
    assert_eq!(all.len(), expected.len());
    let worst = all
        .iter()
        .zip(&expected)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f32::max);
    assert!(worst < TOLERANCE, "{worst}");
    assert_eq!(
        network.infer(&inputs).expect("a batch runs"),
        all,
        "the same inputs give the same bytes"
    );
    let per_input = all.len() / inputs.len();
    for (input, batched) in inputs.iter().zip(all.chunks(per_input)) {
        let alone = network
            .infer(std::slice::from_ref(input))
            .expect("one input runs");
        let worst = alone
            .iter()
            .zip(batched)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f32::max);
        assert!(worst < TOLERANCE, "{worst}");
    }
    assert!(network.infer(&[]).expect("an empty batch runs").is_empty());
}

/// Loads the `SimCC` network: a blob's centre comes back from the peak of its map by the card's
/// `cell_to_input`, with the lower maximum of its two distributions.
pub(crate) fn check_simcc() {
    let mut network = OnnxKeypointNetwork::load(&testdata("simcc17_128x96.toml"))
        .expect("the network fits its card");
    let cell = network.card().cell_to_input;
    assert!((cell.scale - 4.0).abs() + (cell.offset - 1.75).abs() < 1e-12);
    for (keypoint, left, top) in [(0, 40, 60), (5, 21, 83), (16, 62, 17)] {
        let mut values = vec![0.2; 3 * WIDTH * HEIGHT];
        for (y, x) in (top..top + 9).flat_map(|y| (left..left + 9).map(move |x| (y, x))) {
            for (channel, value) in hue(keypoint).into_iter().enumerate() {
                values[(channel * HEIGHT + y) * WIDTH + x] = value;
            }
        }
        let maps = network
            .infer(&[InputTensor { values }])
            .expect("an input runs");
        assert_eq!(maps.len(), MAPS * 24 * 32);
        let of = |map: usize| &maps[map * 24 * 32..][..24 * 32];
        let highest = of(keypoint).iter().fold(0.0f32, |a, &b| a.max(b));
        assert!((highest - 1.0).abs() < 1e-4, "{highest}");
        let other = of((keypoint + 1) % MAPS)
            .iter()
            .fold(0.0f32, |a, &b| a.max(b));
        assert!(other < 1e-6, "{other}");
        let total: f32 = of(keypoint).iter().sum();
        let mean = |along: fn(usize) -> usize| {
            let weighted = of(keypoint).iter().enumerate();
            let sum: f32 = weighted.map(|(at, value)| along(at) as f32 * value).sum();
            cell.scale * f64::from(sum / total) + cell.offset
        };
        let found = [mean(|at| at % 24), mean(|at| at / 24)];
        let expected = [left as f64 + 4.0, top as f64 + 4.0];
        let off = (found[0] - expected[0]).hypot(found[1] - expected[1]);
        assert!(off < 0.05, "{found:?}, expected {expected:?}");
    }
}

/// A picture of 640 x 480 with one person that `chroma_160.onnx` detects at (200, 120) to (280,
/// 360).
fn picture() -> RgbImage {
    RgbImage::from_fn(640, 480, |x, y| {
        let is_person = (200..280).contains(&x) && (120..360).contains(&y);
        Rgb(if is_person { [255, 0, 40] } else { [90; 3] })
    })
}

/// Loads the detector, whose `labels` are 64-bit integers, and runs it with one person and with
/// none.
pub(crate) fn check_detector() {
    let mut detector =
        OnnxDetector::load(&testdata("chroma_160.toml")).expect("the detector fits its card");
    let grey = RgbImage::from_pixel(640, 480, Rgb([90; 3]));
    let DetectorInput { size_px, letterbox } = detector.input();
    let whole = DetectorWindow::whole([640, 480], size_px, letterbox);
    let none = detector
        .detect(&grey.into(), &whole)
        .expect("a picture is searched");
    assert!(none.is_empty());
    let found = detector
        .detect(&picture().into(), &whole)
        .expect("a picture is searched");
    assert_eq!(found.len(), 1);
    // One input pixel is four of the picture.
    let near = |a: [f32; 2], b: [f32; 2]| (a[0] - b[0]).abs() < 5.0 && (a[1] - b[1]).abs() < 5.0;
    assert!(
        near(found[0].min_px, [200.0, 120.0]) && near(found[0].max_px, [280.0, 360.0]),
        "{found:?}"
    );
}

/// The same detector and picture, but the card's person class never occurs: labels are read.
pub(crate) fn check_labels() {
    let folder = tempfile::tempdir().expect("a folder can be made");
    let card = std::fs::read_to_string(testdata("chroma_160.toml")).expect("the card is committed");
    assert!(card.contains("person_class = 0"));
    let path = folder.path().join("card.toml");
    let card = card.replace("person_class = 0", "person_class = 1");
    std::fs::write(&path, card).expect("the folder is writable");
    let model = "chroma_160.onnx";
    std::fs::copy(testdata(model), folder.path().join(model)).expect("the model is committed");
    let mut detector = OnnxDetector::load(&path).expect("the detector fits its card");
    let DetectorInput { size_px, letterbox } = detector.input();
    let whole = DetectorWindow::whole([640, 480], size_px, letterbox);
    let found = detector
        .detect(&picture().into(), &whole)
        .expect("a picture is searched");
    assert!(found.is_empty(), "{found:?}");
}
