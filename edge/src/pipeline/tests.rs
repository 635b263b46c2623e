//! The steps of an edge with a network that returns its input.

mod detection;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use farfield_proto::bounding_box::{BoundingBox, BoxRate};
use farfield_proto::frames::Pixel;
use farfield_proto::grid::CellGrid;
use farfield_proto::message::{BoxSet, CameraBox, Order, PersonBoxes, Sighting};
use farfield_proto::model_card::{HeatmapCard, Letterbox};
use farfield_proto::patch::Decoder;
use farfield_proto::wire;
use image::RgbImage;

use super::*;
use crate::fixtures::venue;
use crate::inference::{
    CameraDetections, Detection, DetectorInput, DetectorWindow, InputTensor, NetworkError,
};
use crate::peaks::best_peak;
use crate::picture::Picture;
use crate::source::{KeypointCandidate, KeypointFrame, MapPainter};

const PICTURES: &str = "{ kind = \"video\", path = \"a.mp4\" }";
const KEYPOINTS: &str = "{ kind = \"keypoints\", path = \"a.jsonl\" }";
const PAINTED: &str = "{ kind = \"simulated\", path = \"s.toml\", content = \"maps\", grid = [72, 96], sigma_cells = 3.0 }";
const CARD: &str = r#"
kind = "heatmap"
file = "n.onnx"
input = { name = "x", layout = "nchw", width = 48, height = 64, channels = "rgb" }
normalize = { scale = 0.00392156862745098, mean = [0.0, 0.0, 0.0], std = [1.0, 1.0, 1.0] }
output = { name = "y", width = 12, height = 16, keypoints = "coco17" }
cell_to_input = { scale = 4.0, offset = 1.5 }
box_margin = 1.25
"#;

/// Each of its maps is the red of the crop, averaged over the pixels of a cell.
struct EchoNetwork {
    card: HeatmapCard,
    calls: Arc<AtomicUsize>,
}

/// The network and its number of calls.
fn mirror() -> (Box<dyn KeypointNetwork>, Arc<AtomicUsize>) {
    let calls = Arc::new(AtomicUsize::new(0));
    let card = HeatmapCard::parse(CARD, Path::new("n.toml")).unwrap();
    let network = EchoNetwork {
        card,
        calls: calls.clone(),
    };
    (Box::new(network), calls)
}

impl KeypointNetwork for EchoNetwork {
    fn card(&self) -> &HeatmapCard {
        &self.card
    }

    fn infer(&mut self, inputs: &[InputTensor]) -> Result<Vec<f32>, NetworkError> {
        self.calls.fetch_add(1, Ordering::Relaxed);
        let cell = |input: &InputTensor, i: usize| {
            let (x, y) = (4 * (i % 12), 4 * (i / 12));
            (0..16)
                .map(|j| input.values[(y + j / 4) * 48 + x + j % 4])
                .sum::<f32>()
                / 16.0
        };
        let map = |input| (0..12 * 16).map(move |i| cell(input, i));
        Ok(inputs
            .iter()
            .flat_map(|input| (0..17).flat_map(move |_| map(input)))
            .collect())
    }

    fn another(&self) -> Result<Option<Box<dyn KeypointNetwork>>, NetworkError> {
        Ok(Some(Box::new(Self {
            card: self.card.clone(),
            calls: Arc::clone(&self.calls),
        })))
    }
}

/// Always returns the same boxes.
struct Finds(Vec<Detection>);

impl PersonDetector for Finds {
    fn input(&self) -> DetectorInput {
        DetectorInput {
            size_px: [640, 480],
            letterbox: Letterbox::TopLeft,
        }
    }

    fn detect(&mut self, _: &Picture, _: &DetectorWindow) -> Result<Vec<Detection>, NetworkError> {
        Ok(self.0.clone())
    }
}

fn frame(content: FrameContent) -> Frame {
    Frame {
        tick: Tick(40),
        capture_offset_us: -250,
        content,
    }
}

/// A black picture with a red disc.
fn disc(x: f64, y: f64) -> Frame {
    let image = RgbImage::from_fn(640, 480, |px, py| {
        let near = (f64::from(px) - x).hypot(f64::from(py) - y) < 12.0;
        image::Rgb([if near { 255 } else { 0 }, 0, 0])
    });
    frame(FrameContent::Image(image.into()))
}

