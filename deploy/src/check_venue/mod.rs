//! `farfield check`: checks in seconds, without a run, whether a venue can be run. It reads every file, opens every
//! source, and draws an image of every camera.
//!
//! Read (an unreadable venue is refused) -> files, calibration -> sources, time -> networks, keys, streams -> images.

mod networks;
mod opened;
mod pictures;
mod sources;
mod time;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use farfield_fusion_node::{check_names, load_subjects};
use farfield_node::log::start_log;
use farfield_node::process::{ErrorFormat, NodeError, exit_code_with_format};
use farfield_proto::calibration::Calibration;
use farfield_proto::plausibility::{self, Cause, Finding};
use farfield_proto::printed::fixed;
use farfield_proto::venue::Venue;
use farfield_sim::simulated::VenueSources;

use crate::keys::check_keys;
use crate::listeners::wanted::check_streams;
use crate::parameters::{FAR_REMEDY, far_parameters};
use crate::report_lines::{ReportForm, ReportLines};

use self::opened::open_all;

/// From this share on, an image counts as fully used.
const WHOLE_PICTURE: f64 = 0.999;

/// Arguments of `farfield check`.
#[derive(Debug, Args)]
pub(crate) struct CheckArgs {
    /// The venue file.
    pub(crate) venue: PathBuf,
    /// Folder for the images. Default: `farfield-out/check-VENUE`.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Print as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Checks a venue and prints the results. Exit code 0, or 1 if anything failed; 2 if the venue file cannot be read.
pub(crate) fn main(args: &CheckArgs) -> ExitCode {
    start_log();
    let mut report = ReportLines::default();
    let printed = check(&args.venue, args.out.as_deref(), &mut report).and_then(|()| {
        report
            .print(ReportForm::from_flag(args.json))
            .map_err(NodeError::Failed)
    });
    printed.unwrap_or_else(|error| {
        exit_code_with_format(Err(error), ErrorFormat::as_json_if(args.json))
    })
}

/// Checks everything of a venue.
///
/// # Errors
/// [`NodeError::Refused`] when the venue file cannot be read.
pub(crate) fn check(
    path: &Path,
    out: Option<&Path>,
    report: &mut ReportLines,
) -> Result<(), NodeError> {
    let venue = match farfield_node::files::load_venue(path) {
        Ok(venue) => venue,
        // The calibration is a separate file, often of another tool.
        Err(error) if error.path != path => {
            let names_command = error.problem.contains("`farfield calibrate convert");
            let remedy = if names_command {
                "run that command, and set the file that it writes in the venue file"
            } else {
                "fix it there, or calibrate again"
            };
            report.fail("calibration", error.to_string(), remedy);
            return Ok(());
        }
        Err(error) => return Err(NodeError::refused(error)),
    };
    check_venue_file(&venue, path, report);
    check_calibration(&venue, report);
    let opened = open_all(&VenueSources::default(), &venue);
    sources::check_sources(&venue, &opened, report);
    time::check_time(&venue, path, &opened, report);
    networks::check_networks(&venue, path, report);
    check_keys(&venue, path, farfield_node::clock::unix_s(), report);
    check_streams(&venue, report);
    check_subjects(&venue, report);
    let out = out.map_or_else(
        || Path::new("farfield-out").join(format!("check-{}", venue.name)),
        Path::to_path_buf,
    );
    pictures::draw(&venue, &opened, &out, report);
    Ok(())
}

fn check_venue_file(venue: &Venue, path: &Path, report: &mut ReportLines) {
    let text = format!(
        "{}: `{}`, {} cameras at {} viewpoints, {} ticks per second",
        path.display(),
        venue.name,
        venue.cameras.len(),
        venue.viewpoints.len(),
        venue.rate_hz
    );
    match check_names(venue) {
        Ok(()) => report.ok("venue", text),
        Err(error) => report.fail(
            "venue",
            error.to_string(),
            "give the viewpoint another `name`",
        ),
    }
    if let Some(words) = far_parameters(&venue.parameters) {
        report.warn("venue", words, FAR_REMEDY);
    }
}

fn check_subjects(venue: &Venue, report: &mut ReportLines) {
    if venue.subjects.is_empty() {
        return;
    }
    match load_subjects(venue) {
        Ok(known) => {
            let names: Vec<&str> = known.subjects.iter().map(|it| it.name.as_str()).collect();
            report.ok("subjects", names.join(", "));
        }
        Err(error) => report.fail(
            "subjects",
            error.to_string(),
            "`farfield people RUN save` writes a profile",
        ),
    }
}

fn check_calibration(venue: &Venue, report: &mut ReportLines) {
    let mut findings = plausibility::of_venue(venue);
    let path = &venue.calibration_path;
    let text = std::fs::read_to_string(path).unwrap_or_default();
    // It was read a moment ago; a change since then is left to the next check.
    if let Ok(calibration) = Calibration::parse(&text, path) {
        findings.extend(plausibility::of_rotations(&calibration));
    }
    for finding in &findings {
        push(finding, report);
    }
    if findings.is_empty() {
        report.ok(
            "calibration",
            format!("{}: found no problem", path.display()),
        );
    }
    report_used_shares(venue, report);
    let is_of_coverage =
        |it: &Finding| matches!(it.cause, Cause::FieldUnseen | Cause::OneViewpoint);
    if findings.iter().any(is_of_coverage) {
        return;
    }
    let seen = plausibility::coverage(venue);
    let [x0, y0, _] = venue.field.min_m;
    let [x1, y1, _] = venue.field.max_m;
    let [x0, x1, y0, y1] = [x0, x1, y0, y1].map(|v| fixed(v, 1));
    report.ok(
        "calibration",
        format!(
            "two viewpoints or more see {:.0} % of the field, x {x0} to {x1} m, y {y0} to {y1} m, from its floor to 2 m",
            100.0 * seen.by_two
        ),
    );
}

/// Reports images of which only a part is used.
fn report_used_shares(venue: &Venue, report: &mut ReportLines) {
    let fisheyes = venue.cameras.iter();
    for camera in fisheyes.filter(|camera| camera.model.lens().is_fisheye()) {
        let share = plausibility::used_share(&camera.model);
        if share < WHOLE_PICTURE {
            report.ok(
                "calibration",
                format!(
                    "camera `{}`: {:.0} % of its fisheye image are used, up to 60 degrees off its axis (120 degrees of \
                     view): people farther out are ignored",
                    camera.model.name(),
                    100.0 * share
                ),
            );
        }
    }
}

/// Adds a finding of the calibration.
fn push(finding: &Finding, report: &mut ReportLines) {
    report.push(
        "calibration",
        finding.severity.into(),
        finding.problem(),
        finding.remedy.as_str(),
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report_lines::Verdict;

    #[test]
    fn a_coverage_that_is_too_small_is_not_reported_as_ok() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("venue.sample.toml");
        let mut venue = farfield_node::files::load_venue(&path).unwrap();
        let shares = |venue: &Venue| {
            let mut report = ReportLines::default();
            check_calibration(venue, &mut report);
            let is_share =
                |it: &&crate::report_lines::ReportLine| it.text.contains(" % of the field");
            let shares = report.lines().iter().filter(is_share);
            shares.map(|it| it.verdict).collect::<Vec<_>>()
        };
        assert_eq!(shares(&venue), [Verdict::Ok]);
        let (min_m, max_m) = (venue.field.min_m, venue.field.max_m);
        venue.field.min_m[0] += 1e4;
        venue.field.max_m[0] += 1e4;
        assert_eq!(shares(&venue), [Verdict::Failed]);
        (venue.field.min_m, venue.field.max_m) = (min_m, max_m);
        venue.viewpoints.truncate(1);
        venue.cameras.retain(|camera| camera.viewpoint.0 == 0);
        assert_eq!(shares(&venue), []);
    }
}
