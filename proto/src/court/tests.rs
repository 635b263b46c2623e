//! Tests of courts against the rules and against their own symmetry.

use std::collections::BTreeSet;
use std::f64::consts::{FRAC_PI_2, TAU};

use super::*;

fn all() -> Vec<Court> {
    Court::names()
        .into_iter()
        .map(|name| Court::of(name, None).unwrap())
        .collect()
}

fn at(court: &str, mark: &str) -> [f64; 3] {
    Court::of(court, None)
        .unwrap()
        .mark(mark)
        .unwrap()
        .position_m
}

/// Start and end of a line.
fn ends(line: &CourtLine) -> [[f64; 2]; 2] {
    match line.shape {
        LineShape::Segment { from_m, to_m } => [from_m, to_m],
        LineShape::Arc {
            centre_m,
            radius_m,
            from_rad,
            by_rad,
        } => {
            let at = |turn: f64| {
                [
                    centre_m[0] + radius_m * libm::cos(turn),
                    centre_m[1] + radius_m * libm::sin(turn),
                ]
            };
            [at(from_rad), at(from_rad + by_rad)]
        }
    }
}

#[test]
fn names_are_unique() {
    for court in all() {
        let names: BTreeSet<&str> = court.marks.iter().map(|m| m.name.as_str()).collect();
        assert_eq!(names.len(), court.marks.len(), "{}", court.name);
        let lines: BTreeSet<&str> = court.lines.iter().map(|l| l.name.as_str()).collect();
        assert_eq!(lines.len(), court.lines.len(), "{}", court.name);
    }
}

#[test]
fn a_court_turned_by_half_a_turn_is_the_same_court() {
    for court in all() {
        for mark in &court.marks {
            let [x, y, z] = mark.position_m;
            let has_twin = court.marks.iter().any(|other| {
                let [u, v, w] = other.position_m;
                libm::hypot(u + x, v + y) < 1e-9 && (w - z).abs() < 1e-9
            });
            assert!(has_twin, "{} of {}", mark.name, court.name);
        }
    }
}

#[test]
fn lines_stay_inside_and_meet_others() {
    for court in all() {
        let half = court.size_m.map(|s| 0.5 * s + 1e-9);
        for line in &court.lines {
            for [x, y] in ends(line) {
                assert!(
                    x.abs() <= half[0] && y.abs() <= half[1],
                    "{} of {}: {x} {y}",
                    line.name,
                    court.name
                );
            }
        }
    }
}

#[test]
fn arcs_of_areas_join_their_straight_parts() {
    for (court, front, arc) in [
        ("futsal", "penalty_area_front", "penalty_area_arc"),
        ("handball", "goal_area_front", "goal_area_arc"),
        ("handball", "free_throw_front", "free_throw_arc"),
        ("basketball", "three_point_side", "three_point_arc"),
        ("football", "penalty_area_front", "penalty_arc"),
    ] {
        let court = Court::of(court, None).unwrap();
        let arcs = court.lines.iter().filter(|line| line.name.starts_with(arc));
        for arc in arcs {
            let joins = court
                .lines
                .iter()
                .filter(|line| line.name.starts_with(front))
                .any(|line| {
                    ends(arc).iter().any(|[x, y]| {
                        let [[ax, ay], [bx, by]] = ends(line);
                        let across = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)).abs();
                        across / libm::hypot(bx - ax, by - ay) < 1e-9
                    })
                });
            assert!(joins, "{} of {}", arc.name, court.name);
        }
    }
}