fn box_at(camera: u16, center_px: [f32; 2], rotation_rad: f32) -> CameraBox {
    CameraBox {
        camera: CameraIndex(camera),
        bounding_box: BoundingBox {
            center_px,
            size_px: [96.0, 128.0],
            rotation_rad,
        },
        rate: BoxRate::default(),
        torso_px: center_px,
        neck_px: center_px,
    }
}

/// The boxes of a tick with a detection pass on the cameras `detection`.
fn boxes(detection: &[u16], persons: Vec<Vec<CameraBox>>) -> BoxSet {
    let numbered = (1..).zip(persons);
    let persons = numbered
        .map(|(i, cameras)| PersonBoxes {
            person: PersonId(i),
            cameras,
        })
        .collect();
    BoxSet {
        session: SessionId(9),
        tick: Tick(40),
        viewpoint: ViewpointIndex(0),
        part: 0,
        parts: 1,
        order: Order::Track,
        live: None,
        detection_cameras: detection.iter().copied().map(CameraIndex).collect(),
        persons,
    }
}

fn pipeline(sources: &[&str]) -> EdgePipeline {
    let (network, _) = mirror();
    EdgePipeline::new(&venue(sources), ViewpointIndex(0), Some(network), None).unwrap()
}

/// All that fusion requests in `boxes`, at the tick of the frames.
fn step(
    edge: &mut EdgePipeline,
    frames: &[Option<Frame>],
    boxes: &BoxSet,
) -> Result<EdgeOutput, PipelineError> {
    let request = StepRequest {
        tick: Tick(40),
        ..StepRequest::of(boxes)
    };
    edge.step(frames, &request, &mut |_| {})
}

fn patches(output: &EdgeOutput) -> Vec<&PersonPatch> {
    output
        .patch_sets
        .iter()
        .flat_map(|set| &set.persons)
        .collect()
}

/// The peak of a keypoint's map, undistorted pixels.
fn peak_of(patch: &PersonPatch, keypoint: usize) -> Option<[f64; 2]> {
    let mut maps = Maps::new(1, 1, 1);
    Decoder::new().decode(&patch.maps, &mut maps).unwrap();
    let values: Vec<f32> = maps
        .cells(keypoint)
        .iter()
        .map(|&c| f32::from(c) / 255.0)
        .collect();
    let grid: &CellGrid = &patch.crops[usize::from(patch.crop_of_keypoint[keypoint])];
    let peak = best_peak(&values, grid.width.into(), 0.05)?;
    let pixel = grid.pixel(peak.cell[0], peak.cell[1]);
    Some([pixel.x(), pixel.y()])
}

fn assert_near(peak: Option<[f64; 2]>, x: f64, y: f64) {
    let [px, py] = peak.expect("a peak");
    // A cell is 8 px here, and 11 in the crop around a box turned by 45 degrees.
    assert!(
        (px - x).hypot(py - y) < 4.0,
        "({px}, {py}) is not ({x}, {y})"
    );
}

#[test]
fn peaks_are_at_the_position_in_the_picture() {
    let mut edge = pipeline(&[PICTURES]);
    let output = step(
        &mut edge,
        &[Some(disc(330.0, 220.0))],
        &boxes(&[], vec![vec![box_at(0, [320.0, 240.0], 0.0)]]),
    );
    let output = output.unwrap();
    let patch = patches(&output)[0];
    assert_eq!(
        (patch.crops.len(), patch.capture_offset_us, patch.box_tick),
        (1, -250, Tick(40))
    );
    assert_near(peak_of(patch, 3), 330.0, 220.0);
    assert!(output.sighting_sets.is_empty());
}

#[test]
fn a_turned_box_gives_the_legs_an_upright_crop() {
    let mut edge = pipeline(&[PICTURES]);
    for (rotation_rad, crops) in [(0.1, 1), (0.785, 2), (-2.5, 2), (6.2, 1)] {
        let persons = vec![vec![box_at(0, [320.0, 240.0], rotation_rad)]];
        let output = step(&mut edge, &[Some(disc(330.0, 220.0))], &boxes(&[], persons)).unwrap();
        let patch = patches(&output)[0];
        assert_eq!(patch.crops.len(), crops);
        let from_second: usize = patch.crop_of_keypoint.iter().map(|&c| usize::from(c)).sum();
        assert_eq!(from_second, if crops == 2 { 6 } else { 0 });
        assert_near(peak_of(patch, 0), 330.0, 220.0);
        assert_near(peak_of(patch, 16), 330.0, 220.0);
    }
}

