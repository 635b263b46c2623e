//! What speaks against how a calibration lies in its venue: its length, its floor, its handedness, its known places.

use farfield_proto::order_statistics::upper_median;
use farfield_proto::plausibility::looks_over_heads;
use nalgebra::Vector3;

use super::assess::Found;
use super::request::Timing;
use crate::adjustment::CameraState;
use crate::alignment::{Alignment, Anchors, Lost};
use crate::report::{CameraReport, Cause, Finding, finding};

/// Distance of known places from where they were found that is doubtful: metres, and standard deviations of the places.
const DOUBTFUL_ANCHORS_M: f64 = 0.05;
const ANCHORS_SIGMAS: f64 = 3.0;
/// And that is wrong: as a share of the distance between cameras, and in metres.
const WRONG_ANCHORS_SHARE: f64 = 0.02;
const WRONG_ANCHORS_M: f64 = 0.5;
/// A place without which so much of the distance is left is the wrong one.
const ODD_SHARE: f64 = 1.0 / 3.0;
/// Share by which a known distance may be off.
const WRONG_DISTANCE: f64 = 0.02;
/// Marks that are named, and the share of wrong ones, as one in so many, beyond which none can be believed.
const MOST_NAMED: usize = 6;
const WRONG_MARKS: f64 = 4.0;
/// The z of a picture's upper edge below which a camera looks straight up or down, and says nothing of upright.
const LEAST_UPRIGHT: f64 = 0.1;

/// Known places whose heights differ by no more than that lie in a plane, metres.
const LEVEL_M: f64 = 0.5;

/// Cameras that were laid in their venue, and what is known of it: whatever they were calibrated from.
pub(crate) struct Laid<'a> {
    /// Those that have a pose, in the world of the adjustment.
    pub(crate) cameras: &'a [(String, CameraState)],
    /// What is known of them.
    pub(crate) anchors: &'a Anchors,
    pub(crate) alignment: &'a Alignment,
}

impl Laid<'_> {
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

/// What is said of `laid` cameras, of which `cameras` tells how well they are known: whether they stand upright, and fit
/// known places, distances and marks.
pub(crate) fn of_anchors(laid: &Laid<'_>, cameras: &[CameraReport]) -> Vec<Finding> {
    let mut findings = Vec::new();
    findings.extend(upright(laid).or_else(|| looking_up(laid)));
    findings.extend(known_places(laid, cameras));
    findings.extend(known_distances(laid));
    findings.extend(marks(laid));
    findings
}

/// What is said of the alignment, of all cameras together.
pub(super) fn of_alignment(found: &Found<'_>, cameras: &[CameraReport]) -> Vec<Finding> {
    let mut findings = Vec::new();
    let has_pose = |name: &str| found.named.iter().any(|(of, _)| of == name);
    let lost = Lost(found.request.anchors.lost(has_pose));
    if !found.alignment.has_scale {
        findings.push(finding(
            "",
            Cause::NoScale,
            true,
            lost.found("nothing says how long a metre is"),
            "a known distance, or three known places",
            &lost.remedy("measure the distance between two cameras, 5 m or more"),
        ));
    }
    if !found.alignment.has_floor {
        findings.push(finding(
            "",
            Cause::NoFloor,
            true,
            lost.found("nothing says where the floor is and which way is up"),
            "an upright world: a run refuses any other",
            &lost.remedy("give the places of three cameras or more, not on one line"),
        ));
    }
    if found.alignment.rms_m.is_none() {
        findings.push(finding(
            "",
            Cause::Handedness,
            false,
            lost.found("handedness was not checked: mirrored videos would not show"),
            "three known places or more",
            &lost.remedy("give the places of three cameras or more"),
        ));
    }
    findings.extend(of_anchors(
        &Laid {
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
            "two cameras alone tell little of their clocks".to_owned(),
            "three or more",
            "add a camera, or give the offsets",
        ));
    }
    findings
}

/// The squares of a board as known places and distances have them.
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
                "by the known places and distances a square of the board is {:.1} mm",
                scale * mm
            ),
            &format!("{mm:.1} mm, as given, to 2 %"),
            "measure a square of the printed board, and the distances, again",
        )
    })
}

