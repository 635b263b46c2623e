//! The detection passes of an edge: on which cameras, and what is said of them.

use super::*;

#[test]
fn only_the_cameras_that_are_asked_run_the_detector() {
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
fn a_pass_without_people_is_reported_and_an_edge_without_a_detector_reports_no_pass() {
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
fn keypoint_sources_need_no_network_and_are_sighted_as_grouped() {
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
