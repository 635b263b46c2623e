//! Findings about the alignment with the venue: scale, floor, handedness, known places.

use farfield_proto::order_statistics::upper_median;
use farfield_proto::plausibility::looks_over_heads;
use nalgebra::Vector3;

use super::assess::Found;
use super::request::Timing;
use crate::adjustment::CameraState;
use crate::alignment::{Alignment, Anchors, Lost};
use crate::report::{CameraReport, Cause, Finding, finding};

/// Residual of known places above which there is a warning, metres.
const DOUBTFUL_ANCHORS_M: f64 = 0.05;
/// The same in standard deviations of the places.
const ANCHORS_SIGMAS: f64 = 3.0;
/// Residual of known places that is an error, relative to the distance between cameras.
const WRONG_ANCHORS_SHARE: f64 = 0.02;
/// The same in metres.
const WRONG_ANCHORS_M: f64 = 0.5;
/// A place is wrong if the residual without it falls to this share.
const ODD_SHARE: f64 = 1.0 / 3.0;
/// Relative error of a known distance that is an error.
const WRONG_DISTANCE: f64 = 0.02;
/// Most marks that are listed.
const MOST_NAMED: usize = 6;
/// It is an error if more than one mark in so many is an outlier.
const WRONG_MARKS: f64 = 4.0;
/// Least z of the direction to a picture's upper edge. Below it a camera looks straight up or down and can be neither upright
/// nor upside down.
const LEAST_UPRIGHT: f64 = 0.1;

/// Known places whose heights differ by at most this lie in a plane, metres.
const LEVEL_M: f64 = 0.5;

/// Aligned cameras of any calibration, with the known facts about the venue.
pub(crate) struct Aligned<'a> {
    /// The cameras with a pose, in the world of the adjustment.
    pub(crate) cameras: &'a [(String, CameraState)],
    /// The known facts about them.
    pub(crate) anchors: &'a Anchors,
    pub(crate) alignment: &'a Alignment,
}

impl Aligned<'_> {
    /// The cameras in the venue.
    fn states(&self) -> Vec<CameraState> {
        let venue = &self.alignment.venue_from_found;
        let each = self.cameras.iter();
        each.map(|(_, state)| venue.apply_to_camera(state))
            .collect()
    }

    /// The largest distance between two cameras.
    fn span_m(&self) -> f64 {
        let states = self.states();
        let mut most: f64 = 0.0;
        for a in &states {
            for b in &states {
                most = most.max((a.center_w - b.center_w).norm());
            }
        }
        most
    }
}

/// Findings about aligned cameras: whether they are upright and fit known places, distances and marks. `cameras` has their
/// uncertainties.
pub(crate) fn anchor_findings(aligned: &Aligned<'_>, cameras: &[CameraReport]) -> Vec<Finding> {
    let mut findings = Vec::new();
    findings.extend(upright(aligned).or_else(|| looking_up(aligned)));
    findings.extend(known_places(aligned, cameras));
    findings.extend(known_distances(aligned));
    findings.extend(marks(aligned));
    findings
}

/// Findings about the alignment of all cameras together.
pub(super) fn alignment_findings(found: &Found<'_>, cameras: &[CameraReport]) -> Vec<Finding> {
    let mut findings = Vec::new();
    let has_pose = |name: &str| found.named.iter().any(|(other, _)| other == name);
    let lost = Lost(found.request.anchors.lost(has_pose));
    if !found.alignment.has_scale {
        findings.push(finding(
            "",
            Cause::NoScale,
            true,
            lost.missing("the length of a metre is unknown"),
            "a known distance, or three known places",
            &lost.remedy("measure the distance between two cameras, 5 m or more"),
        ));
    }
    if !found.alignment.has_floor {
        findings.push(finding(
            "",
            Cause::NoFloor,
            true,
            lost.missing("the floor and the direction of up are unknown"),
            "an upright world: a run refuses any other",
            &lost.remedy("give the places of three cameras or more, not on one line"),
        ));
    }
    if found.alignment.rms_m.is_none() {
        findings.push(finding(
            "",
            Cause::Handedness,
            false,
            lost.missing("handedness was not checked: mirrored videos would not be visible"),
            "three known places or more",
            &lost.remedy("give the places of three cameras or more"),
        ));
    }
    findings.extend(anchor_findings(
        &Aligned {
            cameras: &found.named,
            anchors: &found.anchors,
            alignment: &found.alignment,
        },
        cameras,
    ));
    findings.extend(squares(found));
    let two = found.problem.cameras.len() == 2;
    if two && found.request.timing == Timing::Unknown {
        findings.push(finding(
            "",
            Cause::Uncertain,
            false,
            "two cameras alone hardly determine their clocks".to_owned(),
            "three or more",
            "add a camera, or give the offsets",
        ));
    }
    findings
}

/// Compares the squares of a board with known places and distances.
fn squares(found: &Found<'_>) -> Option<Finding> {
    let board = found.request.board?;
    let scale = found.alignment.venue_from_found.scale;
    let mm = 1000.0 * board.square_m;
    ((scale - 1.0).abs() > WRONG_DISTANCE).then(|| {
        finding(
            "",
            Cause::Anchors,
            true,
            format!(
                "according to the known places and distances a square of the board is {:.1} mm",
                scale * mm
            ),
            &format!("{mm:.1} mm, as given, to 2 %"),
            "measure a square of the printed board, and the distances, again",
        )
    })
}

