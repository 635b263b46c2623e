//! All steps of a calibration from people.

use std::collections::BTreeSet;

use nalgebra::Vector2;

use super::adjust::{Adjusted, Round, Settling, settle};
use super::assess::{DOUBTFUL_CONTRADICTION, DOUBTFUL_NOISE, assess};
use super::evidence::{Evidence, Found, contradictions};
use super::plan::{BodyPlan, USUAL_STATURE_M, other_sides};
use super::request::{PeopleCamera, PeopleError, PeopleRequest};
use super::start::clocks::{lags, refine};
use super::start::floor_match::Feet;
use super::start::graph::{Placed, places};
use super::start::ground::{Ground, LEAST_BODIES, ground};
use super::start::pair::{LEAST_MATCHED, Pair, Walkers, all_pairs, pair};
use super::venue::{Standing, align};
use super::view::{Clock, LEAST_RATE_HZ, Tracks, View};
use crate::adjustment::{CameraState, covariance};
use crate::alignment::Similarity;
use crate::points::{
    CalibrationError, FoundCamera, Lenses, PathPoint, PointCalibration, Timing, check_anchors,
};

/// Accepted frame rates, 1/s.
const RATES_HZ: [f64; 2] = [0.1, 1e5];
/// Largest absolute offset of a clock, seconds (seconds since 1970 are 1.8e9).
const MOST_OFFSET_S: f64 = 1e10;
/// Largest absolute number of a frame.
const MOST_FRAME: f64 = 1e12;
/// Tolerance for the number of a frame to be whole.
const WHOLE: f64 = 1e-6;
/// Accepted statures, metres.
const STATURES_M: [f64; 2] = [0.5, 2.5];

/// Ticks per second of cameras that are not synchronised: enough to describe how people walk.
const MOST_TICKS_HZ: f64 = 10.0;
/// Most rounds of refining clocks.
const CLOCK_ROUNDS: usize = 10;
/// Clocks are refined until they change by less, seconds.
const CLOCK_S: f64 = 5e-4;
/// Time before and after a sight for the velocity of a keypoint, seconds: legs turn within longer times.
const VELOCITY_REACH_S: f64 = 0.1;
/// A camera is mirrored if its pairs are worth this many times more in a mirror.
const MIRROR_GAIN: f64 = 1.5;

/// A stage of a calibration from people.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PeopleStage {
    /// Joins bodies to tracklets, and finds the pose of each camera relative to the floor.
    Ground,
    /// Finds the lags of the clocks: the longest stage if they are unknown.
    Clocks,
    /// Finds the relative poses of pairs of cameras.
    Pairs,
    /// Adjusts all cameras to all keypoints, and matches people again.
    Adjustment,
    /// Assesses the result.
    Report,
}

