//! Findings about a calibration, and those about a camera that all calibrations share.

use farfield_proto::finding::Severity;

use super::{CameraReport, PictureEdge};

/// The cause of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cause {
    /// A camera has no pose: it shares too little with the others, or agrees with none.
    NotConnected,
    /// Many sights of a camera do not fit.
    Outliers,
    /// The sights do not determine all parameters.
    Degenerate,
    /// The position of a camera is uncertain.
    Uncertain,
    /// The halves of the data disagree: a camera was moved, or a clock drifts.
    HalvesDisagree,
    /// The halves of the data could not be compared.
    HalvesUnchecked,
    /// The adjusted focal length is far from the given one.
    Focal,
    /// Residuals are much larger than those of other cameras.
    Residual,
    /// The lens model folds inside the picture.
    LensFolds,
    /// The scale is unknown.
    NoScale,
    /// The direction of up is unknown.
    NoFloor,
    /// Known places are far from where they were found.
    Anchors,
    /// The world is mirrored or upside down, or this cannot be checked.
    Handedness,
    /// A camera fits only part of the time: it was moved, or its clock jumped.
    Knocked,
    /// A camera is under the floor.
    UnderFloor,
    /// The walks of people determine the cameras poorly: along one line, or at one distance.
    Walk,
    /// Feet do not lie on one plane, or people do not stand upright on it.
    Feet,
    /// Too few people were seen for too short a time.
    TooFewPeople,
    /// The clock of a camera is not as given.
    Clock,
    /// A part of the field is seen by too few cameras, or most of a picture has no sights.
    Coverage,
    /// People come out larger or smaller than they are.
    Stature,
}

/// A finding about a calibration.
pub type Finding = farfield_proto::finding::Finding<Cause>;

/// A finding about a camera, or about all if `camera` is empty.
pub(crate) fn finding(
    camera: &str,
    cause: Cause,
    is_wrong: bool,
    found: String,
    expected: &str,
    remedy: &str,
) -> Finding {
    Finding {
        camera: (!camera.is_empty()).then(|| camera.to_owned()),
        cause,
        severity: if is_wrong {
            Severity::Wrong
        } else {
            Severity::Doubtful
        },
        found,
        expected: expected.to_owned(),
        remedy: remedy.to_owned(),
    }
}

/// Standard deviation of a position, relative to the distance between cameras, above which there is a warning.
const DOUBTFUL_SIGMA: f64 = 0.005;
/// The same for an error.
const WRONG_SIGMA: f64 = 0.03;
/// Relative change of the focal length above which there is a warning.
const DOUBTFUL_FOCAL: f64 = 0.02;
/// The same for an error.
const WRONG_FOCAL: f64 = 0.06;
/// Share of cells of a picture without sights above which there is a finding.
const EMPTY: f64 = 0.6;
/// The halves of the data disagree if they are this many standard deviations apart.
const HALVES_SIGMAS: f64 = 5.0;

/// The finding about an uncertain position, relative to `span_m`, the largest distance between cameras, metres.
pub(crate) fn uncertain_place(report: &CameraReport, span_m: f64, remedy: &str) -> Option<Finding> {
    let share = report.position_sigma_m / span_m;
    (share.is_nan() || share > DOUBTFUL_SIGMA).then(|| {
        finding(
            &report.name,
            Cause::Uncertain,
            share.is_nan() || share > WRONG_SIGMA,
            format!("its position is known to {:.3} m", report.position_sigma_m),
            &format!("{:.3} m or better", DOUBTFUL_SIGMA * span_m),
            remedy,
        )
    })
}

/// The finding about an adjusted focal length that differs from the given one.
pub(crate) fn other_focal_length(report: &CameraReport) -> Option<Finding> {
    let change = (report.focal_ratio - 1.0).abs();
    (change > DOUBTFUL_FOCAL).then(|| {
        finding(
            &report.name,
            Cause::Focal,
            change > WRONG_FOCAL,
            format!(
                "its focal length is {:.3} of the given one",
                report.focal_ratio
            ),
            "within a hundredth or two",
            "calibrate its lens again, at the zoom and focus that it has now",
        )
    })
}

/// What the halves of a camera's data are compared by.
pub(crate) struct HalvesCheck<'a> {
    /// Distance of the same points above which there is a warning, if it also exceeds the standard deviations, pixels.
    pub(crate) doubtful_px: f64,
    /// Whether it is an error, whatever the standard deviations.
    pub(crate) is_wrong: bool,
    /// What a camera sees of the object: its sights or keypoints.
    pub(crate) what: &'a str,
    /// What each half needs to be compared.
    pub(crate) needed: &'a str,
    /// The remedy if a half has too little.
    pub(crate) remedy: &'a str,
}

/// The finding about the halves of the data.
pub(crate) fn halves_apart(report: &CameraReport, check: &HalvesCheck<'_>) -> Option<Finding> {
    let (apart_px, what) = (report.halves_px, check.what);
    // An infinite distance means that one half cannot project the points, which is an error. NaN means not compared.
    if apart_px.is_nan() {
        return Some(finding(
            &report.name,
            Cause::HalvesUnchecked,
            false,
            format!("halves not checked: one of them has too few {what} of it or of other cameras"),
            check.needed,
            check.remedy,
        ));
    }
    // Each half has the standard deviation of the whole times the root of two, and there are two.
    let is_far = report.halves_m > HALVES_SIGMAS * 2.0 * report.position_sigma_m;
    let is_turned = report.halves_deg > HALVES_SIGMAS * 2.0 * report.rotation_sigma_deg;
    let is_doubtful = apart_px > check.doubtful_px && (is_far || is_turned);
    (check.is_wrong || is_doubtful).then(|| {
        finding(
            &report.name,
            Cause::HalvesDisagree,
            check.is_wrong,
            format!(
                "first and second half put it {:.3} m and {:.3} degrees apart, which moves its {what} by {apart_px:.1} px, {:.0} mm",
                report.halves_m,
                report.halves_deg,
                1000.0 * report.halves_across_m
            ),
            &format!("{:.1} px or less", check.doubtful_px),
            "it was moved during the recording, its clock drifts, or its lens is not as given",
        )
    })
}

/// The finding about a picture that is mostly without sights: later sights there depend on an unchecked lens and pose.
pub(crate) fn empty_picture(report: &CameraReport, what: &str) -> Option<Finding> {
    let share = report.coverage.empty_share();
    let edges = report.coverage.empty_edges();
    let names: Vec<&str> = edges.into_iter().map(PictureEdge::name).collect();
    let remedy = match names.as_slice() {
        [] => format!("{what} in more of its picture"),
        [only] => format!("{what} also at the {only} edge of its picture"),
        [.., last] => {
            let others = names[..names.len() - 1].join(", ");
            format!("{what} also at the {others} and {last} edges of its picture")
        }
    };
    (share > EMPTY).then(|| {
        finding(
            &report.name,
            Cause::Coverage,
            false,
            format!("{:.0} % of its picture has no fitting sight", 100.0 * share),
            "sights in most of the part of the field that it sees",
            &remedy,
        )
    })
}
