//! Findings about a calibration from a moving point.

use super::chain::{Chain, Pair};
use super::freed::{Bars, ClockUnit, suspects};
use super::halves::{Apart, halves, knocked_at};
use super::refine::{bounded, noise_px};
use super::request::{PointCamera, PointRequest};
use crate::adjustment::{CameraState, Covariance, Problem};
use crate::alignment::{Alignment, Anchors, Lost};
use crate::report::{
    CameraReport, Cause, Finding, HalvesCheck, PictureCoverage, Report, empty_picture, finding,
    halves_apart, other_focal_length, uncertain_place,
};

/// Residuals within this many standard deviations are used.
const USED_SIGMAS: f64 = 4.0;
/// A smaller share of used residuals is a warning.
const USUAL_SHARE: f64 = 0.8;
/// A smaller share of used residuals is an error.
const LEAST_SHARE: f64 = 0.6;
/// The halves of the data disagree if they project the same points this many pixels apart. It is a warning if the distance
/// also exceeds their standard deviations.
const DOUBTFUL_HALVES_PX: f64 = 1.5;
/// The same for an error, whatever the standard deviations.
const WRONG_HALVES_PX: f64 = 3.0;
/// Noise above which there is a warning, pixels: independent of the gate, which users can widen.
const DOUBTFUL_NOISE_PX: f64 = 1.5;
/// The same for an error.
const WRONG_NOISE_PX: f64 = 3.0;

/// Delays of a synchronised camera above which there is a warning, and an error, frames.
const LATE_FRAMES: [f64; 2] = [0.25, 0.75];
/// Relative errors of a focal length above which there is a warning, and an error.
const FOCAL: [f64; 2] = [0.03, 0.06];
/// Number of instants of a board that should link a camera to another.
const USUAL_INSTANTS: usize = 15;

/// All inputs of a report.
pub(super) struct Found<'a> {
    pub(super) request: &'a PointRequest,
    pub(super) chain: &'a Chain,
    pub(super) problem: Problem,
    pub(super) posed: Vec<usize>,
    pub(super) covariance: Option<Covariance>,
    pub(super) alignment: Alignment,
    /// The cameras of the problem by name.
    pub(super) named: Vec<(String, CameraState)>,
    /// The known facts about these cameras.
    pub(super) anchors: Anchors,
}

/// The report on the cameras; [`super::venue`] has the findings about the alignment.
pub(super) fn assess(found: &Found<'_>) -> Report {
    let apart = halves(&found.problem);
    let cameras = camera_reports(found, &apart);
    let mut findings = not_connected(found);
    let span_m = span_m(found);
    for (report, state) in cameras.iter().zip(states(found)) {
        findings.extend(camera_findings(report, span_m));
        findings.extend(place_findings(report, &state, found));
    }
    findings.extend(degenerate(found));
    findings.extend(knocked(found, &cameras));
    findings.extend(weak_links(found));
    findings.extend(suspect_findings(found));
    Report {
        cameras,
        anchors_rms_m: found.alignment.rms_m,
        people: None,
        field: None,
        findings,
    }
}

pub(super) fn states(found: &Found<'_>) -> Vec<CameraState> {
    let venue = &found.alignment.venue_from_found;
    let each = found.problem.cameras.iter();
    each.map(|camera| venue.apply_to_camera(&camera.state))
        .collect()
}

fn request_of<'a>(found: &'a Found<'_>, index: usize) -> Option<&'a PointCamera> {
    found.request.cameras.get(*found.posed.get(index)?)
}

/// The largest distance between two cameras.
pub(super) fn span_m(found: &Found<'_>) -> f64 {
    let states = states(found);
    let mut most: f64 = 0.0;
    for a in &states {
        for b in &states {
            most = most.max((a.center_w - b.center_w).norm());
        }
    }
    most
}

