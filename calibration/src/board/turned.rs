//! Detects pictures that were taken with the camera turned by half a turn. A chessboard looks the same then, but the principal
//! point lies on the other side of the picture's middle.

use nalgebra::{Isometry3, UnitQuaternion, Vector2, Vector3};

use super::adjust::{Sighting, State, adjust, adjust_pose, residuals};
use super::projection::Optics;

/// Distances of the principal point from the middle at which the search starts, relative to the picture's longer side.
const DISTANCES: [f64; 2] = [0.01, 0.03];
/// Number of directions, over half a circle: a half turn of all pictures is equivalent.
const DIRECTIONS: usize = 4;
/// Most rounds of classifying and fitting.
const ROUNDS: usize = 6;
/// Least relative decrease of the squared residuals when pictures are turned back.
const LEAST_SHARE: f64 = 0.06;
/// Least gain of each turned picture, in variances of a coordinate: a choice among many has a small gain from noise alone.
const LEAST_GAIN: f64 = 15.0;

/// Whether each picture was turned by half a turn, if a minority was; `None` without sufficient evidence.
pub(super) fn turned(
    size_px: [u32; 2],
    state: &State,
    sightings: &[Sighting],
) -> Option<Vec<bool>> {
    let pictures = Pictures::new(size_px, state, sightings);
    let start = pictures.start(&state.optics)?;
    let mut turned: Vec<bool> = start.iter().map(Costs::is_turned).collect();
    let mut last = None;
    for _ in 0..ROUNDS {
        let fitted = pictures.fit(&state.optics, &turned)?;
        let costs = pictures.costs(&fitted.optics)?;
        let next: Vec<bool> = costs.iter().map(Costs::is_turned).collect();
        let is_settled = next == turned;
        turned = next;
        last = Some(costs);
        if is_settled {
            break;
        }
    }
    let costs = last?;
    if 2 * turned.iter().filter(|it| **it).count() > turned.len() {
        for it in &mut turned {
            *it = !*it;
        }
    }
    let before: f64 = pictures
        .costs(&state.optics)?
        .iter()
        .map(|it| it.as_is)
        .sum();
    let after: f64 = costs.iter().map(|it| it.as_is.min(it.turned)).sum();
    let coordinates: usize = sightings.iter().map(|it| 2 * it.pixels.len()).sum();
    let variance = after / (coordinates as f64 - 6.0 * sightings.len() as f64).max(1.0);
    let has_gained = |it: &Costs| (it.as_is - it.turned).abs() > LEAST_GAIN * variance;
    for (it, costs) in turned.iter_mut().zip(&costs) {
        *it &= has_gained(costs);
    }
    let is_much = before - after > LEAST_SHARE * before;
    (is_much && turned.contains(&true)).then_some(turned)
}

/// Squared residuals of a picture with one camera, square pixels.
struct Costs {
    as_is: f64,
    turned: f64,
}

impl Costs {
    fn is_turned(&self) -> bool {
        self.turned < self.as_is
    }
}

/// Every picture as given, and turned back.
struct Pictures<'a> {
    middle_px: Vector2<f64>,
    side_px: f64,
    as_is: Vec<(&'a Sighting, Isometry3<f64>)>,
    turned: Vec<(Sighting, Isometry3<f64>)>,
}

impl<'a> Pictures<'a> {
    fn new(size_px: [u32; 2], state: &State, sightings: &'a [Sighting]) -> Self {
        let [width, height] = size_px.map(f64::from);
        let middle_px = 0.5 * Vector2::new(width - 1.0, height - 1.0);
        let half_turn = UnitQuaternion::from_scaled_axis(Vector3::z() * std::f64::consts::PI);
        let poses = sightings.iter().zip(&state.poses);
        let turned = poses.clone().map(|(sighting, pose)| {
            let back = Sighting {
                board: sighting.board.clone(),
                pixels: sighting
                    .pixels
                    .iter()
                    .map(|px| 2.0 * middle_px - px)
                    .collect(),
            };
            (back, half_turn * pose)
        });
        Self {
            middle_px,
            side_px: width.max(height),
            turned: turned.collect(),
            as_is: poses.map(|(sighting, pose)| (sighting, *pose)).collect(),
        }
    }

    /// The costs of each picture for the principal point that separates them best.
    fn start(&self, optics: &Optics) -> Option<Vec<Costs>> {
        let mut best: Option<(f64, Vec<Costs>)> = None;
        for distance in DISTANCES {
            for direction in 0..DIRECTIONS {
                let angle = std::f64::consts::PI * direction as f64 / DIRECTIONS as f64;
                let away = Vector2::new(libm::cos(angle), libm::sin(angle));
                let at = self.middle_px + away * (distance * self.side_px);
                let mut optics = *optics;
                (optics.values[2], optics.values[3]) = (at.x, at.y);
                let Some(costs) = self.costs(&optics) else {
                    continue;
                };
                let sum: f64 = costs.iter().map(|it| it.as_is.min(it.turned)).sum();
                if best.as_ref().is_none_or(|(least, _)| sum < *least) {
                    best = Some((sum, costs));
                }
            }
        }
        best.map(|(_, costs)| costs)
    }

