//! Findings about a calibration from people, camera by camera; [`super::findings`] has those about the whole.

use farfield_proto::order_statistics::upper_median;

use super::evidence::Found;
use super::findings::{overall_findings, people_report};
use crate::adjustment::Observation;
use crate::points::{
    Aligned, Apart, Bars, ClockUnit, Timing, anchor_findings, halves, knocked_at, suspects,
};
use crate::report::{
    CameraReport, Cause, Finding, HalvesCheck, PictureCoverage, Report, empty_picture, finding,
    halves_apart, other_focal_length, uncertain_place,
};

/// Residuals within this many standard deviations are used.
const USED_SIGMAS: f64 = 4.0;
/// A smaller share of used residuals is a warning.
const USUAL_SHARE: f64 = 0.75;
/// A smaller share of used residuals is an error.
const LEAST_SHARE: f64 = 0.5;
/// Noise relative to the expected one (25 mm on the body and 1 px) above which there is a warning.
pub(super) const DOUBTFUL_NOISE: f64 = 1.8;
/// The same for an error.
const WRONG_NOISE: f64 = 4.0;
/// Noise relative to the median camera above which a warning becomes an error: such a pose is wrong.
const WRONG_NOISE_RATIO: f64 = 2.0;
/// Share of persons that a camera sees elsewhere, above which there is a warning.
pub(super) const DOUBTFUL_CONTRADICTION: f64 = 0.25;
/// The same for an error.
const WRONG_CONTRADICTION: f64 = 0.5;
/// The halves of the data disagree if they project the same points this many pixels apart. It is a warning if the distance
/// also exceeds their standard deviations.
///
/// It is an error, whatever their uncertainty, if it also exceeds this many metres in the field (two standard deviations of a
/// keypoint: 25 mm), or this many times the value of the median camera. Clothes and the side from which people are seen affect
/// all cameras alike, and near the camera pixels are millimetres; a knock moves one camera.
const DOUBTFUL_HALVES_PX: f64 = 2.0;
const WRONG_HALVES_PX: f64 = 6.0;
const WRONG_HALVES_M: f64 = 0.05;
const WRONG_HALVES_RATIO: f64 = 3.0;

/// The report on a solution.
pub(super) fn assess(found: &Found<'_>) -> Report {
    let apart = halves(&found.adjusted.problem);
    let sights = sights(found);
    let mut cameras = camera_reports(found, &apart, &sights);
    let mut findings = overall_findings(found);
    findings.extend(suspect_findings(found));
    // Before the standard deviations are widened by the halves, which would hide nearly all disagreements.
    let halves_px = cameras.iter().map(|it| it.halves_px);
    let usual_px = upper_median(halves_px.filter(|px| px.is_finite()).collect()).unwrap_or(0.0);
    for report in &cameras {
        findings.extend(halves_finding(report, usual_px));
    }
    widen_sigmas(&mut cameras);
    let aligned = Aligned {
        cameras: &found.named,
        anchors: &found.anchors,
        alignment: &found.alignment,
    };
    findings.extend(anchor_findings(&aligned, &cameras));
    let span_m = found.span_m();
    for (index, report) in cameras.iter().enumerate() {
        let noise = found.adjusted.noise.get(index).copied().unwrap_or(f64::NAN);
        let usual = upper_median(found.adjusted.noise.clone()).unwrap_or(1.0);
        findings.extend(noise_finding(&report.name, noise, usual));
        findings.extend(contradicting(
            report,
            found.evidence.contradictions.get(index),
        ));
        findings.extend(camera_findings(report, span_m, cameras.len()));
        findings.extend(knocked(report, sights.get(index)));
    }
    findings.sort_by_key(|finding| !finding.is_wrong());
    Report {
        cameras,
        anchors_rms_m: found.alignment.rms_m,
        people: people_report(found),
        field: None,
        findings,
    }
}

/// The residuals of each camera in the order of time.
fn sights(found: &Found<'_>) -> Vec<Vec<Residual>> {
    let problem = &found.adjusted.problem;
    let mut sights = vec![Vec::new(); problem.cameras.len()];
    for (observation, length) in problem.observations.iter().zip(problem.residuals_px()) {
        if let Some(own) = sights.get_mut(observation.camera) {
            own.push(length.map(|length| (length, length / observation.sigma_px)));
        }
    }
    sights
}

/// The length of a residual in pixels and in standard deviations; `None` without a projection.
type Residual = Option<(f64, f64)>;

fn is_used(sight: Residual) -> bool {
    sight.is_some_and(|(_, sigmas)| sigmas < USED_SIGMAS)
}