fn camera_reports(found: &Found<'_>, apart: &[Option<Apart>]) -> Vec<CameraReport> {
    let noise = noise_px(&found.problem);
    let bounds = bounded(&noise);
    let residuals = found.problem.residuals_px();
    let scale = found.alignment.venue_from_found.scale;
    let states = states(found);
    let mut reports = Vec::new();
    for (index, state) in states.iter().enumerate() {
        let Some(camera) = request_of(found, index) else {
            continue;
        };
        let own = found.problem.observations.iter().zip(&residuals);
        let own: Vec<([f64; 2], Option<f64>)> = own
            .filter(|(it, _)| it.camera == index)
            .map(|(it, length)| (it.px, *length))
            .collect();
        let fits = |length: &f64| *length < USED_SIGMAS * bounds[index];
        let used = own
            .iter()
            .filter_map(|(px, length)| Some((*px, (*length).filter(fits)?)));
        let (used_px, used): (Vec<[f64; 2]>, Vec<f64>) = used.unzip();
        let squares: f64 = used.iter().map(|length| length * length).sum();
        let sigma = found
            .covariance
            .as_ref()
            .and_then(|c| c.cameras.get(index)?.as_ref());
        let half = apart.get(index).copied().flatten();
        reports.push(CameraReport {
            name: camera.name.clone(),
            sights: own.len(),
            used_share: used.len() as f64 / own.len().max(1) as f64,
            rms_px: (squares / used.len().max(1) as f64).sqrt(),
            noise_px: noise[index],
            position_sigma_m: sigma.map_or(f64::NAN, |s| s.position * scale),
            rotation_sigma_deg: sigma.map_or(f64::NAN, |s| s.rotation_rad.to_degrees()),
            focal_ratio: state.intrinsics.fx_px / camera.intrinsics.fx_px,
            offset_s: state.time_s(0.0),
            rate_hz: 1.0 / state.period_s,
            halves_m: half.map_or(f64::NAN, |it| it.distance * scale),
            halves_deg: half.map_or(f64::NAN, |it| it.turned_rad.to_degrees()),
            halves_px: half.map_or(f64::NAN, |it| it.px),
            halves_across_m: half.map_or(f64::NAN, |it| it.across * scale),
            coverage: PictureCoverage::new(camera.size_px, used_px),
        });
    }
    reports
}

fn not_connected(found: &Found<'_>) -> Vec<Finding> {
    let cameras = found.request.cameras.iter().enumerate();
    let without = cameras.filter(|(index, _)| !found.posed.contains(index));
    let each = without.map(|(index, camera)| {
        let own = found.chain.pairs.iter().filter(|p| p.first == index || p.second == index);
        let best = own.max_by(|a, b| a.share().total_cmp(&b.share()));
        let reason = best.map_or_else(
            || "it shares no moment with another camera".to_owned(),
            |pair| {
                let other = if pair.first == index { pair.second } else { pair.first };
                let name = found.request.cameras.get(other).map_or("", |c| c.name.as_str());
                let (percent, common) = (100.0 * pair.share(), pair.common);
                if pair.is_sound() && found.chain.has_no_scale(index) {
                    format!(
                        "it agrees with `{name}` ({percent:.0} % of {common} common moments), but no point is seen by it and \
                         two other cameras: nothing links the distance between it and `{name}` to those between the others"
                    )
                } else if pair.is_sound() {
                    format!(
                        "it agrees with `{name}` ({percent:.0} % of {common} common moments), but not with the positions of \
                         the point from the other cameras together"
                    )
                } else {
                    format!(
                        "it does not agree enough with any camera (at best {percent:.0} % of {common} common moments, with `{name}`)"
                    )
                }
            },
        );
        let lost = Lost(found.request.anchors.lost(|name| name != camera.name));
        let is_sound = best.is_some_and(Pair::is_sound);
        let (expected, remedy) = if is_sound && found.chain.has_no_scale(index) {
            (
                "moments that three cameras share, ten or more of each camera",
                "carry the point where three cameras see it at once; corners of a board can be given as one body (--charuco)",
            )
        } else {
            (
                "one pose that fits them all, on 40 % of 15 common moments or more",
                "carry the point where it and another camera both see it; check whether its video is of another camera, mirrored or \
                 late, and its lens",
            )
        };
        finding(
            &camera.name,
            Cause::NotConnected,
            true,
            lost.missing(&reason),
            expected,
            remedy,
        )
    });
    each.collect()
}

fn camera_findings(report: &CameraReport, span_m: f64) -> Vec<Finding> {
    let mut findings = Vec::new();
    let name = &report.name;
    if report.used_share < USUAL_SHARE {
        findings.push(finding(
            name,
            Cause::Outliers,
            report.used_share < LEAST_SHARE,
            format!("{:.0} % of its sights fit", 100.0 * report.used_share),
            "80 % or more",
            "it was moved during the recording, or something else was taken for the point",
        ));
    }
    if report.noise_px > DOUBTFUL_NOISE_PX {
        findings.push(finding(
            name,
            Cause::Residual,
            report.noise_px > WRONG_NOISE_PX,
            format!("its residuals are {:.1} px", report.noise_px),
            &format!("below {DOUBTFUL_NOISE_PX:.1} px"),
            "check its lens and its clock, and whether it was moved",
        ));
    }
    findings.extend(uncertain_place(
        report,
        span_m,
        "carry the point near it and far from it, high and low, where other cameras also see it",
    ));
    findings.extend(other_focal_length(report));
    findings.extend(empty_picture(report, "carry the point"));
    findings.extend(halves_finding(report));
    findings
}

/// The finding about the halves of the data.
fn halves_finding(report: &CameraReport) -> Option<Finding> {
    let check = HalvesCheck {
        doubtful_px: DOUBTFUL_HALVES_PX,
        is_wrong: report.halves_px > WRONG_HALVES_PX,
        what: "sights",
        needed: "15 sights or more in each half (with a board: instants shared with another camera), in three cameras that do not stand on one line",
        remedy: "carry the point in front of it at the beginning and at the end",
    };
    halves_apart(report, &check)
}

