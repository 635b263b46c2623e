//! What is said of a camera whatever it was calibrated from.

use super::finding::finding;
use super::{CameraReport, Cause, Finding, PictureEdge};

/// Uncertainty of a place that is doubtful, and wrong, as a share of the distance between cameras.
const DOUBTFUL_SIGMA: f64 = 0.005;
const WRONG_SIGMA: f64 = 0.03;
/// Change of the focal length that is doubtful, and wrong.
const DOUBTFUL_FOCAL: f64 = 0.02;
const WRONG_FOCAL: f64 = 0.06;
/// Share of the cells of a picture without a sight that is said.
const EMPTY: f64 = 0.6;

/// Where a camera stands is not known well enough, as a share of `span_m`, the distance between cameras, metres.
pub(crate) fn uncertain_place(report: &CameraReport, span_m: f64, remedy: &str) -> Option<Finding> {
    let share = report.position_sigma_m / span_m;
    (share.is_nan() || share > DOUBTFUL_SIGMA).then(|| {
        finding(
            &report.name,
            Cause::Uncertain,
            share.is_nan() || share > WRONG_SIGMA,
            format!("its place is known to {:.3} m", report.position_sigma_m),
            &format!("{:.3} m or better", DOUBTFUL_SIGMA * span_m),
            remedy,
        )
    })
}

/// The focal length that was found is not the one that was given.
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

/// Most of its picture saw nothing: what it sees there later is drawn by a lens and a pose that nothing checked there.
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
            format!(
                "{:.0} % of its picture has no sight that fits",
                100.0 * share
            ),
            "sights in most of what it sees of the field",
            &remedy,
        )
    })
}
