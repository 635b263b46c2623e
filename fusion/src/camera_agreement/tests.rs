//! Tests of the reported causes, one mistake at a time.

mod displaced;

use farfield_proto::message::agreement::AgreementVerdict;

use super::fixture::{Hall, Mistake, TICKS, names};
use super::*;

#[test]
fn valid_cameras_agree() {
    let report = Hall::default().report();
    assert_eq!(report.disagreements, []);
    for (name, camera) in &report.cameras {
        assert_eq!(camera.verdict, AgreementVerdict::Agrees, "{name}");
        assert!(camera.distance_mm.unwrap() < 30.0, "{name} {camera:?}");
        assert!(camera.late_ticks.unwrap().abs() < 0.2, "{name} {camera:?}");
    }
}

#[test]
fn every_swapped_pair_is_named() {
    for a in 0..4 {
        for b in a + 1..4 {
            let mut hall = Hall::default();
            hall.shows.swap(a, b);
            let causes = hall.causes();
            match causes.as_slice() {
                // If cameras stand opposite each other, either pair may be the swapped one.
                [(cameras, DisagreementCause::Swapped)] => {
                    let both = names(&[a, b]);
                    assert!(
                        cameras.chunks(2).any(|pair| pair == both),
                        "{a} {b}: {cameras:?}"
                    );
                    assert!(cameras.len() == 2 || b == a + 2, "{a} {b}: {cameras:?}");
                }
                other => panic!("cameras {a} and {b}: {other:?}"),
            }
        }
    }
}

#[test]
fn mirrored_upside_down_and_duplicate_pictures_are_named() {
    let mirrored = Mistake {
        mirrored: true,
        ..Mistake::default()
    };
    let expected = (names(&[1]), DisagreementCause::Mirrored);
    assert_eq!(Hall::with(1, mirrored).causes(), [expected]);
    let half_turned = Mistake {
        half_turned: true,
        ..Mistake::default()
    };
    let expected = (names(&[2]), DisagreementCause::HalfTurned);
    assert_eq!(Hall::with(2, half_turned).causes(), [expected]);
    let mut hall = Hall::default();
    hall.shows[3].0 = 0;
    let causes = hall.causes();
    assert_eq!(causes.len(), 1, "{causes:?}");
    assert_eq!(causes[0].1, DisagreementCause::SamePictures);
}

#[test]
fn keypoints_in_another_order_are_named() {
    let sides = [0, 2, 1, 4, 3, 6, 5, 8, 7, 10, 9, 12, 11, 14, 13, 16, 15];
    // From the ankles up, as in MPII and its successors.
    let upwards = std::array::from_fn(|k| 16 - k);
    // By limbs, as in OpenPose.
    let by_limbs = [0, 5, 6, 8, 10, 7, 9, 12, 14, 16, 11, 13, 15, 2, 1, 4, 3];
    for (order, is_of_sides) in [(sides, true), (upwards, false), (by_limbs, false)] {
        let mistake = Mistake {
            order: Some(order.map(|k: usize| k as u8)),
            ..Mistake::default()
        };
        match Hall::with(2, mistake).causes().as_slice() {
            [(cameras, DisagreementCause::KeypointOrder { moved, sides })] => {
                assert_eq!(*cameras, names(&[2]));
                assert_eq!(*sides, is_of_sides, "{order:?}");
                assert!(*moved >= 8, "{order:?}: {moved}");
            }
            other => panic!("{order:?}: {other:?}"),
        }
    }
}

#[test]
fn another_focal_length_is_reported_with_its_factor() {
    for focal_factor in [0.8, 0.92, 1.08] {
        let mistake = Mistake {
            focal_factor,
            ..Mistake::default()
        };
        match Hall::with(1, mistake).causes().as_slice() {
            [(cameras, DisagreementCause::FocalLength { factor })] => {
                assert_eq!(*cameras, names(&[1]));
                assert!((factor - f64::from(focal_factor)).abs() < 0.02, "{factor}");
            }
            other => panic!("{focal_factor}: {other:?}"),
        }
    }
}