#[test]
fn without_second_crops_the_tilted_crop_includes_the_legs() {
    let mut edge = pipeline(&[PICTURES]);
    let turned = boxes(&[], vec![vec![box_at(0, [320.0, 240.0], 0.785)]]);
    assert_eq!(EdgePipeline::count_second_crops(&turned.persons), 1);
    for (has_time, crops) in [(false, 1), (true, 2)] {
        edge.set_second_crops(has_time);
        let output = step(&mut edge, &[Some(disc(330.0, 220.0))], &turned).unwrap();
        let patch = patches(&output)[0];
        assert_eq!((patch.crops.len(), edge.tracked_crops()), (crops, crops));
        assert_near(peak_of(patch, 16), 330.0, 220.0);
    }
}

#[test]
fn a_dead_camera_is_replaced_within_the_tick() {
    let mut edge = pipeline(&[PICTURES, PICTURES]);
    let both = vec![vec![
        box_at(0, [320.0, 240.0], 0.0),
        box_at(1, [200.0, 240.0], 0.0),
    ]];
    let boxes = boxes(&[], both);
    let first = step(
        &mut edge,
        &[Some(disc(320.0, 240.0)), Some(disc(200.0, 240.0))],
        &boxes,
    )
    .unwrap();
    assert_eq!(patches(&first)[0].camera, CameraIndex(0));
    let second = step(&mut edge, &[None, Some(disc(200.0, 240.0))], &boxes).unwrap();
    assert_eq!(patches(&second)[0].camera, CameraIndex(1));
    let dark = step(&mut edge, &[None, None], &boxes).unwrap();
    assert!(patches(&dark).is_empty());
    assert_eq!(
        (dark.patch_sets.len(), dark.patch_sets[0].tick),
        (1, Tick(40))
    );
}

#[test]
fn nothing_is_sent_for_a_person_that_no_camera_sees() {
    let mut edge = pipeline(&[PICTURES]);
    let persons = vec![vec![box_at(0, [-500.0, 240.0], 0.0)], vec![]];
    let output = step(&mut edge, &[Some(disc(1.0, 1.0))], &boxes(&[], persons)).unwrap();
    assert!(patches(&output).is_empty());
    assert_eq!(output.patch_sets[0].parts, 1);
}

#[test]
fn an_old_box_is_moved_on() {
    let mut edge = pipeline(&[PICTURES]);
    let mut camera_box = box_at(0, [200.0, 240.0], 0.0);
    camera_box.rate.center_px = [20.0, 0.0];
    let mut boxes = boxes(&[], vec![vec![camera_box]]);
    boxes.tick = Tick(34);
    let output = step(&mut edge, &[Some(disc(320.0, 240.0))], &boxes).unwrap();
    let patch = patches(&output)[0];
    assert_eq!(
        (output.patch_sets[0].tick, patch.box_tick),
        (Tick(40), Tick(34))
    );
    assert_near(peak_of(patch, 0), 320.0, 240.0);
}

#[test]
fn all_crops_of_a_tick_are_one_inference() {
    let (network, calls) = mirror();
    let found = Detection {
        min_px: [290.0, 200.0],
        max_px: [350.0, 280.0],
        score: 0.7,
    };
    let detector: Box<dyn PersonDetector> = Box::new(Finds(vec![found]));
    let venue = venue(&[PICTURES, PICTURES]);
    let mut edge =
        EdgePipeline::new(&venue, ViewpointIndex(0), Some(network), Some(detector)).unwrap();
    let person = || {
        vec![
            box_at(0, [320.0, 240.0], 0.7),
            box_at(1, [300.0, 240.0], 0.7),
        ]
    };
    let frames = [Some(disc(320.0, 240.0)), Some(disc(310.0, 230.0))];
    let output = step(
        &mut edge,
        &frames,
        &boxes(&[0, 1], vec![person(), person(), person()]),
    )
    .unwrap();
    assert_eq!(calls.load(Ordering::Relaxed), 1);
    assert_eq!(patches(&output).len(), 3);
    let sightings: Vec<&Sighting> = output
        .sighting_sets
        .iter()
        .flat_map(|s| &s.sightings)
        .collect();
    assert_eq!(
        sightings.iter().map(|s| s.camera.0).collect::<Vec<_>>(),
        [0, 1]
    );
    for (sighting, expected) in sightings.iter().zip([[320.0, 240.0], [310.0, 230.0]]) {
        let peak = sighting.keypoints[5].unwrap();
        assert_near(
            Some(peak.position_px.map(f64::from)),
            expected[0],
            expected[1],
        );
    }
    let parts = output.sighting_sets.len();
    assert!(
        output
            .patch_sets
            .iter()
            .all(|set| usize::from(set.sighting_parts) == parts)
    );
}