/// Finds the poses of cameras from the people that they saw. `progress` is called at the start of every stage.
///
/// [`PointCalibration::path`] holds the positions of people's feet. A result can still fail: its findings are in
/// [`PointCalibration::report`]. The same request gives the same bits.
///
/// # Errors
/// [`PeopleError`] if the request is unusable: too few cameras or people, impossible lenses, no two cameras that agree,
/// known places that do not fit (such as those of a mirror image).
pub fn calibrate(
    request: &PeopleRequest,
    progress: &mut dyn FnMut(PeopleStage),
) -> Result<PointCalibration, PeopleError> {
    check_request(request)?;
    let plan =
        BodyPlan::new(&request.keypoints).map_err(|missing| PeopleError::Keypoints { missing })?;
    progress(PeopleStage::Ground);
    let ticks_hz = ticks_hz(request);
    let mut clocks = initial_clocks(request, ticks_hz);
    let tracks = request.cameras.iter().zip(&clocks);
    let mut tracks: Vec<Tracks> = tracks
        .map(|(camera, clock)| Tracks::new(camera, plan.count, clock.rate_hz))
        .collect::<Result<_, _>>()?;
    let ready = (request.timing == Timing::Synchronised)
        .then(|| tracks.drain(..).map(Tracks::into_view).collect());
    let views_at = |clocks: &[Clock]| {
        let each = tracks.iter().zip(clocks);
        each.map(|(tracks, clock)| tracks.view(clock))
            .collect::<Vec<View>>()
    };
    let mut views = ready.unwrap_or_else(|| views_at(&clocks));
    let stature_m = request.stature_m.unwrap_or(USUAL_STATURE_M);
    let (grounds, counts) = grounds(&views, &plan, stature_m);
    check_grounds(request, &grounds, &counts)?;
    if request.timing == Timing::Unknown {
        progress(PeopleStage::Clocks);
        let walkers = walkers(&views, &grounds, &plan, stature_m);
        let lags = lags(&walkers, request.seed)
            .map_err(|(first, second)| too_long(request, first, second))?;
        for (clock, lag) in clocks.iter_mut().zip(lags) {
            clock.offset_s += lag as f64 / ticks_hz;
        }
        views = views_at(&clocks);
    }
    progress(PeopleStage::Pairs);
    let walkers_now = walkers(&views, &grounds, &plan, stature_m);
    let pairs = all_pairs(&walkers_now, &plan, stature_m, request.seed);
    drop(walkers_now);
    let placed = places(&grounds, &pairs);
    if placed.iter().flatten().count() < 2 {
        return Err(nothing_agrees(request, &pairs));
    }
    progress(PeopleStage::Adjustment);
    let mut settling = Settling::new(states(&views, &placed));
    let mut rough = settle(&views, &mut settling, Lenses::Given, &Round::FIRST);
    if request.timing == Timing::Unknown {
        for _ in 0..CLOCK_ROUNDS {
            let Some(adjusted) = rough else { break };
            let moved_s = refine(&mut clocks, &views, &adjusted);
            views = views_at(&clocks);
            rough = settle(&views, &mut settling, Lenses::Given, &Round::NEXT);
            if moved_s < CLOCK_S {
                break;
            }
        }
    }
    let adjusted = settle(&views, &mut settling, request.lenses, &Round::LAST);
    let mut adjusted = adjusted.ok_or_else(|| nothing_agrees(request, &pairs))?;
    progress(PeopleStage::Report);
    adjusted.measure_velocities(&views, &velocity_reaches(&clocks, ticks_hz));
    let contradictions = contradictions(request, &views, &adjusted, plan.count);
    let suspicious = suspicious(&adjusted, &contradictions, views.len());
    let walkers = walkers(&views, &grounds, &plan, stature_m);
    let mirrored = mirrored(request, &walkers, &pairs, &suspicious, &plan, stature_m);
    let evidence = Evidence {
        pairs,
        mirrored,
        bodies: counts,
        contradictions,
        clocks,
    };
    finish(request, &plan, ticks_hz, evidence, adjusted)
}

/// Per camera, the number of ticks before and after a sight for the velocity of a keypoint: at least to the next processed frame.
fn velocity_reaches(clocks: &[Clock], ticks_hz: f64) -> Vec<i64> {
    let reach_s = |clock: &Clock| VELOCITY_REACH_S.max(1.0 / clock.processed_hz);
    let each = clocks.iter();
    each.map(|it| (reach_s(it) * ticks_hz).round().max(1.0) as i64)
        .collect()
}

/// Refuses fractional frame numbers of synchronised cameras, which belong to no moment.
fn check_frames(request: &PeopleRequest) -> Result<(), PeopleError> {
    if request.timing != Timing::Synchronised {
        return Ok(());
    }
    for camera in &request.cameras {
        let is_between = |frame: f64| (frame - frame.round()).abs() > WHOLE;
        if let Some(found) = camera.frames.iter().find(|it| is_between(it.frame)) {
            return Err(PeopleError::Request(CalibrationError::Request(format!(
                "camera `{}`: found frame {}, expected whole frames of synchronised cameras; give rates and offsets, or \
                 let the clocks be estimated",
                camera.name, found.frame
            ))));
        }
    }
    Ok(())
}

fn initial_clocks(request: &PeopleRequest, ticks_hz: f64) -> Vec<Clock> {
    let each = request.cameras.iter().map(|camera| Clock {
        rate_hz: camera.rate_hz.unwrap_or(request.rate_hz),
        processed_hz: processed_hz(camera, request),
        offset_s: match request.timing {
            Timing::Clocks => camera.offset_s.unwrap_or(0.0),
            Timing::Synchronised | Timing::Unknown => 0.0,
        },
        ticks_hz: (request.timing != Timing::Synchronised).then_some(ticks_hz),
    });
    each.collect()
}

