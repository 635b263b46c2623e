//! `farfield doctor`: checks that this machine is ready for a venue: inference, programs, disk, clock, ports, keys, and
//! the versions of running nodes.
//!
//! Each part is independent: it takes its inputs as arguments and adds its lines. Together they take less than five
//! seconds: the program waits for nodes while it runs networks. Nothing is changed: files written to measure the disk
//! are deleted.

mod disk;
mod inference;
mod machine;
mod nodes;
mod ports;
mod programs;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::anyhow;
use clap::Args;
use farfield_node::files::load_venue;
use farfield_node::log::start_log;
use farfield_node::process::{ErrorFormat, NodeError, exit_code_with_format};
use farfield_node::{clock as node_clock, system_clock};
use farfield_proto::transport::Exposure;
use farfield_proto::transport::endpoint::is_endpoint;
use farfield_proto::venue::{Source, Venue};

use crate::exchange::target::check_folder;
use crate::keys::check_keys;
use crate::networks::report_installed;
use crate::report_lines::{ReportForm, ReportLines};

pub(crate) use self::inference::{check_card, measured_workers, people_at};

use self::disk::DiskNeed;
use self::ports::VenueRuns;
use self::programs::ProgramNeed;

/// Arguments of `farfield doctor`.
#[derive(Debug, Args)]
pub(crate) struct DoctorArgs {
    /// The venue file: also checks its network, ports and keys.
    pub(crate) venue: Option<PathBuf>,
    /// Endpoint of a running fusion, to query the versions of its nodes; default: that of the venue file.
    #[arg(long, value_name = "ENDPOINT", requires = "venue")]
    pub(crate) connect: Vec<String>,
    /// Folder for results; its disk is measured. Default: `farfield-out`.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Print as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Checks this machine and prints the results. Exit code 0, or 1 if anything failed; 2 if the venue cannot be read.
pub(crate) fn main(args: &DoctorArgs) -> ExitCode {
    start_log();
    let printed = doctor(args).and_then(|report| {
        report
            .print(ReportForm::from_flag(args.json))
            .map_err(NodeError::Failed)
    });
    printed.unwrap_or_else(|error| {
        exit_code_with_format(Err(error), ErrorFormat::as_json_if(args.json))
    })
}

fn doctor(args: &DoctorArgs) -> Result<ReportLines, NodeError> {
    let venue = args
        .venue
        .as_deref()
        .map(load_venue)
        .transpose()
        .map_err(NodeError::refused)?;
    let venue = venue.as_ref();
    if let Some(wrong) = args.connect.iter().find(|text| !is_endpoint(text)) {
        let problem = "expected an endpoint such as quic/fusion.lan:7447";
        return Err(NodeError::Refused(anyhow!(
            "`--connect`: found `{wrong}`, {problem}"
        )));
    }
    let folder = args.out.as_deref().unwrap_or(Path::new("farfield-out"));
    check_folder("--out", folder).map_err(NodeError::Refused)?;
    let mut report = ReportLines::default();
    machine::check_machine(&machine::facts(), &mut report);
    let (of_nodes, runs) = check_inference_and_nodes(venue, &args.connect, &mut report);
    report_installed(&mut report);
    let path = std::env::var_os("PATH").unwrap_or_default();
    programs::check_programs(&path, program_need(venue), &mut report);
    disk::check_disk(folder, DiskNeed::for_venue(venue), &mut report);
    machine::check_clock(
        &system_clock::read(),
        node_clock::unix_s(),
        venue,
        &mut report,
    );
    ports::check_ports(venue, runs, &mut report);
    if let (Some(venue), Some(path)) = (venue, &args.venue) {
        check_keys(venue, path, node_clock::unix_s(), &mut report);
    }
    report.append(of_nodes);
    Ok(report)
}

/// Runs networks and meanwhile joins `venue`, if given, which mostly waits. Returns the lines on its nodes, which come
/// last, and whether it runs. Both are done before the ports are tried, as a join must not meet those tests.
fn check_inference_and_nodes(
    venue: Option<&Venue>,
    connect: &[String],
    report: &mut ReportLines,
) -> (ReportLines, VenueRuns) {
    std::thread::scope(|scope| {
        let joining = scope.spawn(|| {
            let mut of_nodes = ReportLines::default();
            let runs = venue.map(|venue| nodes::check_nodes(venue, connect, &mut of_nodes));
            (of_nodes, runs.unwrap_or(VenueRuns::No))
        });
        inference::check_inference(venue, report);
        joining.join().unwrap_or_else(|_| nodes::not_checked())
    })
}

/// Whether a venue needs the programs that decode video; without a venue, yes.
fn program_need(venue: Option<&Venue>) -> ProgramNeed {
    let is_decoded =
        |source: &Source| matches!(source, Source::Video { .. } | Source::Ffmpeg { .. });
    match venue {
        Some(venue) if !venue.cameras.iter().any(|it| is_decoded(&it.source)) => ProgramNeed::None,
        _ => ProgramNeed::Video,
    }
}

/// The network exposure that `venue` allows; without a venue, none.
fn exposure(venue: Option<&Venue>) -> Exposure {
    Exposure {
        has_keys: venue.is_some_and(|it| it.security.certificates.is_some()),
        allow_plaintext: venue.is_some_and(|it| it.security.allow_plaintext),
    }
}
