//! Findings about a calibration from people as a whole: cameras that are not connected, how people walked, the floor, the
//! scale.

use farfield_proto::order_statistics::{percentile, upper_median};

use super::evidence::Found;
use super::plan::USUAL_STATURE_M;
use super::start::ground::LEAST_BODIES;
use super::venue::Scale;
use crate::alignment::Lost;
use crate::report::{Cause, Finding, PeopleReport, finding};

/// Seconds of a person that two cameras see, summed over persons, below which there is a warning.
const USUAL_PERSON_S: f64 = 60.0;
/// The same for an error.
const LEAST_PERSON_S: f64 = 8.0;
/// Extent of the positions of feet across their main direction, relative to that along it, below which the walk is a line.
const LINE_SHARE: f64 = 0.12;
/// The same for an error.
const WRONG_LINE_SHARE: f64 = 0.05;
/// Extent across the main direction below which the walk is a line and an error, metres.
const LINE_M: f64 = 0.6;
/// Ratio of the distances to a camera's far and near persons below which all are at one depth.
const ONE_DEPTH: f64 = 1.15;
/// Median distance of standing ankles from their plane above which there is a warning, metres.
const DOUBTFUL_FEET_M: f64 = 0.05;
/// The same for an error.
const WRONG_FEET_M: f64 = 0.12;
/// Mean lean of people above which there is a warning, degrees.
const DOUBTFUL_LEAN_DEG: f64 = 4.0;
/// The same for an error.
const WRONG_LEAN_DEG: f64 = 12.0;
/// Height of the floor by feet, in a venue that known places fix, above which there is a warning, metres.
const DOUBTFUL_FLOOR_M: f64 = 0.10;
/// The same for an error.
const WRONG_FLOOR_M: f64 = 0.20;
/// Tilt of that floor above which there is a warning, degrees.
const DOUBTFUL_TILT_DEG: f64 = 1.5;
/// The same for an error.
const WRONG_TILT_DEG: f64 = 3.0;
/// Median statures outside this range cause a warning, metres: adults are inside.
const DOUBTFUL_STATURES_M: [f64; 2] = [1.5, 2.0];
/// The same for an error.
const WRONG_STATURES_M: [f64; 2] = [1.2, 2.1];
/// Relative difference of given and measured stature above which there is a warning.
const DOUBTFUL_STATURE: f64 = 0.05;

/// Findings about all cameras together.
pub(super) fn overall_findings(found: &Found<'_>) -> Vec<Finding> {
    let mut findings = not_connected(found);
    findings.extend(degenerate(found));
    findings.extend(only_two(found));
    findings.extend(too_few(found));
    findings.extend(straight_walk(found));
    findings.extend(one_depth(found));
    findings.extend(feet(found));
    findings.extend(under_floor(found));
    findings.extend(metres(found));
    findings.extend(known_floor(found));
    findings
}

fn not_connected(found: &Found<'_>) -> Vec<Finding> {
    let is_reported =
        |i: &usize| !found.adjusted.posed.contains(i) || found.evidence.mirrored.contains(i);
    let without = (0..found.request.cameras.len()).filter(is_reported);
    let each = without.map(|index| {
        let name = found.name(index);
        let is_posed = found.adjusted.posed.contains(&index);
        let lost = Lost(found.request.anchors.lost(|camera| camera != name || is_posed));
        if found.evidence.mirrored.contains(&index) {
            return finding(
                name,
                Cause::Handedness,
                true,
                lost.missing("it agrees with the others only in a mirror"),
                "a picture that is not mirrored",
                "turn off mirroring in the camera, or flip the video",
            );
        }
        let bodies = found.evidence.bodies.get(index).copied().unwrap_or(0);
        let own = found.evidence.pairs.iter().filter(|p| p.first == index || p.second == index);
        let best = own.max_by(|a, b| a.matched.cmp(&b.matched).then(b.loss.total_cmp(&a.loss)));
        let reason = match best {
            _ if bodies < LEAST_BODIES => {
                format!("it saw {bodies} bodies with ankles and shoulders, and needs {LEAST_BODIES}")
            }
            None => "it saw no person that another camera saw at the same time".to_owned(),
            Some(pair) => {
                let other = if pair.first == index { pair.second } else { pair.first };
                format!(
                    "it does not agree enough with any camera: at best {} bodies with `{}`, {:.0} % of whose keypoints fit",
                    pair.matched,
                    found.name(other),
                    100.0 * (1.0 - pair.loss)
                )
            }
        };
        finding(
            name,
            Cause::NotConnected,
            true,
            lost.missing(&reason),
            "twenty bodies that it and another camera see at the same time",
            "let people walk on curves where it and another camera both see them; check its clock and lens",
        )
    });
    each.collect()
}

