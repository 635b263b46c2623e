//! What speaks against how a calibration lies in its venue: its length, its floor, its handedness, its known places.

use farfield_proto::order_statistics::upper_median;
use nalgebra::Vector3;

use super::assess::{Found, finding, span_m, states};
use super::request::Timing;
use crate::adjustment::CameraState;
use crate::report::{CameraReport, Cause, Finding};

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

/// What is said of the alignment, of all cameras together.
pub(super) fn of_alignment(found: &Found<'_>, cameras: &[CameraReport]) -> Vec<Finding> {
    let mut findings = Vec::new();
    if !found.alignment.has_scale {
        findings.push(finding(
            "",
            Cause::NoScale,
            true,
            "nothing says how long a metre is".to_owned(),
            "a known distance, or three known places",
            "measure the distance between two cameras, 5 m or more",
        ));
    }
    if !found.alignment.has_floor {
        findings.push(finding(
            "",
            Cause::NoFloor,
            true,
            "nothing says where the floor is and which way is up".to_owned(),
            "an upright world: a run refuses any other",
            "give the places of three cameras or more (`--at`), not on one line",
        ));
    }
    if found.alignment.rms_m.is_none() {
        findings.push(finding(
            "",
            Cause::Handedness,
            false,
            "handedness was not checked: mirrored videos would not show".to_owned(),
            "three known places or more",
            "give the places of three cameras or more (`--at`)",
        ));
    }
    findings.extend(upright(found));
    findings.extend(known_places(found, cameras));
    findings.extend(known_distances(found));
    findings.extend(marks(found));
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

/// Cameras stand upright. Where the known places lie in a plane their mirror image fits them as well, and what then stands
/// on its head is the cameras.
fn upright(found: &Found<'_>) -> Option<Finding> {
    if !found.alignment.has_floor {
        return None;
    }
    let states = states(found);
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

fn known_places(found: &Found<'_>, cameras: &[CameraReport]) -> Option<Finding> {
    let rms_m = found.alignment.rms_m?;
    let sigmas = cameras.iter().map(|camera| camera.position_sigma_m);
    let usual_sigma_m = upper_median(sigmas.filter(|s| s.is_finite()).collect()).unwrap_or(0.0);
    let bar_m = DOUBTFUL_ANCHORS_M.max(ANCHORS_SIGMAS * usual_sigma_m);
    let wrong_m = WRONG_ANCHORS_M.min(WRONG_ANCHORS_SHARE * span_m(found));
    if rms_m <= bar_m.min(wrong_m) {
        return None;
    }
    let odd = found.odd_place.as_ref();
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
fn marks(found: &Found<'_>) -> Option<Finding> {
    let named = found.posed.iter().zip(&found.problem.cameras);
    let cameras: Vec<(String, CameraState)> = named
        .filter_map(|(i, camera)| Some((found.request.cameras.get(*i)?.name.clone(), camera.state)))
        .collect();
    let has_pose = |name: &String| cameras.iter().any(|(other, _)| other == name);
    let names = found.request.cameras.iter().map(|camera| &camera.name);
    let without: Vec<&str> = names
        .filter(|name| !has_pose(name))
        .map(String::as_str)
        .collect();
    let fitted = found
        .request
        .anchors
        .without(&without)
        .fit_marks(&cameras)
        .ok()??;
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

fn known_distances(found: &Found<'_>) -> Vec<Finding> {
    let states = states(found);
    let center = |name: &String| {
        let mut posed = found.posed.iter().zip(&states);
        let it = posed.find(|(index, _)| {
            let camera = found.request.cameras.get(**index);
            camera.is_some_and(|camera| camera.name == *name)
        });
        it.map(|(_, state)| state.center_w)
    };
    let each = found.request.anchors.distances.iter().filter_map(|known| {
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