#[test]
fn workers_share_the_crops_of_a_tick_and_change_nothing() {
    let (network, calls) = mirror();
    let mut edge =
        EdgePipeline::new(&venue(&[PICTURES]), ViewpointIndex(0), Some(network), None).unwrap();
    let person = |x| vec![box_at(0, [x, 240.0], 0.7)];
    let people = boxes(&[], vec![person(320.0), person(330.0), person(310.0)]);
    let frames = [Some(disc(320.0, 240.0))];
    let alone = step(&mut edge, &frames, &people).unwrap();
    // Three tilted people are six crops: four workers take two each, and one has no work.
    for (workers, shares) in [(4, 3), (2, 2), (0, 1)] {
        let batch = edge.batch().unwrap();
        assert_eq!(batch.set_workers(workers).unwrap(), workers.max(1));
        let before = calls.load(Ordering::Relaxed);
        assert_eq!(step(&mut edge, &frames, &people).unwrap(), alone);
        assert_eq!(calls.load(Ordering::Relaxed) - before, shares);
    }
    edge.batch().unwrap().rehearse(5).unwrap();
    assert_eq!(step(&mut edge, &frames, &people).unwrap(), alone);
}

/// Returns the results of `network` for some calls, then fails.
struct FakeFailingAccelerator {
    network: Box<dyn KeypointNetwork>,
    calls_left: usize,
}

impl KeypointNetwork for FakeFailingAccelerator {
    fn card(&self) -> &HeatmapCard {
        self.network.card()
    }

    fn infer(&mut self, inputs: &[InputTensor]) -> Result<Vec<f32>, NetworkError> {
        let Some(left) = self.calls_left.checked_sub(1) else {
            return Err(NetworkError::Backend {
                problem: "the device is gone".to_owned(),
            });
        };
        self.calls_left = left;
        self.network.infer(inputs)
    }

    fn another(&self) -> Result<Option<Box<dyn KeypointNetwork>>, NetworkError> {
        Ok(None)
    }
}

#[test]
fn fake_a_failing_accelerator_loses_no_tick_and_is_replaced() {
    let (network, on_processor) = mirror();
    let (accelerated, on_device) = mirror();
    let mut edge =
        EdgePipeline::new(&venue(&[PICTURES]), ViewpointIndex(0), Some(network), None).unwrap();
    let person = |x| vec![box_at(0, [x, 240.0], 0.7)];
    let people = boxes(&[], vec![person(320.0), person(330.0)]);
    let frames = [Some(disc(320.0, 240.0))];
    let expected = step(&mut edge, &frames, &people).unwrap();
    let batch = edge.batch().unwrap();
    batch.set_workers(2).unwrap();
    batch.accelerate(Some(Box::new(FakeFailingAccelerator {
        network: accelerated,
        calls_left: 2,
    })));
    let before = on_processor.load(Ordering::Relaxed);
    // All four crops in one call, twice; then two workers take two each.
    for (device, processor) in [(1, 0), (2, 0), (2, 2), (2, 4)] {
        assert_eq!(step(&mut edge, &frames, &people).unwrap(), expected);
        let calls = [&on_device, &on_processor].map(|it| it.load(Ordering::Relaxed));
        assert_eq!(calls, [device, before + processor]);
    }
}

fn candidates(x: f64, y: f64) -> KeypointFrame {
    let candidate = KeypointCandidate {
        position: Pixel::new(x, y),
        score: 0.9,
    };
    KeypointFrame {
        persons: vec![vec![Some(candidate); 17]],
        peaks: vec![vec![candidate]; 17],
    }
}