fn camera_reports(
    found: &Found<'_>,
    apart: &[Option<Apart>],
    sights: &[Vec<Residual>],
) -> Vec<CameraReport> {
    let scale = found.alignment.venue_from_found.scale;
    let mut reports = Vec::new();
    for (index, (state, own)) in found.states().iter().zip(sights).enumerate() {
        let posed = found.adjusted.posed.get(index);
        let Some(camera) = posed.and_then(|i| found.request.cameras.get(*i)) else {
            continue;
        };
        let clock = posed.and_then(|i| found.evidence.clocks.get(*i));
        let used: Vec<f64> = own
            .iter()
            .copied()
            .filter(|it| is_used(*it))
            .flatten()
            .map(|(length, _)| length)
            .collect();
        let squares: f64 = used.iter().map(|length| length * length).sum();
        let sigma = found
            .covariance
            .as_ref()
            .and_then(|c| c.cameras.get(index)?.as_ref());
        let half = apart.get(index).copied().flatten();
        let observations = found.adjusted.problem.observations.iter();
        let seen: Vec<&Observation> = observations.filter(|it| it.camera == index).collect();
        let used_px = seen.iter().zip(own).filter(|(_, it)| is_used(**it));
        let used_px = used_px.map(|(it, _)| it.px);
        let sigmas: Vec<f64> = seen.iter().map(|it| it.sigma_px).collect();
        reports.push(CameraReport {
            name: camera.name.clone(),
            sights: own.len(),
            used_share: used.len() as f64 / own.len().max(1) as f64,
            rms_px: (squares / used.len().max(1) as f64).sqrt(),
            noise_px: upper_median(sigmas).unwrap_or(f64::NAN),
            position_sigma_m: sigma.map_or(f64::NAN, |s| s.position * scale),
            rotation_sigma_deg: sigma.map_or(f64::NAN, |s| s.rotation_rad.to_degrees()),
            focal_ratio: state.intrinsics.fx_px / camera.intrinsics.fx_px,
            offset_s: clock.map_or(0.0, |it| it.offset_s),
            rate_hz: clock.map_or(found.request.rate_hz, |it| it.rate_hz),
            halves_m: half.map_or(f64::NAN, |it| it.distance * scale),
            halves_deg: half.map_or(f64::NAN, |it| it.turned_rad.to_degrees()),
            halves_px: half.map_or(f64::NAN, |it| it.px),
            halves_across_m: half.map_or(f64::NAN, |it| it.across * scale),
            coverage: PictureCoverage::new(camera.size_px, used_px),
        });
    }
    reports
}

/// Widens the standard deviations of all cameras by the median ratio of the difference between halves to the predicted one.
/// Errors of keypoints in one posture are correlated over many frames, which the covariance of the adjustment ignores.
fn widen_sigmas(cameras: &mut [CameraReport]) {
    // Each half has the standard deviation of the whole times the root of two, and there are two.
    let ratio = |halves: f64, sigma: f64| halves / (2.0 * sigma);
    let places = cameras
        .iter()
        .map(|it| ratio(it.halves_m, it.position_sigma_m));
    let turns = cameras
        .iter()
        .map(|it| ratio(it.halves_deg, it.rotation_sigma_deg));
    let middle = |ratios: Vec<f64>| {
        let known = ratios.into_iter().filter(|it| it.is_finite());
        upper_median(known.collect()).unwrap_or(1.0).max(1.0)
    };
    let (places, turns) = (middle(places.collect()), middle(turns.collect()));
    for camera in cameras {
        camera.position_sigma_m *= places;
        camera.rotation_sigma_deg *= turns;
    }
}

fn noise_finding(name: &str, noise: f64, usual: f64) -> Option<Finding> {
    let is_odd = noise > DOUBTFUL_NOISE && noise > WRONG_NOISE_RATIO * usual;
    (noise.is_nan() || noise > DOUBTFUL_NOISE).then(|| {
        finding(
            name,
            Cause::Residual,
            noise.is_nan() || noise > WRONG_NOISE || is_odd,
            format!(
                "its keypoints are off by {noise:.1} times the usual noise, those of the median camera by {usual:.1}"
            ),
            "less than 1.8: 25 mm on the body and 1 px",
            "check its lens and its clock, and whether it was moved",
        )
    })
}

fn contradicting(report: &CameraReport, share: Option<&f64>) -> Option<Finding> {
    let share = share
        .copied()
        .filter(|share| *share > DOUBTFUL_CONTRADICTION)?;
    Some(finding(
        &report.name,
        Cause::Outliers,
        share > WRONG_CONTRADICTION,
        format!(
            "it sees {:.0} % of the people in its picture elsewhere than the other cameras do",
            100.0 * share
        ),
        "a quarter or less",
        "its clock is off, it was moved, its lens is not as given, or its video is mirrored or of another camera",
    ))
}