/// Processed frames per second; often only one of several frames of a video is processed. The median gap between frames
/// decides, so that single frames do not matter.
fn processed_hz(camera: &PeopleCamera, request: &PeopleRequest) -> f64 {
    let pairs = camera.frames.windows(2).filter_map(|pair| match pair {
        [a, b] => Some(b.frame - a.frame),
        _ => None,
    });
    let mut gaps: Vec<f64> = pairs.filter(|it| *it > 0.0).collect();
    gaps.sort_by(f64::total_cmp);
    let usual = gaps.get(gaps.len().saturating_sub(1) / 2).copied();
    camera.rate_hz.unwrap_or(request.rate_hz) / usual.unwrap_or(1.0).max(1.0)
}

/// Refuses a camera whose clock is unusable.
fn check_clock(camera: &PeopleCamera, request: &PeopleRequest) -> Result<(), PeopleError> {
    let refused = |text: String| Err(PeopleError::Request(CalibrationError::Request(text)));
    let name = &camera.name;
    let rate_hz = camera.rate_hz.unwrap_or(request.rate_hz);
    if !(RATES_HZ[0]..=RATES_HZ[1]).contains(&rate_hz) {
        return Err(PeopleError::Request(CalibrationError::Rate {
            camera: name.clone(),
            found: rate_hz,
        }));
    }
    let processed_hz = processed_hz(camera, request);
    if request.timing != Timing::Synchronised && processed_hz < LEAST_RATE_HZ {
        return refused(format!(
            "camera `{name}`: found {processed_hz} frames per second, expected {LEAST_RATE_HZ} or more of cameras that are not \
             synchronised: people move too far between its frames"
        ));
    }
    let offset_s = camera.offset_s.unwrap_or(f64::NAN);
    if request.timing == Timing::Clocks && !offset_s.is_finite() {
        return Err(PeopleError::Request(CalibrationError::Offset {
            camera: name.clone(),
        }));
    }
    if request.timing == Timing::Clocks && offset_s.abs() > MOST_OFFSET_S {
        return refused(format!(
            "camera `{name}`: found an offset of {offset_s} s, expected {MOST_OFFSET_S:e} at most"
        ));
    }
    let numbers = camera.frames.iter().map(|it| it.frame);
    let huge = numbers
        .filter(|it| it.is_finite())
        .find(|it| it.abs() > MOST_FRAME);
    match huge {
        Some(found) => refused(format!(
            "camera `{name}`: found frame {found}, expected {MOST_FRAME:e} at most"
        )),
        None => Ok(()),
    }
}

/// Refuses a request that would fail whatever the cameras saw. A caller checks this before it detects people.
///
/// # Errors
/// [`PeopleError`] for too few cameras or two of one name, and for invalid numbers: rates, offsets, frames, the stature, known
/// facts about the venue.
pub fn check_request(request: &PeopleRequest) -> Result<(), PeopleError> {
    if request.cameras.len() < 2 {
        return Err(PeopleError::Request(CalibrationError::TooFewCameras {
            found: request.cameras.len(),
        }));
    }
    let mut names = BTreeSet::new();
    for camera in &request.cameras {
        if !names.insert(&camera.name) {
            return Err(PeopleError::Request(CalibrationError::SameName {
                camera: camera.name.clone(),
            }));
        }
        check_clock(camera, request)?;
    }
    check_frames(request)?;
    if let Some(found) = request.stature_m
        && !(STATURES_M[0]..=STATURES_M[1]).contains(&found)
    {
        return Err(PeopleError::Number {
            field: "stature_m",
            found,
            expected: "0.5 to 2.5 metres",
        });
    }
    check_anchors(&request.anchors).map_err(PeopleError::Request)
}

/// Ticks per second: frames of synchronised cameras are ticks; otherwise the rate of the slowest camera, at most ten.
fn ticks_hz(request: &PeopleRequest) -> f64 {
    if request.timing == Timing::Synchronised {
        return request.rate_hz;
    }
    let rates = request.cameras.iter();
    let rates = rates.map(|camera| processed_hz(camera, request));
    rates.fold(MOST_TICKS_HZ, f64::min)
}