/// Findings about cameras that fit better with another clock or focal length.
fn suspect_findings(found: &Found<'_>) -> Vec<Finding> {
    let bars = Bars {
        late: LATE_FRAMES,
        focal: FOCAL,
    };
    let unit = ClockUnit {
        hz: None,
        is_frame: true,
    };
    let name = |index: usize| request_of(found, index).map_or("", |it| it.name.as_str());
    let each = suspects(&found.problem, bars);
    each.iter()
        .map(|it| it.finding(name(it.camera), bars, unit))
        .collect()
}

/// Findings about cameras that are linked to the others by few instants of a board.
fn weak_links(found: &Found<'_>) -> Vec<Finding> {
    if found.request.board.is_none() {
        return Vec::new();
    }
    let is_posed =
        |pair: &&Pair| found.posed.contains(&pair.first) && found.posed.contains(&pair.second);
    let each = found.posed.iter().filter_map(|index| {
        let own = found.chain.pairs.iter().filter(is_posed);
        let own = own.filter(|it| it.first == *index || it.second == *index);
        let best = own.max_by_key(|it| it.agreeing)?;
        let other = if best.first == *index { best.second } else { best.first };
        let name = |index: usize| found.request.cameras.get(index).map_or("", |it| it.name.as_str());
        (best.agreeing < USUAL_INSTANTS).then(|| {
            finding(
                name(*index),
                Cause::Uncertain,
                false,
                format!("it is linked to the others by the board at {} instants, with `{}`", best.agreeing, name(other)),
                &format!("{USUAL_INSTANTS} instants or more"),
                "show the board longer where it and another camera both see it, near and far, tilted each way",
            )
        })
    });
    each.collect()
}

/// Findings about cameras that fit only part of the time.
fn knocked(found: &Found<'_>, cameras: &[CameraReport]) -> Vec<Finding> {
    let bounds = bounded(&cameras.iter().map(|it| it.noise_px).collect::<Vec<_>>());
    let residuals = found.problem.residuals_px();
    let each = cameras.iter().zip(bounds).enumerate();
    let each = each.filter_map(|(index, (camera, noise))| {
        let own = found.problem.observations.iter().zip(&residuals);
        let own = own.filter(|(it, _)| it.camera == index);
        let used: Vec<bool> = own
            .map(|(_, length)| length.is_some_and(|length| length < USED_SIGMAS * noise))
            .collect();
        let percent = 100.0 * knocked_at(&used)?;
        Some(finding(
            &camera.name,
            Cause::Knocked,
            true,
            format!("moved, or its clock jumped, at about {percent:.0} % of its sights"),
            "sights that fit equally well at all times",
            "leave out its sights before or after, or calibrate again",
        ))
    });
    each.collect()
}

fn place_findings(report: &CameraReport, state: &CameraState, found: &Found<'_>) -> Vec<Finding> {
    let mut findings = Vec::new();
    if found.alignment.has_floor && found.alignment.has_scale && state.center_w.z < 0.0 {
        findings.push(finding(
            &report.name,
            Cause::UnderFloor,
            true,
            format!("it stands {:.2} m under the floor", -state.center_w.z),
            "above it",
            "z of the known places must point up, and the floor must be at zero",
        ));
    }
    let size = found.request.cameras.iter().find(|c| c.name == report.name);
    let folds = size.is_some_and(|camera| {
        let [width, height] = camera.size_px.map(f64::from);
        let corners = [
            [0.0, 0.0],
            [width - 1.0, 0.0],
            [0.0, height - 1.0],
            [width - 1.0, height - 1.0],
        ];
        let fold = state.fold_radius();
        corners
            .into_iter()
            .any(|px| state.bearing(px, fold).is_none())
    });
    if folds {
        findings.push(finding(
            &report.name,
            Cause::LensFolds,
            false,
            "its lens model folds before the corners of its picture".to_owned(),
            "a model that covers the whole picture",
            "calibrate its lens with pictures of a board in the corners",
        ));
    }
    findings
}

fn degenerate(found: &Found<'_>) -> Vec<Finding> {
    let Some(covariance) = &found.covariance else {
        return Vec::new();
    };
    let name = |index: &usize| request_of(found, *index).map_or("", |c| c.name.as_str());
    let each = covariance.degenerate.iter().map(|direction| {
        let names: Vec<&str> = direction.cameras.iter().map(|(index, _)| name(index)).collect();
        finding(
            "",
            Cause::Degenerate,
            true,
            format!("the sights do not determine the poses of {}", names.join(", ")),
            "sights that determine every camera",
            "carry the point across the field, near and far, high and low: not along one line or at one distance",
        )
    });
    each.take(1).collect()
}