#[test]
fn turns_of_two_degrees_and_rolls_of_five_are_reported() {
    for turned_deg in [
        [2.0, 0.0, 0.0],
        [0.0, 2.0, 0.0],
        [0.0, -2.0, 0.0],
        [0.0, 0.0, 5.0],
    ] {
        let mistake = Mistake {
            turned_deg,
            ..Mistake::default()
        };
        for camera in 0..4 {
            match Hall::with(camera, mistake).causes().as_slice() {
                [(cameras, DisagreementCause::Turned { degrees })] => {
                    assert_eq!(*cameras, names(&[camera]), "{turned_deg:?}");
                    let expected = turned_deg.iter().map(|d| d.abs()).sum::<f64>();
                    assert!(
                        (degrees - expected).abs() < 0.3,
                        "{turned_deg:?}: {degrees}"
                    );
                }
                other => panic!("camera {camera} by {turned_deg:?}: {other:?}"),
            }
        }
    }
}

#[test]
fn a_late_camera_does_not_seem_turned_if_all_walk_one_way() {
    let mut hall = Hall::with(
        2,
        Mistake {
            late_ticks: 4,
            ..Mistake::default()
        },
    );
    hall.one_way = true;
    match hall.causes().as_slice() {
        [(cameras, DisagreementCause::Late { ticks })] => {
            assert_eq!(*cameras, names(&[2]));
            assert!((ticks - 4.0).abs() < 0.5, "{ticks}");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn lateness_is_reported_to_a_fifth_of_a_tick() {
    for late_ticks in [1, 3, 30, -3, -45] {
        let mistake = Mistake {
            late_ticks,
            ..Mistake::default()
        };
        let causes = Hall::with(2, mistake).causes();
        match causes.as_slice() {
            [(cameras, DisagreementCause::Late { ticks })] => {
                assert_eq!(*cameras, names(&[2]));
                assert!(
                    (ticks - late_ticks as f64).abs() < 0.2,
                    "{ticks}, not {late_ticks}"
                );
            }
            other => panic!("{late_ticks}: {other:?}"),
        }
    }
}

#[test]
fn a_camera_at_another_rate_drifts() {
    let mistake = Mistake {
        later_each_burst: 2,
        ..Mistake::default()
    };
    let hall = Hall {
        bursts: 3,
        ..Hall::with(1, mistake)
    };
    match hall.causes().as_slice() {
        // Two ticks in ten seconds.
        [(cameras, DisagreementCause::Drifts { ticks_per_minute })] => {
            assert_eq!(*cameras, names(&[1]));
            assert!((ticks_per_minute - 12.0).abs() < 2.0, "{ticks_per_minute}");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn people_of_half_size_reveal_the_unit_of_the_calibration() {
    let hall = Hall {
        scale: 0.55,
        ..Hall::default()
    };
    let report = hall.report();
    match report.disagreements.as_slice() {
        [
            Disagreement {
                cause: DisagreementCause::WorldScale { stature_m, .. },
                ..
            },
        ] => assert!((stature_m - 0.96).abs() < 0.01, "{stature_m}"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_wrong_floor_is_reported_if_nothing_else_is_wrong() {
    let sunk = Hall {
        floor_m: -1.04,
        ..Hall::default()
    };
    let report = sunk.report();
    let [disagreement] = report.disagreements.as_slice() else {
        panic!("{:?}", report.disagreements);
    };
    assert_eq!(
        disagreement.found,
        "everybody who stands is 1.04 m under the floor (at z = -1.04 m, `floor_m` is 0.00 m)"
    );
    assert!(disagreement.remedy.contains("`[field] floor_m`"));
    let on_a_stage = Hall {
        floor_m: 0.6,
        ..Hall::default()
    };
    let causes = on_a_stage.causes();
    let [(_, DisagreementCause::FloorHeight { above_m, floor_m })] = &causes[..] else {
        panic!("{causes:?}");
    };
    assert!((above_m - 0.6).abs() < 0.005, "{above_m}");
    assert!(floor_m.abs() < f64::EPSILON, "{floor_m}");
    // A wrong unit also moves feet, and only the unit is reported.
    let in_another_unit = Hall {
        scale: 0.55,
        floor_m: -1.04,
        ..Hall::default()
    };
    let causes = in_another_unit.causes();
    assert!(
        matches!(&causes[..], [(_, DisagreementCause::WorldScale { .. })]),
        "{causes:?}"
    );
    // A mirrored camera moves people, and only the mirror is reported.
    let mirrored = Mistake {
        mirrored: true,
        ..Mistake::default()
    };
    let hall = Hall {
        floor_m: -1.04,
        ..Hall::with(1, mirrored)
    };
    assert_eq!(hall.causes(), [(names(&[1]), DisagreementCause::Mirrored)]);
}

#[test]
fn three_cameras_with_cyclic_wrong_names_are_reported() {
    let hall = Hall {
        shows: [0, 2, 3, 1].map(|camera| (camera, Mistake::default())),
        ..Hall::default()
    };
    let causes = hall.causes().into_iter();
    let blamed: BTreeSet<String> = causes.flat_map(|(names, _)| names).collect();
    let ring: BTreeSet<String> = names(&[1, 2, 3]).into_iter().collect();
    assert!(blamed.is_superset(&ring), "{blamed:?}");
}

#[test]
fn cameras_that_show_different_people_do_not_disagree() {
    let mut hall = Hall {
        narrow: true,
        ..Hall::default()
    };
    for (camera, (_, mistake)) in hall.shows.iter_mut().enumerate() {
        mistake.sees_only = Some(1 - camera / 2);
    }
    assert_eq!(hall.report().disagreements, []);
}

#[test]
fn a_corrected_clock_does_not_drift() {
    let mistake = Mistake {
        late_ticks: 2,
        late_in_burst: Some(0),
        ..Mistake::default()
    };
    let hall = Hall {
        bursts: 4,
        ..Hall::with(1, mistake)
    };
    for (_, cause) in hall.causes() {
        assert!(
            !matches!(cause, DisagreementCause::Drifts { .. }),
            "{cause:?}"
        );
    }
}

#[test]
fn lateness_is_unknown_if_people_stand_still() {
    let hall = Hall {
        still: true,
        ..Hall::default()
    };
    let report = hall.report();
    assert_eq!(report.disagreements, []);
    assert!(
        report
            .cameras
            .values()
            .all(|camera| camera.late_ticks.is_none())
    );
}

#[test]
fn short_bursts_do_not_reveal_one_tick() {
    let mistake = Mistake {
        late_ticks: 1,
        ..Mistake::default()
    };
    for (burst_ticks, is_reported) in [(20, false), (TICKS, true)] {
        let hall = Hall {
            burst_ticks,
            ..Hall::with(2, mistake)
        };
        assert_eq!(!hall.causes().is_empty(), is_reported, "{burst_ticks}");
    }
}

#[test]
fn lateness_of_seconds_is_found_from_sightings() {
    for late_ticks in [90, 150, -110] {
        let mistake = Mistake {
            late_ticks,
            ..Mistake::default()
        };
        let hall = Hall {
            bursts: 4,
            ..Hall::with(2, mistake)
        };
        let causes = hall.causes();
        let [(cameras, DisagreementCause::Late { ticks })] = &causes[..] else {
            panic!("{late_ticks}: {causes:?}");
        };
        assert_eq!(*cameras, names(&[2]));
        assert!(
            (ticks - late_ticks as f64).abs() < 2.0,
            "{late_ticks}: {ticks}"
        );
    }
}

#[test]
fn a_wrong_distortion_is_found_in_one_camera_and_in_all() {
    for k1_over in [-0.3, 0.3] {
        let mistake = Mistake {
            k1_over,
            ..Mistake::default()
        };
        let causes = Hall::with(1, mistake).causes();
        let [(cameras, DisagreementCause::Distortion { k1_over: found })] = &causes[..] else {
            panic!("{k1_over}: {causes:?}");
        };
        assert_eq!(*cameras, names(&[1]));
        assert!(
            (found - f64::from(k1_over)).abs() < 0.1,
            "{k1_over}: {found}"
        );
        let mut hall = Hall::default();
        for (_, own) in &mut hall.shows {
            own.k1_over = k1_over;
        }
        let causes = hall.causes();
        let [(cameras, DisagreementCause::Distortion { k1_over: found })] = &causes[..] else {
            panic!("{k1_over} of all: {causes:?}");
        };
        assert_eq!(*cameras, names(&[0, 1, 2, 3]));
        assert!(
            (found - f64::from(k1_over)).abs() < 0.1,
            "{k1_over}: {found}"
        );
    }
}

#[test]
fn an_impossible_distortion_is_not_reported() {
    // A moved camera looks like one with a k1 far beyond those of lenses.
    let is_a_lens = |k1_over: f32| {
        let mistake = Mistake {
            k1_over,
            ..Mistake::default()
        };
        let causes = Hall::with(1, mistake).causes();
        assert_eq!(causes.len(), 1, "{k1_over}: {causes:?}");
        assert_eq!(causes[0].0, names(&[1]), "{k1_over}");
        matches!(causes[0].1, DisagreementCause::Distortion { .. })
    };
    assert!(is_a_lens(0.6));
    assert!(!is_a_lens(0.95));
}

#[test]
fn one_wrong_factor_of_all_focal_lengths_is_reported() {
    for focal_factor in [0.6, 0.77, 0.87, 0.95, 1.05, 1.15, 1.3, 1.6] {
        let mut hall = Hall::default();
        for (_, own) in &mut hall.shows {
            own.focal_factor = focal_factor;
        }
        let causes = hall.causes();
        let [(cameras, DisagreementCause::FocalLength { factor })] = &causes[..] else {
            panic!("{focal_factor} of all: {causes:?}");
        };
        assert_eq!(*cameras, names(&[0, 1, 2, 3]));
        assert!(
            (factor - f64::from(focal_factor)).abs() < 0.02,
            "{focal_factor}: {factor}"
        );
    }
}

#[test]
fn valid_cameras_side_by_side_keep_their_focal_lengths() {
    // If all point in the same direction, lines of sight meet equally well with any factor.
    for beyond_m in [3.0, 20.0, 1e6] {
        let hall = Hall {
            row: Some(beyond_m),
            ..Hall::default()
        };
        assert_eq!(hall.report().disagreements, [], "{beyond_m}");
    }
}

#[test]
fn mistakes_of_some_cameras_do_not_change_all_focal_lengths() {
    let zoomed = |focal_factor| Mistake {
        focal_factor,
        ..Mistake::default()
    };
    let bent = Mistake {
        k1_over: 0.3,
        ..Mistake::default()
    };
    let turned = Mistake {
        turned_deg: [0.0, 2.0, 0.0],
        ..Mistake::default()
    };
    let late = Mistake {
        late_ticks: 30,
        ..Mistake::default()
    };
    let cases: [&[(usize, Mistake)]; 7] = [
        &[(1, zoomed(0.95))],
        &[(1, zoomed(1.05))],
        &[(0, zoomed(1.15)), (1, zoomed(1.15))],
        &[(0, zoomed(1.15)), (2, zoomed(1.15))],
        &[(2, bent)],
        &[(3, turned)],
        &[(0, late), (1, late)],
    ];
    for (index, case) in cases.into_iter().enumerate() {
        let mut hall = Hall::default();
        for (camera, mistake) in case {
            hall.shows[*camera].1 = *mistake;
        }
        for (cameras, cause) in hall.causes() {
            let is_focal = matches!(cause, DisagreementCause::FocalLength { .. });
            assert!(!is_focal || cameras.len() == 1, "{index}: {cause:?}");
        }
    }
}