/// Reports cameras that are upside down. Known places in a plane also fit their mirror image, in which the cameras are upside
/// down.
fn upright(aligned: &Aligned<'_>) -> Option<Finding> {
    if !aligned.alignment.has_floor {
        return None;
    }
    let states = aligned.states();
    let up = states
        .iter()
        .map(|state| (state.camera_from_world.inverse() * -Vector3::y()).z);
    let (upright, turned) = up.fold((0, 0), |(upright, turned), z| {
        (
            upright + usize::from(z > LEAST_UPRIGHT),
            turned + usize::from(z < -LEAST_UPRIGHT),
        )
    });
    (turned > 0 && turned >= upright).then(|| {
        finding(
            "",
            Cause::Handedness,
            true,
            format!(
                "the world is upside down, and the known places fit their mirror image: {turned} of {} cameras have the upper \
                 edge of their picture at the bottom",
                states.len()
            ),
            "cameras that stand upright",
            "check the known places for two exchanged axes or a wrong sign, and the videos for mirroring",
        )
    })
}

/// Reports cameras that all look up although they are above people's heads. If y was counted from below in all sights, cameras
/// are upright in the mirror image of known places in a plane, but look up.
fn looking_up(aligned: &Aligned<'_>) -> Option<Finding> {
    let states = aligned.states();
    let looks_up = |state: &CameraState| {
        let forward = state.camera_from_world.inverse() * Vector3::z();
        looks_over_heads(state.center_w.z, forward.z)
    };
    let is_floor_known = aligned.alignment.has_floor && aligned.alignment.has_scale;
    let heights_m = aligned.anchors.centers_m.iter().map(|(_, at_m)| at_m[2]);
    let (low_m, high_m) = heights_m.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), z| {
        (low.min(z), high.max(z))
    });
    let have_relief = high_m - low_m > LEVEL_M;
    (is_floor_known && states.len() >= 2 && states.iter().all(looks_up)).then(|| {
        finding(
            "",
            Cause::Handedness,
            !have_relief,
            "all cameras look up, from more than 1.5 m above the floor; known places that lie in a plane fit their mirror image"
                .to_owned(),
            "cameras that look down at people",
            "check whether y is counted from below in the sightings, or the videos are mirrored; if the cameras really look up, \
             state it by a camera whose height differs by a metre from that of the others",
        )
    })
}

fn known_places(aligned: &Aligned<'_>, cameras: &[CameraReport]) -> Option<Finding> {
    let rms_m = aligned.alignment.rms_m?;
    let sigmas = cameras.iter().map(|camera| camera.position_sigma_m);
    let usual_sigma_m = upper_median(sigmas.filter(|s| s.is_finite()).collect()).unwrap_or(0.0);
    let bar_m = DOUBTFUL_ANCHORS_M.max(ANCHORS_SIGMAS * usual_sigma_m);
    let wrong_m = WRONG_ANCHORS_M.min(WRONG_ANCHORS_SHARE * aligned.span_m());
    if rms_m <= bar_m.min(wrong_m) {
        return None;
    }
    let odd = aligned.anchors.odd_place(aligned.cameras);
    let odd = odd.filter(|(_, left_m)| *left_m < ODD_SHARE * rms_m);
    let without = odd.map_or_else(String::new, |(name, left_m)| {
        format!("; without `{name}` the others fit to {left_m:.3} m")
    });
    Some(finding(
        "",
        Cause::Anchors,
        rms_m > wrong_m,
        format!("the known places are {rms_m:.3} m from where they were found{without}"),
        &format!("{:.3} m or less", bar_m.min(wrong_m)),
        "check for exchanged names, another unit, or a wrong number among them",
    ))
}

/// Reports clicked marks that are outliers.
fn marks(aligned: &Aligned<'_>) -> Option<Finding> {
    let fitted = aligned.anchors.fit_marks(aligned.cameras).ok()??;
    let outliers: Vec<String> = fitted
        .outliers()
        .take(MOST_NAMED)
        .map(|it| match (&it.camera, it.px) {
            (Some(camera), Some(px)) => format!(
                "`{}` in camera `{camera}` ({px:.1} px, {:.3} m)",
                it.name, it.m
            ),
            _ => format!("`{}` ({:.3} m)", it.name, it.m),
        })
        .collect();
    let count = fitted.outliers().count();
    (count > 0).then(|| {
        finding(
            "",
            Cause::Anchors,
            WRONG_MARKS * (count as f64) > fitted.residuals.len() as f64,
            format!(
                "{count} of {} clicked marks do not fit the others: {}",
                fitted.residuals.len(),
                outliers.join(", ")
            ),
            "marks that all fit one court",
            "click them again, or check for exchanged names",
        )
    })
}

fn known_distances(aligned: &Aligned<'_>) -> Vec<Finding> {
    let states = aligned.states();
    let center = |name: &String| {
        let mut named = aligned.cameras.iter().zip(&states);
        let it = named.find(|((other, _), _)| other == name);
        it.map(|(_, state)| state.center_w)
    };
    let each = aligned.anchors.distances.iter().filter_map(|known| {
        let here_m = (center(&known.first)? - center(&known.second)?).norm();
        let off = (here_m / known.distance_m - 1.0).abs();
        (off > WRONG_DISTANCE).then(|| {
            finding(
                "",
                Cause::Anchors,
                true,
                format!(
                    "`{}` and `{}` are {here_m:.3} m apart in the result, which contradicts the given {:.3} m",
                    known.first, known.second, known.distance_m
                ),
                "at most 2 % of difference",
                "measure the distance again, and check the other known places and distances",
            )
        })
    });
    each.collect()
}