/// Two cameras cannot be checked against a third: halves cannot be aligned with each other, and the distance, which is the
/// unit, has no uncertainty.
fn only_two(found: &Found<'_>) -> Option<Finding> {
    (found.adjusted.posed.len() == 2).then(|| {
        finding(
            "",
            Cause::HalvesUnchecked,
            true,
            "two cameras were calibrated, and nothing checks their relative pose".to_owned(),
            "three cameras or more",
            "add a camera, or calibrate two by a board or by points",
        )
    })
}

fn degenerate(found: &Found<'_>) -> Option<Finding> {
    let Some(covariance) = &found.covariance else {
        return Some(finding(
            "",
            Cause::Uncertain,
            true,
            "the uncertainty of the cameras could not be computed".to_owned(),
            "people who determine the pose of every camera",
            "let people walk across the whole field, near and far, on curves",
        ));
    };
    let direction = covariance.degenerate.first()?;
    let named = direction.cameras.iter().filter_map(|(index, _)| {
        let posed = found.adjusted.posed.get(*index)?;
        Some(found.name(*posed))
    });
    let names: Vec<&str> = named.collect();
    Some(finding(
        "",
        Cause::Degenerate,
        true,
        format!(
            "the people do not determine the poses of {}",
            names.join(", ")
        ),
        "people that every camera sees together with others",
        "let people walk across the whole field, near and far, on curves",
    ))
}

/// Persons at the processed ticks, times the seconds that each of these stands for. Ticks without people add nothing.
fn person_seconds(found: &Found<'_>) -> f64 {
    found.adjusted.persons.len() as f64 * found.adjusted.ticks_per_sample / found.ticks_hz
}

fn too_few(found: &Found<'_>) -> Option<Finding> {
    let seconds = person_seconds(found);
    (seconds < USUAL_PERSON_S).then(|| {
        finding(
            "",
            Cause::TooFewPeople,
            seconds < LEAST_PERSON_S,
            format!(
                "people were seen by several cameras for {seconds:.0} s, summed over all of them"
            ),
            "60 s or more: four people for half a minute, or better for two minutes",
            "record longer, or more people",
        )
    })
}

fn straight_walk(found: &Found<'_>) -> Option<Finding> {
    let scale = found.alignment.venue_from_found.scale;
    let [along_m, across_m] = found.floor.as_ref()?.extent.map(|it| it * scale);
    let is_line = across_m < LINE_M || across_m < LINE_SHARE * along_m;
    is_line.then(|| {
        finding(
            "",
            Cause::Walk,
            across_m < LINE_M || across_m < WRONG_LINE_SHARE * along_m,
            format!("all walked along one line: {across_m:.2} m across it, {along_m:.2} m along it (10 to 90 % of the steps)"),
            "walks that cover the field in both directions",
            "let people walk on curves over the whole field",
        )
    })
}

fn one_depth(found: &Found<'_>) -> Vec<Finding> {
    let problem = &found.adjusted.problem;
    let nodes = problem.path.nodes();
    let each = problem
        .cameras
        .iter()
        .enumerate()
        .filter_map(|(index, camera)| {
            let own = problem.observations.iter().filter(|it| it.camera == index);
            let depths = own.filter_map(|it| {
                let point = nodes.get(it.point)?;
                Some((camera.state.camera_from_world * (point - camera.state.center_w)).z)
            });
            let mut depths: Vec<f64> = depths.collect();
            depths.sort_by(f64::total_cmp);
            let (near, far) = (percentile(&depths, 0.05)?, percentile(&depths, 0.95)?);
            (far < ONE_DEPTH * near).then(|| {
                finding(
                    found.name(*found.adjusted.posed.get(index).unwrap_or(&index)),
                    Cause::Walk,
                    false,
                    format!("it saw all people at one depth: {near:.1} to {far:.1} m"),
                    "people near it and far from it",
                    "let people walk towards it and away from it",
                )
            })
        });
    each.collect()
}

fn feet(found: &Found<'_>) -> Vec<Finding> {
    let mut findings = Vec::new();
    let Some(floor) = &found.floor else {
        if !found.alignment.has_floor {
            findings.push(finding(
                "",
                Cause::NoFloor,
                true,
                "the floor is unknown: too few bodies with both ankles and shoulders".to_owned(),
                "an upright world: a run refuses any other",
                "let people walk where their whole bodies are seen, or give the places of three cameras",
            ));
        }
        return findings;
    };
    let scale = found.alignment.venue_from_found.scale;
    let apart_m = floor.apart * scale;
    if apart_m > DOUBTFUL_FEET_M {
        findings.push(finding(
            "",
            Cause::Feet,
            apart_m > WRONG_FEET_M,
            format!("standing feet have a median distance of {apart_m:.3} m from their plane"),
            "0.05 m or less",
            "let people walk on level ground; give the places of three cameras where there is none",
        ));
    }
    let lean_deg = floor.lean_rad.to_degrees();
    if lean_deg > DOUBTFUL_LEAN_DEG {
        findings.push(finding(
            "",
            Cause::Feet,
            lean_deg > WRONG_LEAN_DEG,
            format!("people lean by {lean_deg:.1} degrees relative to the floor under their feet"),
            "4 degrees or less",
            "let people walk upright and in all directions, on level ground",
        ));
    }
    findings
}