#[test]
fn positions_agree_with_the_rules() {
    let near = |found: [f64; 3], expected: [f64; 3]| {
        assert!(
            found
                .iter()
                .zip(expected)
                .all(|(a, b)| (a - b).abs() < 1e-9),
            "{found:?} {expected:?}"
        );
    };
    near(at("football", "corner_north_west"), [-52.5, 34.0, 0.0]);
    near(at("football", "penalty_spot_east"), [41.5, 0.0, 0.0]);
    near(
        at("football", "penalty_area_front_south_west"),
        [-36.0, -20.16, 0.0],
    );
    near(at("futsal", "second_penalty_spot_west"), [-10.0, 0.0, 0.0]);
    near(at("futsal", "goal_crossbar_north_east"), [20.0, 1.5, 2.0]);
    near(
        at("handball", "seven_metre_line_north_west"),
        [-13.0, 0.5, 0.0],
    );
    near(
        at("basketball", "free_throw_line_north_east"),
        [8.2, 1.8, 0.0],
    );
    near(at("tennis", "service_line_north_west"), [-6.4, 4.115, 0.0]);
    near(at("volleyball", "attack_line_south_east"), [3.0, -4.5, 0.0]);
    // FIBA draws the junction of arc and straight part at 2.99 m from the end line.
    let [x, ..] = at("basketball", "three_point_bend_north_west");
    assert!((14.0 + x - 2.99).abs() < 0.005);
}

#[test]
fn circles_are_whole() {
    let football = Court::of("football", None).unwrap();
    let LineShape::Arc {
        radius_m, by_rad, ..
    } = football.line("centre_circle").unwrap().shape
    else {
        panic!("a circle is an arc");
    };
    assert!((radius_m - 9.15).abs() < 1e-12 && (by_rad - TAU).abs() < 1e-12);
}

#[test]
fn an_unknown_court_and_an_invalid_size_are_refused() {
    let error = Court::of("fotball", None).unwrap_err();
    assert!(error.contains("did you mean `football`"), "{error}");
    let error = Court::of("futsal", Some([20.0, 40.0])).unwrap_err();
    assert!(
        error.contains("expected 25 to 42 m by 15 to 25 m"),
        "{error}"
    );
    assert!(Court::of("futsal", Some([38.0, f64::NAN])).is_err());
    let small = Court::of("futsal", Some([36.0, 18.0])).unwrap();
    assert!((small.mark("corner_south_east").unwrap().position_m[0] - 18.0).abs() < 1e-12);
}

fn futsal(centre_m: [f64; 2], turn_rad: f64) -> PlacedCourt {
    PlacedCourt {
        court: Court::of("futsal", None).unwrap(),
        centre_m,
        turn_rad,
    }
}

fn points(placed: &PlacedCourt, line: &str) -> Vec<[f64; 2]> {
    placed.points_m(&placed.court.line(line).unwrap().shape)
}

#[test]
fn a_court_lies_about_its_middle_along_x_or_turned() {
    let near = |a: &[[f64; 2]], b: [[f64; 2]; 2]| {
        let far = a.iter().flatten().zip(b.as_flattened());
        far.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) < 1e-12
    };
    let straight = points(&futsal([1.0, 2.0], 0.0), "touchline_north");
    assert!(
        near(&straight, [[-19.0, 12.0], [21.0, 12.0]]),
        "{straight:?}"
    );
    let turned = points(&futsal([1.0, 2.0], FRAC_PI_2), "touchline_north");
    assert!(near(&turned, [[-9.0, -18.0], [-9.0, 22.0]]), "{turned:?}");
}

#[test]
fn arcs_are_drawn_on_their_circle_from_end_to_end() {
    let circle = points(&futsal([0.0; 2], 0.3), "centre_circle");
    assert_eq!(circle.len(), 73);
    for [x, y] in &circle {
        assert!((libm::hypot(*x, *y) - 3.0).abs() < 1e-12);
    }
    let quarter = points(&futsal([0.0; 2], 0.0), "penalty_area_arc_north_west");
    assert_eq!(quarter.len(), 19);
    let (first, last) = (quarter[0], quarter[18]);
    assert!((first[0] + 14.0).abs() < 1e-9, "{first:?}");
    assert!((last[0] + 20.0).abs() < 1e-9, "{last:?}");
}
