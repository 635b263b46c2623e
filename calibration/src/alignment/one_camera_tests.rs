//! The marks of one camera: which agree, which do not, and what they leave undetermined.

use farfield_proto::court::Court;

use super::tests::{court_marks, on_line, venue};
use super::*;

/// Some marks of a futsal court that the first camera of the venue sees, from the near goal to the far corner.
const SEEN: [&str; 7] = [
    "penalty_area_front_north_west",
    "penalty_area_front_south_west",
    "halfway_south",
    "halfway_north",
    "goal_post_foot_south_west",
    "corner_south_east",
    "centre_circle_north",
];

/// Marks of the first camera alone, clicked with an error of `sigma_px`.
fn seen_by_first(names: &[&str], sigma_px: f64, seed: u64) -> Marks {
    let mut marks = court_marks(&venue()[..1].to_vec(), names, sigma_px, seed);
    marks.court = Court::of("futsal", None).ok();
    assert!(
        marks.known.iter().all(|mark| mark.clicks.len() == 1),
        "the camera sees all of them"
    );
    marks
}

fn fitted(marks: &Marks) -> OneCameraFit {
    fit_one_camera(marks, "c0", &venue()[0].1).unwrap()
}

#[test]
fn the_pose_of_one_camera_follows_from_its_marks() {
    let truth = &venue()[0].1;
    let exact = fitted(&seen_by_first(&SEEN, 0.0, 1));
    assert!((exact.state.center_w - truth.center_w).norm() < 1e-4);
    assert!(exact.rms_px < 1e-4 && exact.contradiction.is_none() && !exact.is_under_floor);
    for seed in 0..20 {
        let found = fitted(&seen_by_first(&SEEN, 0.7, seed));
        let off_m = (found.state.center_w - truth.center_w).norm();
        println!("{off_m:.3} m off, {:.2} px", found.rms_px);
        assert!(
            off_m < 0.5 && found.rms_px < 2.0,
            "{off_m} m, {} px",
            found.rms_px
        );
        assert!(found.residuals.iter().all(|it| !it.is_outlier));
    }
}

#[test]
fn a_wrong_corner_is_an_outlier_also_among_few() {
    for (wrong, name) in SEEN.iter().enumerate() {
        for count in [6, 7] {
            if wrong >= count {
                continue;
            }
            let mut marks = seen_by_first(&SEEN[..count], 0.5, 3);
            marks.known[wrong].clicks[0].1[0] += 60.0;
            marks.known[wrong].clicks[0].1[1] += 25.0;
            let found = fitted(&marks);
            let named: Vec<&str> = found
                .residuals
                .iter()
                .filter(|it| it.is_outlier)
                .map(|it| it.name.as_str())
                .collect();
            assert_eq!(named, [*name], "of {count}");
        }
    }
}

#[test]
fn two_marks_with_exchanged_names_are_both_outliers() {
    let mut marks = seen_by_first(&SEEN, 0.5, 5);
    let other = marks.known[4].clicks.clone();
    marks.known[4].clicks = std::mem::replace(&mut marks.known[5].clicks, other);
    let found = fitted(&marks);
    let named: Vec<&str> = found
        .residuals
        .iter()
        .filter(|it| it.is_outlier)
        .map(|it| it.name.as_str())
        .collect();
    assert_eq!(named, [SEEN[4], SEEN[5]]);
}

#[test]
fn lines_are_fitted_with_marks() {
    let mut marks = seen_by_first(&SEEN[..4], 0.0, 1);
    marks.known.push(on_line(&venue(), 0, "touchline_south"));
    let found = fitted(&marks);
    assert_eq!(found.residuals.len(), 4 + marks.known[4].clicks.len());
    assert!(found.rms_px < 1e-3, "{}", found.rms_px);
    marks.known[4].clicks[0].1[1] += 40.0;
    let off = fitted(&marks);
    let most = off
        .residuals
        .iter()
        .filter_map(|it| it.px)
        .fold(0.0, f64::max);
    assert!(most > 5.0, "a click off its line has a residual: {most} px");
}