/// Paints one cell of every map, at the middle of the given box.
#[derive(Debug)]
struct OneCellPainter;

impl MapPainter for OneCellPainter {
    fn paint(&self, crop: &MapCrop<'_>, into: &mut Maps) {
        let [x, y] = crop.region.torso_px.map(f64::from);
        let cell = crop.grid.cell(Pixel::new(x, y));
        let at = cell.y.round() as usize * into.width() + cell.x.round() as usize;
        assert_eq!((into.keypoints(), crop.floor), (17, 15));
        assert!((crop.sigma_cells - 3.0).abs() < 1e-12);
        for keypoint in 0..into.keypoints() {
            into.cells_mut(keypoint)[at] = 200;
        }
    }

    fn persons(&self) -> Vec<Vec<Option<KeypointCandidate>>> {
        candidates(333.0, 222.0).persons
    }
}

#[test]
fn painted_maps_use_the_box_at_the_tick_of_the_frame() {
    let mut edge = EdgePipeline::new(&venue(&[PAINTED]), ViewpointIndex(0), None, None).unwrap();
    let mut camera_box = box_at(0, [280.0, 240.0], 1.2);
    camera_box.rate.center_px = [10.0, 0.0];
    let mut boxes = boxes(&[0, 1], vec![vec![camera_box]]);
    boxes.tick = Tick(36);
    let frames = [Some(frame(FrameContent::Painted(Arc::new(OneCellPainter))))];
    let output = step(&mut edge, &frames, &boxes).unwrap();
    let patch = patches(&output)[0];
    assert_eq!(
        (
            patch.crops[0].width,
            patch.crops[0].height,
            patch.capture_offset_us
        ),
        (72, 96, -250)
    );
    assert_near(peak_of(patch, 16), 320.0, 240.0);
    let sighting = &output.sighting_sets[0].sightings[0];
    let found_px = sighting.keypoints[3].unwrap().position_px;
    assert_near(Some(found_px.map(f64::from)), 333.0, 222.0);
}

#[test]
fn pictures_and_keypoints_may_be_mixed_in_one_viewpoint() {
    let mut edge = pipeline(&[PICTURES, KEYPOINTS]);
    let frames = [
        Some(disc(330.0, 220.0)),
        Some(frame(FrameContent::Keypoints(candidates(333.0, 222.0)))),
    ];
    let persons = vec![
        vec![box_at(0, [320.0, 240.0], 0.0)],
        vec![box_at(1, [320.0, 240.0], 0.0)],
    ];
    let output = step(&mut edge, &frames, &boxes(&[], persons)).unwrap();
    let widths: Vec<u16> = patches(&output).iter().map(|p| p.maps.width).collect();
    assert_eq!(widths, [12, 48]);
}

#[test]
fn mismatched_inputs_are_refused() {
    let refused =
        |sources: &[&str]| EdgePipeline::new(&venue(sources), ViewpointIndex(0), None, None).err();
    assert!(
        matches!(refused(&[PICTURES]), Some(PipelineError::NoNetwork { camera }) if camera == "c0")
    );
    let mut edge = pipeline(&[PICTURES]);
    let boxes = boxes(&[], Vec::new());
    assert!(matches!(
        step(&mut edge, &[], &boxes),
        Err(PipelineError::FrameCount {
            got: 0,
            expected: 1
        })
    ));
    let small = Some(frame(FrameContent::Image(RgbImage::new(320, 240).into())));
    let error = step(&mut edge, &[small], &boxes).unwrap_err().to_string();
    assert!(
        error.contains("320 x 240") && error.contains("640 x 480"),
        "{error}"
    );
    let mut late = disc(5.0, 5.0);
    late.tick = Tick(41);
    assert!(matches!(
        step(&mut edge, &[Some(late)], &boxes),
        Err(PipelineError::OtherTick {
            got: Tick(41),
            expected: Tick(40)
        })
    ));
    let other = BoxSet {
        viewpoint: ViewpointIndex(3),
        ..boxes
    };
    assert!(matches!(
        step(&mut edge, &[None], &other),
        Err(PipelineError::OtherViewpoint { .. })
    ));
}