/// The ground under each camera, and the number of usable bodies.
fn grounds(views: &[View], plan: &BodyPlan, stature_m: f64) -> (Vec<Option<Ground>>, Vec<usize>) {
    let each = views
        .iter()
        .map(|view| match ground(view, plan, stature_m) {
            Ok(found) => (Some(found), LEAST_BODIES),
            Err(count) => (None, count),
        });
    each.unzip()
}

fn check_grounds(
    request: &PeopleRequest,
    grounds: &[Option<Ground>],
    counts: &[usize],
) -> Result<(), PeopleError> {
    if grounds.iter().flatten().count() >= 2 {
        return Ok(());
    }
    let without = counts.iter().zip(&request.cameras).zip(grounds);
    let best = without
        .filter(|(_, ground)| ground.is_none())
        .max_by_key(|((count, _), _)| **count);
    Err(PeopleError::TooFewBodies {
        camera: best.map_or_else(String::new, |((_, camera), _)| camera.name.clone()),
        found: best.map_or(0, |((count, _), _)| *count),
        least: LEAST_BODIES,
    })
}

fn walkers<'a>(
    views: &'a [View],
    grounds: &[Option<Ground>],
    plan: &BodyPlan,
    stature_m: f64,
) -> Vec<Option<Walkers<'a>>> {
    let each = views.iter().zip(grounds);
    each.map(|(view, ground)| Some(Walkers::new(view, (*ground)?, plan, stature_m)))
        .collect()
}

/// The error for two cameras with more lags than can be tried.
fn too_long(request: &PeopleRequest, first: usize, second: usize) -> PeopleError {
    let name = |index: usize| {
        let camera = request.cameras.get(index);
        camera.map_or("", |camera| camera.name.as_str())
    };
    PeopleError::Request(CalibrationError::Request(format!(
        "cameras `{}` and `{}`: recordings this long, or frame numbers this far apart, give too many lags to try; \
         expected an hour and a half or less: cut them, or give rates and offsets",
        name(first),
        name(second)
    )))
}

fn nothing_agrees(request: &PeopleRequest, pairs: &[Pair]) -> PeopleError {
    let best = pairs
        .iter()
        .max_by(|a, b| (1.0 - a.loss).total_cmp(&(1.0 - b.loss)));
    let name = |index: Option<usize>| {
        let camera = index.and_then(|i| request.cameras.get(i));
        camera.map_or_else(String::new, |camera| camera.name.clone())
    };
    PeopleError::NothingAgrees {
        first: name(best.map(|it| it.first)),
        second: name(best.map(|it| it.second)),
        moments: best.map_or(0, |it| it.matched),
        share_percent: best.map_or(0.0, |it| 100.0 * (1.0 - it.loss)),
        least: LEAST_MATCHED,
    }
}