fn camera_findings(report: &CameraReport, span_m: f64, cameras: usize) -> Vec<Finding> {
    let mut findings = Vec::new();
    let name = &report.name;
    if report.used_share < USUAL_SHARE {
        findings.push(finding(
            name,
            Cause::Outliers,
            report.used_share < LEAST_SHARE,
            format!("{:.0} % of its keypoints fit", 100.0 * report.used_share),
            "75 % or more",
            "it was moved during the recording, its clock is off, or its lens is not as given",
        ));
    }
    // With two cameras their distance is the unit.
    if cameras > 2 {
        findings.extend(uncertain_place(
            report,
            span_m,
            "let people walk near it and far from it, for longer, and where other cameras also see them",
        ));
    }
    findings.extend(other_focal_length(report));
    findings.extend(empty_picture(report, "let people walk"));
    findings
}

/// The finding about the halves of the data; those of the median camera differ by `usual_px`.
fn halves_finding(report: &CameraReport, usual_px: f64) -> Option<Finding> {
    let is_odd = report.halves_px > WRONG_HALVES_RATIO * usual_px;
    let is_far = report.halves_across_m > WRONG_HALVES_M;
    let check = HalvesCheck {
        doubtful_px: DOUBTFUL_HALVES_PX,
        is_wrong: report.halves_px > WRONG_HALVES_PX && (is_odd || is_far),
        what: "keypoints",
        needed: "15 keypoints or more in each half, in three cameras that do not stand on one line",
        remedy: "let people walk in front of it at the beginning and at the end",
    };
    halves_apart(report, &check)
}

/// The finding about a camera that fits only part of the time.
fn knocked(report: &CameraReport, sights: Option<&Vec<Residual>>) -> Option<Finding> {
    let used: Vec<bool> = sights?.iter().copied().map(is_used).collect();
    let percent = 100.0 * knocked_at(&used)?;
    Some(finding(
        &report.name,
        Cause::Knocked,
        true,
        format!("moved, or its clock jumped, at about {percent:.0} % of its keypoints"),
        "keypoints that fit equally well at all times",
        "leave out its frames before or after, or calibrate again",
    ))
}

/// Delays of a camera above which there is a warning, and an error, seconds: people walk 1.5 m a second.
const LATE_S: [f64; 2] = [0.012, 0.06];
/// Errors of a focal length above which there is a warning, and an error: people determine it to 1 or 2 %.
const FOCAL: [f64; 2] = [0.03, 0.045];

/// Findings about cameras that fit better with another clock or focal length.
pub(super) fn suspect_findings(found: &Found<'_>) -> Vec<Finding> {
    let bars = Bars {
        late: LATE_S.map(|late_s| late_s * found.ticks_hz),
        focal: FOCAL,
    };
    let unit = ClockUnit {
        hz: Some(found.ticks_hz),
        is_frame: found.request.timing == Timing::Synchronised,
    };
    let suspects = suspects(&found.adjusted.problem, bars);
    let each = suspects.iter().map(|it| {
        let posed = found.adjusted.posed.get(it.camera);
        let name = found.name(*posed.unwrap_or(&it.camera));
        it.finding(name, bars, unit)
    });
    each.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_that_project_a_point_far_apart_are_wrong_despite_uncertainty() {
        let report = CameraReport {
            name: "north".to_owned(),
            sights: 1000,
            used_share: 1.0,
            rms_px: 1.0,
            noise_px: 1.0,
            position_sigma_m: 10.0,
            rotation_sigma_deg: 10.0,
            focal_ratio: 1.0,
            offset_s: 0.0,
            rate_hz: 10.0,
            halves_m: 0.1,
            halves_deg: 0.5,
            halves_px: 1.0,
            halves_across_m: 0.01,
            coverage: PictureCoverage::default(),
        };
        let finding = |px: f64, across_m: f64, usual_px: f64| {
            let report = CameraReport {
                halves_px: px,
                halves_across_m: across_m,
                ..report.clone()
            };
            halves_finding(&report, usual_px)
        };
        let is_wrong = |px, across_m, usual_px| {
            finding(px, across_m, usual_px).is_some_and(|it| it.is_wrong())
        };
        let (px, across_m) = (WRONG_HALVES_PX, WRONG_HALVES_M);
        assert!(is_wrong(px + 0.1, across_m + 0.001, px));
        assert!(!is_wrong(px - 0.1, across_m + 0.001, px));
        // Near the camera, and no worse than the others: millimetres.
        assert!(!is_wrong(px + 0.1, across_m - 0.001, px));
        // A single camera that is apart was moved.
        assert!(is_wrong(px + 0.1, 0.01, px / WRONG_HALVES_RATIO));
        assert!(finding(f64::NAN, 0.0, 1.0).is_some_and(|it| it.cause == Cause::HalvesUnchecked));
    }
}