#[test]
fn too_few_marks_are_refused_with_their_number() {
    let lens = &venue()[0].1;
    let three = fit_one_camera(&seen_by_first(&SEEN[..3], 0.0, 1), "c0", lens);
    assert_eq!(three, Err(OneCameraError::TooFew { found: 3 }));
    let along = [
        "halfway_north",
        "centre_circle_north",
        "centre",
        "halfway_south",
    ];
    let line = fit_one_camera(&seen_by_first(&along, 0.0, 1), "c0", lens);
    assert_eq!(line, Err(OneCameraError::OnALine));
}

#[test]
fn a_door_rules_out_a_half_turn_that_a_court_alone_allows() {
    let mut marks = seen_by_first(&SEEN, 0.5, 1);
    assert_eq!(fitted(&marks).half_turn, HalfTurn::FitsAsWell);
    let state = &venue()[0].1;
    let door_m = [-4.0, -6.0, 0.0];
    let px = state.project(&door_m.into(), state.fold_radius()).unwrap();
    marks.known.push(KnownMark {
        name: "door".to_owned(),
        known: Known::Place(door_m),
        clicks: vec![("c0".to_owned(), px.into())],
    });
    assert_eq!(fitted(&marks).half_turn, HalfTurn::RuledOut);
}

#[test]
fn lines_rule_out_a_half_turn_unless_they_are_symmetric() {
    let mut marks = seen_by_first(&SEEN, 0.0, 1);
    // Places that do not belong to the court do not turn with it.
    for (number, mark) in marks.known.iter_mut().enumerate() {
        mark.name = format!("own {number}");
    }
    for (line, expected) in [
        ("touchline_south", HalfTurn::RuledOut),
        ("halfway_line", HalfTurn::FitsAsWell),
    ] {
        let mut with_line = marks.clone();
        with_line.known.push(on_line(&venue(), 0, line));
        let found = fitted(&with_line);
        assert!(found.rms_px < 1e-3, "{line}: {}", found.rms_px);
        assert_eq!(found.half_turn, expected, "{line}");
    }
}

#[test]
fn a_court_clicked_mirrored_puts_the_camera_under_the_floor() {
    let mut marks = seen_by_first(&SEEN, 0.0, 1);
    for mark in &mut marks.known {
        if let Known::Place(at_m) = &mut mark.known {
            at_m[1] = -at_m[1];
        }
    }
    assert!(fitted(&marks).is_under_floor);
}

#[test]
fn the_court_is_drawn_at_the_pixels_that_the_camera_saw() {
    let court = Court::of("futsal", None).unwrap();
    let state = &venue()[0].1;
    let marks = drawn_marks(&court, state, [1920, 1200]);
    let clicked = seen_by_first(&SEEN, 0.0, 1);
    for mark in &clicked.known {
        let (_, px) = marks.iter().find(|(name, _)| *name == mark.name).unwrap();
        let [x, y] = mark.clicks[0].1;
        assert!((px[0] - x).abs() + (px[1] - y).abs() < 1e-6);
    }
    let lines = drawn_lines(&court, state, [1920, 1200]);
    let (_, touchline) = lines
        .iter()
        .find(|(name, _)| name == "touchline_south")
        .unwrap();
    let corner = marks
        .iter()
        .find(|(name, _)| name == "corner_south_east")
        .unwrap()
        .1;
    let nearest = touchline
        .iter()
        .flatten()
        .map(|px| (px[0] - corner[0]).hypot(px[1] - corner[1]));
    assert!(
        nearest.fold(f64::INFINITY, f64::min) < 1e-6,
        "a line ends in its corner"
    );
    let longest = touchline
        .iter()
        .flat_map(|piece| piece.windows(2))
        .map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]));
    assert!(longest.fold(0.0, f64::max) < 400.0);
}
