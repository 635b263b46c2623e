//! Checks that the networks of a venue load and run, and have the venue's keypoints.

use std::path::Path;

use farfield_edge::node::load_networks;
use farfield_fusion_node::{check_detector, check_given_keypoints, load_card};
use farfield_proto::venue::Venue;

use crate::report_lines::ReportLines;

const NETWORKS: &str = "networks";
/// Remedy for a venue without a detector.
const DETECTOR: &str = "detector = \"models/CARD.toml\"";

/// Loads the networks of the venue and runs one crop.
pub(super) fn check_networks(venue: &Venue, path: &Path, report: &mut ReportLines) {
    match load_card(venue) {
        Err(error) => {
            report.fail(
                NETWORKS,
                format!("{error:#}"),
                "correct `network` in the venue file, or the card",
            );
            return;
        }
        Ok(card) => {
            if let Err(error) = check_given_keypoints(venue, path, card.as_ref()) {
                report.fail(NETWORKS, error.to_string(), "correct the `[[person]]`");
            }
        }
    }
    if !venue.needs_network() {
        report.ok(NETWORKS, "no source has images: no network is needed");
        return;
    }
    check_for_detector(venue, path, report);
    let mut networks = match load_networks(venue, &venue.cameras) {
        Ok(networks) => networks,
        Err(error) => {
            report.fail(
                NETWORKS,
                error.to_string(),
                "check with `farfield doctor` that inference works here; else correct `network` and `detector`, or their cards",
            );
            return;
        }
    };
    match networks.crop_time() {
        Ok(Some(time)) => {
            let text = format!(
                "{}: one crop takes {:.1} ms",
                networks.backend,
                1000.0 * time.as_secs_f64()
            );
            report.ok(NETWORKS, text);
        }
        Ok(None) => {}
        Err(error) => report.fail(
            NETWORKS,
            error.to_string(),
            "correct `network`, or its card",
        ),
    }
}

/// Checks that people in images can be detected.
fn check_for_detector(venue: &Venue, path: &Path, report: &mut ReportLines) {
    if let Err(error) = check_detector(venue, path) {
        report.fail(NETWORKS, error.to_string(), DETECTOR);
    } else if venue.detector.is_none() && venue.given_persons.is_empty() {
        report.warn(
            NETWORKS,
            "the venue has no `detector` and no `[[person]]`: people are not detected in images, only by the other \
             cameras",
            DETECTOR,
        );
    }
}

#[cfg(test)]
mod tests {
    use farfield_node::files::load_venue;

    use super::*;
    use crate::report_lines::Verdict;

    #[test]
    fn images_without_a_detector_fail_unless_people_are_known_otherwise() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("venue.sample.toml");
        let mut venue = load_venue(&path).unwrap();
        let verdicts = |venue: &Venue| {
            let mut report = ReportLines::default();
            check_for_detector(venue, &path, &mut report);
            let verdicts = report.lines().iter().map(|line| line.verdict);
            verdicts.collect::<Vec<_>>()
        };
        assert_eq!(verdicts(&venue), []);
        venue.detector = None;
        assert_eq!(verdicts(&venue), [], "a person is given");
        venue.given_persons.clear();
        assert_eq!(verdicts(&venue), [Verdict::Failed]);
        // The last viewpoint has keypoints; now one camera of the first has them, too.
        venue.cameras[0].source = venue.cameras[2].source.clone();
        assert_eq!(verdicts(&venue), [Verdict::Warning]);
    }
}