    fn costs(&self, optics: &Optics) -> Option<Vec<Costs>> {
        let cost = |sighting: &Sighting, start: Isometry3<f64>| {
            let pose = adjust_pose(optics, start, sighting)?;
            let all = residuals(optics, &pose, sighting)?;
            Some(all.iter().map(Vector2::norm_squared).sum())
        };
        let pictures = self.as_is.iter().zip(&self.turned);
        let each = pictures.map(|((sighting, pose), (back, back_pose))| {
            Some(Costs {
                as_is: cost(sighting, *pose)?,
                turned: cost(back, *back_pose)?,
            })
        });
        each.collect()
    }

    /// The camera fitted with the pictures `turned` turned back.
    fn fit(&self, optics: &Optics, turned: &[bool]) -> Option<State> {
        let pictures = self.as_is.iter().zip(&self.turned).zip(turned);
        let (mut sightings, mut poses) = (Vec::new(), Vec::new());
        for (((sighting, pose), (back, back_pose)), is_turned) in pictures {
            let (sighting, pose) = if *is_turned {
                (back, back_pose)
            } else {
                (*sighting, pose)
            };
            sightings.push(sighting.clone());
            poses.push(*pose);
        }
        let start = State {
            optics: *optics,
            poses,
        };
        adjust(start, &sightings)
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::camera::Intrinsics;

    use crate::board::tests::{SIZE, intrinsics, pinhole, views};
    use crate::board::{BoardError, BoardView, Coefficients, calibrate};

    use super::*;

    /// Turns a picture by half a turn.
    fn turn(view: &mut BoardView) {
        for px in &mut view.pixels {
            for (at, size) in px.iter_mut().zip(SIZE) {
                *at = f64::from(size) - 1.0 - *at;
            }
        }
    }

    #[test]
    fn turned_pictures_are_left_out_with_the_reason() {
        for noise_px in [0.02, 0.2] {
            let truth = Optics::new(&intrinsics(1400.0), &pinhole());
            let mut views = views(&truth, 20, 0.5, noise_px);
            for i in [2, 7, 11, 12, 19] {
                turn(&mut views[i]);
            }
            let found =
                calibrate(SIZE, &views, Coefficients::Five).expect("fifteen upright pictures");
            let names: Vec<&str> = found.left_out.iter().map(|it| it.0.as_str()).collect();
            assert_eq!(names, ["02", "07", "11", "12", "19"], "{noise_px} px");
            assert!(found.left_out[0].1.contains("half a turn"));
            for (axis, (value, expected)) in [found.intrinsics.cx_px, found.intrinsics.cy_px]
                .into_iter()
                .zip([970.0, 590.0])
                .enumerate()
            {
                let sigma = found.sigmas()[2 + axis];
                assert!((value - expected).abs() < 4.0 * sigma, "{value} {sigma}");
            }
        }
    }

    /// With noisy corners the gain of a few pictures can be too small: a documented limit.
    #[test]
    fn a_few_turned_pictures_may_be_missed_but_no_others_are_reported() {
        let truth = Optics::new(&intrinsics(1400.0), &pinhole());
        for (noise_px, turned) in [(0.3, &[5][..]), (0.4, &[2, 7, 11])] {
            let mut views = views(&truth, 12, 0.5, noise_px);
            for i in turned {
                turn(&mut views[*i]);
            }
            let found = calibrate(SIZE, &views, Coefficients::Five).expect("nine or more");
            let named: Vec<&str> = found.left_out.iter().map(|it| it.0.as_str()).collect();
            println!("{noise_px} px, {turned:?} turned: {named:?} reported");
            let all: Vec<String> = turned.iter().map(|i| format!("{i:02}")).collect();
            assert!(named.iter().all(|it| all.iter().any(|name| name == it)));
        }
    }

    #[test]
    fn nearly_equal_numbers_of_both_orientations_are_refused() {
        let truth = Optics::new(&intrinsics(1400.0), &pinhole());
        let mut views = views(&truth, 20, 0.5, 0.2);
        for view in views.iter_mut().skip(11) {
            turn(view);
        }
        let error = calibrate(SIZE, &views, Coefficients::Five).expect_err("nine against eleven");
        let BoardError::Turned { turned, of } = error else {
            panic!("{error}");
        };
        assert_eq!((turned.len(), of), (9, 20));
    }

    /// With the principal point in the middle turned pictures cannot be distinguished, and make no difference.
    #[test]
    fn upright_pictures_are_never_reported_as_turned() {
        for (center, wrong) in [
            ([959.5, 599.5], 0.0),
            ([990.0, 570.0], 0.0),
            ([970.0, 590.0], 1.0),
        ] {
            for count in [4, 8, 20] {
                for noise_px in [0.05, 0.3, 1.0] {
                    let optics = Intrinsics {
                        cx_px: center[0],
                        cy_px: center[1],
                        ..intrinsics(1400.0)
                    };
                    let mut views = views(&Optics::new(&optics, &pinhole()), count, 0.5, noise_px);
                    // A picture with wrong corners.
                    for (i, px) in views[1].pixels.iter_mut().enumerate() {
                        px[0] += wrong * (i % 3) as f64;
                    }
                    let found = match calibrate(SIZE, &views, Coefficients::Five) {
                        Ok(found) => found,
                        Err(BoardError::Turned { turned, .. }) => {
                            panic!("{center:?} {count} {turned:?}")
                        }
                        Err(_) => continue,
                    };
                    assert_eq!(found.left_out, [], "{center:?} {count} {noise_px}");
                }
            }
        }
    }
}
