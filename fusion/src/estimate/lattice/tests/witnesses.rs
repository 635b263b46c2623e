//! Weights of views: neighbours, opposite views, hidden ones.

use super::*;

#[test]
fn two_close_viewpoints_have_one_vote() {
    // They agree on a wrong wrist; two views from elsewhere see the right one a little less
    // clearly.
    let truth = standing();
    let mut views = perfect(&ring(&[10.0, 11.0, 120.0, 240.0]), &truth);
    let wrong = truth[LEFT_WRIST] + Vector3::new(0.0, 0.0, 0.2);
    for (i, view) in views.iter_mut().enumerate() {
        view.draw_for_test(LEFT_WRIST, |_, _| -1.0);
        if i < 2 {
            draw(view, LEFT_WRIST, wrong, 0.9);
        } else {
            draw(view, LEFT_WRIST, truth[LEFT_WRIST], 0.7);
        }
    }
    let wrist = &search(&mut views, &shifted(&truth, [0.0, 0.0, 0.1]))[LEFT_WRIST];
    assert!((wrist.position_m - truth[LEFT_WRIST]).norm() < 0.02);
    assert_eq!(wrist.views, 2);
}

#[test]
fn two_opposite_viewpoints_are_one_witness_between_them() {
    // At the height of the hips their rays are one line: they fix a keypoint across it, but not
    // along it.
    let truth = standing();
    let opposite = ring(&[20.0, 200.0]);
    let level = |model: &CameraModel| {
        let eye_m = model.center().coordinates_m().coords;
        camera_at(Vector3::new(eye_m.x, eye_m.y, 0.9))
    };
    let models: Vec<_> = opposite.iter().map(level).collect();
    let mut views = perfect(&models, &truth);
    for hip in &search(&mut views, &shifted(&truth, [0.03, 0.02, 0.0]))[HIPS] {
        assert_eq!(hip.views, 1);
        assert!(hip.ray.is_some());
    }
    // A third view from the side gives a second line, and a place.
    let mut views = perfect(&[models, ring(&[110.0])].concat(), &truth);
    for hip in &search(&mut views, &shifted(&truth, [0.03, 0.02, 0.0]))[HIPS] {
        assert_eq!(hip.views, 2);
        assert!(hip.ray.is_none());
    }
}

#[test]
fn a_blind_viewpoint_takes_no_share_of_its_neighbour() {
    // The views at 10 and 11 degrees would count as one. But of them only the first, and the one at
    // 120 degrees, see the wrist: two witnesses.
    let truth = standing();
    let mut views = perfect(&ring(&[10.0, 11.0, 120.0, 121.0]), &truth);
    for i in [1, 3] {
        views[i].draw_for_test(LEFT_WRIST, |_, _| -1.0);
    }
    let wrist = &search(&mut views, &truth)[LEFT_WRIST];
    assert_eq!(wrist.views, 2);
    assert!(wrist.ray.is_none());
}

#[test]
fn occlusion_lowers_weight_and_vote_of_a_view() {
    let truth = standing();
    let mut views = perfect(&four(), &truth);
    let free = search(&mut views, &truth)[LEFT_WRIST].weight;
    for view in &mut views {
        view.occlusion[LEFT_WRIST] = 0.3;
    }
    let occluded = search(&mut views, &truth)[LEFT_WRIST].weight;
    assert!((occluded / free - 0.3).abs() < 1e-9);
}

/// Twelve views all round; those from `blocked` on show nothing of these keypoints.
fn twelve(truth: &[Vector3<f64>], blocked: usize, keypoints: &[usize]) -> Vec<View> {
    let bearings: Vec<f64> = (0..12).map(|i| 10.0 + 85.0 * f64::from(i)).collect();
    let mut views = perfect(&ring(&bearings), truth);
    for view in &mut views[blocked..] {
        for &keypoint in keypoints {
            view.draw_for_test(keypoint, |_, _| -1.0);
        }
    }
    views
}

#[test]
fn ten_hidden_views_do_not_weaken_two_that_see() {
    let truth = standing();
    let everything: Vec<usize> = (0..truth.len()).collect();
    let mut views = twelve(&truth, 2, &everything);
    let near = shifted(&truth, [0.05, 0.0, 0.03]);
    for (estimate, truth) in search(&mut views, &near).iter().zip(&truth) {
        assert!(estimate.weight > 0.8 && estimate.views == 2, "{estimate:?}");
        assert!((estimate.position_m - truth).norm() < 0.02);
    }
}

#[test]
fn silent_views_of_a_visible_person_count_against_a_wrist() {
    let truth = standing();
    let mut views = twelve(&truth, 2, &[LEFT_WRIST]);
    let wrist = &search(&mut views, &truth)[LEFT_WRIST];
    assert!(wrist.support < 0.3, "{wrist:?}");
}
