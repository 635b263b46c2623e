//! The detection passes of an edge: their cameras and their messages.

use super::*;

#[test]
fn only_requested_cameras_run_the_detector() {
    let venue = venue(&[KEYPOINTS, KEYPOINTS]);
    let mut edge = EdgePipeline::new(&venue, ViewpointIndex(0), None, None).unwrap();
    let frames = [1.0, 2.0].map(|x| Some(frame(FrameContent::Keypoints(candidates(x, 2.0)))));
    for asked in [&[0][..], &[1], &[0, 1]] {
        let output = step(&mut edge, &frames, &boxes(asked, Vec::new())).unwrap();
        let sightings = output.sighting_sets.iter().flat_map(|s| &s.sightings);
        assert_eq!(sightings.map(|s| s.camera.0).collect::<Vec<_>>(), asked);
    }
    let output = step(&mut edge, &frames, &boxes(&[], Vec::new())).unwrap();
    assert!(output.sighting_sets.is_empty());
}

#[test]
fn a_pass_without_people_is_reported_only_with_a_detector() {
    let mut edge = EdgePipeline::new(&venue(&[KEYPOINTS]), ViewpointIndex(0), None, None).unwrap();
    let output = step(&mut edge, &[None], &boxes(&[0, 1], Vec::new())).unwrap();
    assert_eq!(
        (
            output.sighting_sets.len(),
            output.patch_sets[0].sighting_parts
        ),
        (1, 1)
    );
    let mut blind = pipeline(&[PICTURES]);
    let output = step(
        &mut blind,
        &[Some(disc(5.0, 5.0))],
        &boxes(&[0, 1], Vec::new()),
    )
    .unwrap();
    assert_eq!(
        (
            output.sighting_sets.len(),
            output.patch_sets[0].sighting_parts
        ),
        (0, 0)
    );
}

#[test]
fn keypoint_sources_give_grouped_sightings_without_a_network() {
    let mut edge = EdgePipeline::new(&venue(&[KEYPOINTS]), ViewpointIndex(0), None, None).unwrap();
    let frames = [Some(frame(FrameContent::Keypoints(candidates(
        333.0, 222.0,
    ))))];
    let persons = vec![vec![box_at(0, [320.0, 240.0], 1.2)]];
    let output = step(&mut edge, &frames, &boxes(&[0, 1], persons)).unwrap();
    let patch = patches(&output)[0];
    assert_eq!(
        (
            patch.crops.len(),
            patch.crops[0].width,
            patch.crops[0].height
        ),
        (1, 48, 64)
    );
    let [x, y] = peak_of(patch, 11).unwrap();
    assert!((x - 333.0).hypot(y - 222.0) < 0.2);
    assert_eq!(output.sighting_sets[0].sightings.len(), 1);
    assert_eq!(output.patch_sets[0].sighting_parts, 1);
    let all = output
        .patch_sets
        .iter()
        .map(|set| wire::decode::<PatchSet>(&wire::encode(set)).unwrap());
    assert_eq!(all.collect::<Vec<_>>(), output.patch_sets);
}

/// The sightings of the box at `at` in a picture with the disc there, of a person detected `ticks`
/// before at `detected_at`.
fn sighted_after(detected_at: f32, ticks: i64, at: f64, boxes: &BoxSet) -> Vec<Sighting> {
    let mut edge = pipeline(&[PICTURES]);
    let detections = [CameraDetections {
        camera: CameraIndex(0),
        tick: Tick(40 - ticks),
        people: vec![Detection {
            min_px: [detected_at - 30.0, 200.0],
            max_px: [detected_at + 30.0, 280.0],
            score: 0.9,
        }],
    }];
    let request = StepRequest {
        detections: Some(&detections),
        persons: Some(&[]),
        ..StepRequest::of(boxes)
    };
    let frames = [Some(disc(at, 240.0))];
    let output = edge.step(&frames, &request, &mut |_| {}).unwrap();
    assert!(output.patch_sets.iter().all(|set| set.persons.is_empty()));
    let sets = output.sighting_sets.into_iter();
    sets.flat_map(|set| set.sightings).collect()
}

#[test]
fn a_detected_person_is_cropped_at_its_moved_box() {
    let mut with_box = box_at(0, [400.0, 240.0], 0.0);
    with_box.rate.center_px = [5.0, 0.0];
    let boxes = boxes(&[0], vec![vec![with_box]]);
    // 20 ticks before, the person was 100 px to the left of the current position of disc and box.
    let sightings = sighted_after(300.0, 20, 400.0, &boxes);
    let peak = sightings[0].keypoints[0].expect("the disc is in the crop");
    assert!((peak.position_px[0] - 400.0).abs() < 3.0, "{peak:?}");
}

#[test]
fn a_detected_person_without_a_box_is_cropped_in_place() {
    let elsewhere = box_at(0, [560.0, 240.0], 0.0);
    for persons in [vec![], vec![vec![elsewhere]]] {
        let boxes = boxes(&[0], persons);
        let seen = |at| sighted_after(300.0, 20, at, &boxes)[0].keypoints[0];
        assert!(seen(310.0).is_some(), "a person who has hardly moved");
        assert_eq!(seen(400.0), None, "a person who has left");
    }
}