/// The `suspicious` cameras that agree with the others only in a mirror.
fn mirrored(
    request: &PeopleRequest,
    walkers: &[Option<Walkers<'_>>],
    pairs: &[Pair],
    suspicious: &[usize],
    plan: &BodyPlan,
    stature_m: f64,
) -> Vec<usize> {
    let sides = other_sides(&request.keypoints);
    let worth = |pair: &Pair| pair.worth() * f64::from(u8::from(pair.is_sound()));
    let is_mirrored = |index: &&usize| {
        let Some(own) = walkers.get(**index).and_then(Option::as_ref) else {
            return false;
        };
        let turned = own.view.mirrored(&sides);
        let feet = own.feet.iter().map(|(tick, feet)| {
            let turned = feet.iter().map(|(id, at)| (*id, Vector2::new(at.x, -at.y)));
            (*tick, turned.collect())
        });
        let turned = Walkers {
            view: &turned,
            ground: own.ground.mirrored(),
            feet: feet.collect::<Feet>(),
        };
        let others = (0..walkers.len()).filter(|i| !suspicious.contains(i));
        let (mut plain, mut mirrored) = (0.0, 0.0);
        for other in others {
            let is_own =
                |it: &&Pair| (it.first, it.second) == (other.min(**index), other.max(**index));
            plain += pairs.iter().find(is_own).map_or(0.0, worth);
            let other = walkers.get(other).and_then(Option::as_ref);
            let found = other.and_then(|other| pair(other, &turned, plan, stature_m, request.seed));
            mirrored += found.as_ref().map_or(0.0, worth);
        }
        mirrored > MIRROR_GAIN * plain
    };
    suspicious.iter().filter(is_mirrored).copied().collect()
}

/// The cameras without a pose, or with one that does not fit what they saw.
fn suspicious(adjusted: &Adjusted, contradictions: &[f64], count: usize) -> Vec<usize> {
    let is_suspicious = |index: &usize| {
        let Some(column) = adjusted.posed.iter().position(|it| it == index) else {
            return true;
        };
        let noise = adjusted.noise.get(column).copied().unwrap_or(f64::INFINITY);
        let contradiction = contradictions.get(column).copied().unwrap_or(1.0);
        noise > DOUBTFUL_NOISE || contradiction > DOUBTFUL_CONTRADICTION
    };
    (0..count).filter(is_suspicious).collect()
}

fn states(views: &[View], placed: &[Option<Placed>]) -> Vec<Option<CameraState>> {
    let each = views.iter().zip(placed);
    each.map(|(view, placed)| {
        placed.map(|it| CameraState {
            camera_from_world: it.camera_from_world,
            center_w: it.center_m,
            ..view.state
        })
    })
    .collect()
}

fn finish(
    request: &PeopleRequest,
    plan: &BodyPlan,
    ticks_hz: f64,
    evidence: Evidence,
    adjusted: Adjusted,
) -> Result<PointCalibration, PeopleError> {
    let posed = adjusted.posed.iter().zip(&adjusted.problem.cameras);
    let named: Vec<(String, CameraState)> = posed
        .filter_map(|(i, camera)| Some((request.cameras.get(*i)?.name.clone(), camera.state)))
        .collect();
    let has_pose = |name: &str| named.iter().any(|(other, _)| other == name);
    let names = request.cameras.iter().map(|camera| camera.name.as_str());
    let without: Vec<&str> = names.filter(|name| !has_pose(name)).collect();
    let anchors = request.anchors.without(&without);
    let standing = Standing::new(&adjusted, plan);
    let floor = standing.floor();
    let (alignment, scale) = align(
        &anchors,
        &named,
        &standing,
        floor.as_ref(),
        request.stature_m,
    )
    .map_err(|text| PeopleError::Request(CalibrationError::Alignment(text)))?;
    let time_hz = if request.timing == Timing::Synchronised {
        1.0
    } else {
        ticks_hz
    };
    let path = path(&adjusted, plan, &alignment.venue_from_found, time_hz);
    let found = Found {
        request,
        ticks_hz,
        evidence,
        covariance: covariance(&adjusted.problem),
        adjusted,
        alignment,
        scale,
        standing,
        floor,
        named,
        anchors,
    };
    let report = assess(&found);
    let cameras = found
        .adjusted
        .posed
        .iter()
        .zip(&found.adjusted.problem.cameras);
    let cameras = cameras.filter_map(|(i, adjusted)| {
        let camera = request.cameras.get(*i)?;
        let venue = &found.alignment.venue_from_found;
        let mut state = venue.apply_to_camera(&adjusted.state);
        if let Some(clock) = found
            .evidence
            .clocks
            .get(*i)
            .filter(|it| it.ticks_hz.is_some())
        {
            (state.pivot_s, state.period_s) = (clock.offset_s, 1.0 / clock.rate_hz);
        }
        Some(FoundCamera {
            name: camera.name.clone(),
            size_px: camera.size_px,
            state,
        })
    });
    let calibration = PointCalibration {
        cameras: cameras.collect(),
        path,
        report,
    };
    Ok(calibration.with_field(&found.alignment, &found.anchors))
}

/// Positions of people's feet: the middle of the ankles of each person at each tick. The time is the frame at a rate of 1.
fn path(adjusted: &Adjusted, plan: &BodyPlan, venue: &Similarity, time_hz: f64) -> Vec<PathPoint> {
    let bodies = adjusted.bodies(plan.count);
    let each = adjusted
        .persons
        .iter()
        .zip(&bodies)
        .filter_map(|(person, body)| {
            let [left, right] = plan.ankles.map(|k| body.get(k).copied().flatten());
            let middle = (left? + right?) / 2.0;
            Some(PathPoint {
                time_s: person.tick as f64 / time_hz,
                position_m: venue.apply(&middle).into(),
                cameras: person.members.len(),
            })
        });
    each.collect()
}