/// Cameras stand upright. Where the known places lie in a plane their mirror image fits them as well, and what then stands
/// on its head is the cameras.
fn upright(laid: &Laid<'_>) -> Option<Finding> {
    if !laid.alignment.has_floor {
        return None;
    }
    let states = laid.states();
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
                "the world stands on its head, known places fit their mirror image: {turned} of {} cameras have the upper \
                 edge of their picture below",
                states.len()
            ),
            "cameras that stand upright",
            "look for two exchanged axes or a wrong sign in the known places, and for mirrored videos",
        )
    })
}

/// Cameras over people's heads look down. Where y was counted from below in all sights, cameras are upright in the mirror image
/// of known places in a plane, too, and look up.
fn looking_up(laid: &Laid<'_>) -> Option<Finding> {
    let states = laid.states();
    let looks_up = |state: &CameraState| {
        let forward = state.camera_from_world.inverse() * Vector3::z();
        looks_over_heads(state.center_w.z, forward.z)
    };
    let is_floor_known = laid.alignment.has_floor && laid.alignment.has_scale;
    let heights_m = laid.anchors.centers_m.iter().map(|(_, at_m)| at_m[2]);
    let (low_m, high_m) = heights_m.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), z| {
        (low.min(z), high.max(z))
    });
    let is_told_by_places = high_m - low_m > LEVEL_M;
    (is_floor_known && states.len() >= 2 && states.iter().all(looks_up)).then(|| {
        finding(
            "",
            Cause::Handedness,
            !is_told_by_places,
            "all cameras look up, from more than 1.5 m above the floor; known places that lie in a plane fit their mirror image"
                .to_owned(),
            "cameras that look down at people",
            "look whether y is counted from below in what the cameras saw, or their videos are mirrored; if they really look up, \
             say so by a camera whose height differs by a metre from that of the others",
        )
    })
}

fn known_places(laid: &Laid<'_>, cameras: &[CameraReport]) -> Option<Finding> {
    let rms_m = laid.alignment.rms_m?;
    let sigmas = cameras.iter().map(|camera| camera.position_sigma_m);
    let usual_sigma_m = upper_median(sigmas.filter(|s| s.is_finite()).collect()).unwrap_or(0.0);
    let bar_m = DOUBTFUL_ANCHORS_M.max(ANCHORS_SIGMAS * usual_sigma_m);
    let wrong_m = WRONG_ANCHORS_M.min(WRONG_ANCHORS_SHARE * laid.span_m());
    if rms_m <= bar_m.min(wrong_m) {
        return None;
    }
    let odd = laid.anchors.odd_place(laid.cameras);
    let odd = odd.filter(|(_, left_m)| *left_m < ODD_SHARE * rms_m);
    let said = odd.map_or_else(String::new, |(name, left_m)| {
        format!("; without `{name}` the others fit to {left_m:.3} m")
    });
    Some(finding(
        "",
        Cause::Anchors,
        rms_m > wrong_m,
        format!("the known places are {rms_m:.3} m from where they were found{said}"),
        &format!("{:.3} m or less", bar_m.min(wrong_m)),
        "look for exchanged names, another unit, or a wrong number among them",
    ))
}

/// Marks that were clicked beside the others.
fn marks(laid: &Laid<'_>) -> Option<Finding> {
    let fitted = laid.anchors.fit_marks(laid.cameras).ok()??;
    let said: Vec<String> = fitted
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
                said.join(", ")
            ),
            "marks that all fit one court",
            "click them again, or look for exchanged names",
        )
    })
}

fn known_distances(laid: &Laid<'_>) -> Vec<Finding> {
    let states = laid.states();
    let center = |name: &String| {
        let mut named = laid.cameras.iter().zip(&states);
        let it = named.find(|((other, _), _)| other == name);
        it.map(|(_, state)| state.center_w)
    };
    let each = laid.anchors.distances.iter().filter_map(|known| {
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
                "measure the distance again, and look at the known places and distances beside it",
            )
        })
    });
    each.collect()
}
