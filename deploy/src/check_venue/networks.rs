//! Whether the networks of a venue load, run, and know what the venue names.

use std::path::Path;

use farfield_edge::node::load_networks;
use farfield_fusion::node::{check_given_keypoints, load_card};
use farfield_proto::venue::Venue;

use crate::report_lines::ReportLines;

/// The group of these lines.
const NETWORKS: &str = "networks";

/// Loads what the venue names and runs one crop.
pub(super) fn look_at_networks(venue: &Venue, path: &Path, report: &mut ReportLines) {
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
        report.ok(NETWORKS, "no source gives pictures: no network is needed");
        return;
    }
    let mut networks = match load_networks(venue, &venue.cameras) {
        Ok(networks) => networks,
        Err(error) => {
            report.fail(
                NETWORKS,
                error.to_string(),
                "`farfield doctor` says whether inference works here; else correct `network` and `detector`, or their cards",
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
    if venue.detector.is_none() && venue.given_persons.is_empty() {
        report.warn(
            NETWORKS,
            "the venue names no `detector` and gives no `[[person]]`: nobody will be found in pictures",
            "detector = \"models/CARD.toml\"",
        );
    }
}