fn under_floor(found: &Found<'_>) -> Vec<Finding> {
    if !found.alignment.has_floor {
        return Vec::new();
    }
    let states = found.states();
    let each = states.iter().zip(&found.adjusted.posed);
    let each = each.filter(|(state, _)| state.center_w.z < 0.0);
    each.map(|(state, index)| {
        finding(
            found.name(*index),
            Cause::UnderFloor,
            true,
            format!("it stands {:.2} m under the floor", -state.center_w.z),
            "above it",
            "people must walk upright; where places are given, their z must point up",
        )
    })
    .collect()
}

fn metres(found: &Found<'_>) -> Vec<Finding> {
    let mut findings = Vec::new();
    let has_pose = |name: &str| found.named.iter().any(|(other, _)| other == name);
    let lost = Lost(found.request.anchors.lost(has_pose));
    match found.scale {
        Scale::Assumed => findings.push(finding(
            "",
            Cause::NoScale,
            true,
            lost.missing(&format!(
                "the length of a metre is unknown: people of {USUAL_STATURE_M:.2} m were assumed, which is accurate to 5 %"
            )),
            "a known distance, three known places, or the stature of the people",
            &lost.remedy("measure the distance between two cameras, 5 m or more"),
        )),
        Scale::Stature => findings.push(finding(
            "",
            Cause::Stature,
            false,
            lost.missing("metres come from the stature of the people, which is accurate to 1 to 2 %"),
            "a known distance",
            &lost.remedy("measure the distance between two cameras, 5 m or more"),
        )),
        Scale::Measured => findings.extend(statures(found)),
    }
    if found.alignment.rms_m.is_none() {
        findings.push(finding(
            "",
            Cause::Handedness,
            false,
            lost.missing(
                "handedness was not checked: if all videos were mirrored, it would not be visible",
            ),
            "three known places or more",
            &lost.remedy("give the places of three cameras or more"),
        ));
    }
    findings
}

/// The stature of the people in the result.
pub(super) fn people_report(found: &Found<'_>) -> Option<PeopleReport> {
    let stature_m = found.alignment.venue_from_found.scale * found.standing.stature()?;
    let expected_m = found.request.stature_m.unwrap_or(USUAL_STATURE_M);
    Some(PeopleReport {
        stature_m,
        world_scale: expected_m / stature_m,
    })
}

/// Compares the stature of people with the expected one if metres were measured.
fn statures(found: &Found<'_>) -> Option<Finding> {
    let PeopleReport {
        stature_m: here_m,
        world_scale,
    } = people_report(found)?;
    let is_beyond = |[least, most]: [f64; 2]| !(least..=most).contains(&here_m);
    let is_wrong = is_beyond(WRONG_STATURES_M);
    let given_m = found.request.stature_m;
    let is_off = given_m.is_some() && (world_scale - 1.0).abs() > DOUBTFUL_STATURE;
    (is_wrong || is_off || (given_m.is_none() && is_beyond(DOUBTFUL_STATURES_M))).then(|| {
        let [least, most] = DOUBTFUL_STATURES_M;
        let (expected, reference_m) = match given_m {
            Some(given_m) => (format!("{given_m:.2} m, as given"), given_m),
            None => (format!("{least:.1} to {most:.1} m of adults"), USUAL_STATURE_M),
        };
        finding(
            "",
            Cause::Stature,
            is_wrong,
            format!("people come out {here_m:.2} m tall: all distances times {world_scale:.2} would make them {reference_m:.2} m"),
            &expected,
            "check the known distances and places for a wrong unit or number, and the focal lengths; give the stature of \
             children (--stature-m)",
        )
    })
}

/// Compares the floor of the known places with the floor under the feet.
fn known_floor(found: &Found<'_>) -> Option<Finding> {
    found.alignment.rms_m?;
    let venue = &found.alignment.venue_from_found;
    let heights = found.standing.ankles.iter().map(|it| venue.apply(it).z);
    let ankle_m = upper_median(heights.collect()).unwrap_or(0.0);
    let floor_m = ankle_m - super::plan::ANKLE_HEIGHT * USUAL_STATURE_M;
    let tilt_deg = found.floor.as_ref().map_or(0.0, |floor| {
        let up = venue.rotation * floor.up;
        up.angle(&nalgebra::Vector3::z()).to_degrees()
    });
    (floor_m.abs() > DOUBTFUL_FLOOR_M || tilt_deg > DOUBTFUL_TILT_DEG).then(|| {
        finding(
            "",
            Cause::Anchors,
            floor_m.abs() > WRONG_FLOOR_M || tilt_deg > WRONG_TILT_DEG,
            format!("people walk at a height of {floor_m:.2} m on ground that is tilted by {tilt_deg:.1} degrees"),
            "a level floor at zero",
            "check the heights of the known places, and their axes for an exchange",
        )
    })
}
