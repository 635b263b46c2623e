//! `farfield doctor`: whether this machine can do what a venue asks of it: inference, programs, disk, clock, ports, keys, and which
//! version the nodes of a venue run that runs now.
//!
//! Each part is looked at for itself, with what it looks at as an argument, and adds its lines; together they take less
//! than five seconds, for which nodes are waited for while networks run. Nothing is changed: what is written to measure the
//! disk is taken away again.

mod clock;
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
use farfield_node::process::{NodeError, Told, exit_code_told};
use farfield_node::{clock as node_clock, system_clock};
use farfield_proto::transport::Exposure;
use farfield_proto::transport::endpoint::is_endpoint;
use farfield_proto::venue::{Source, Venue};

use crate::exchange::target::check_folder;
use crate::keys::look_at_keys;
use crate::report_lines::{ReportForm, ReportLines};

pub(crate) use self::inference::{measured_workers, people_at};

use self::disk::DiskNeed;
use self::ports::VenueRuns;
use self::programs::ProgramNeed;

/// Arguments of `farfield doctor`.
#[derive(Debug, Args)]
pub(crate) struct DoctorArgs {
    /// The venue file: its network, its ports and its keys are looked at too.
    pub(crate) venue: Option<PathBuf>,
    /// Where fusion listens, whose nodes are asked which version they run; the venue file's, if left out.
    #[arg(long, value_name = "ENDPOINT", requires = "venue")]
    pub(crate) connect: Vec<String>,
    /// Folder for results, whose disk is measured. Default: `farfield-out`, or where it would be made.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Print as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Looks at this machine and prints what was found: exit code 0, or 1 when anything failed; 2 when the venue cannot be
/// read.
pub(crate) fn main(args: &DoctorArgs) -> ExitCode {
    start_log();
    let printed = doctor(args).and_then(|report| {
        report
            .print(ReportForm::of(args.json))
            .map_err(NodeError::Failed)
    });
    printed.unwrap_or_else(|error| exit_code_told(Err(error), Told::as_json_if(args.json)))
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
    machine::look_at_machine(&machine::facts(), &mut report);
    let (of_nodes, runs) = look_at_inference_and_nodes(venue, &args.connect, &mut report);
    let path = std::env::var_os("PATH").unwrap_or_default();
    programs::look_at_programs(&path, program_need(venue), &mut report);
    disk::look_at_disk(folder, DiskNeed::of(venue), &mut report);
    clock::look_at_clock(
        &system_clock::read(),
        node_clock::unix_s(),
        venue,
        &mut report,
    );
    ports::look_at_ports(venue, runs, &mut report);
    if let (Some(venue), Some(path)) = (venue, &args.venue) {
        look_at_keys(venue, path, node_clock::unix_s(), &mut report);
    }
    report.append(of_nodes);
    Ok(report)
}

/// Runs networks, and meanwhile joins `venue`, if there is one, which is waiting for the most part; what is said of its nodes
/// comes last, and is returned, with whether it runs. Both are done before ports are tried: who joins must not meet them.
fn look_at_inference_and_nodes(
    venue: Option<&Venue>,
    connect: &[String],
    report: &mut ReportLines,
) -> (ReportLines, VenueRuns) {
    std::thread::scope(|scope| {
        let joining = scope.spawn(|| {
            let mut of_nodes = ReportLines::default();
            let runs = venue.map(|venue| nodes::look_at_nodes(venue, connect, &mut of_nodes));
            (of_nodes, runs.unwrap_or(VenueRuns::No))
        });
        inference::look_at_inference(venue, report);
        joining.join().unwrap_or_else(|_| nodes::not_looked_at())
    })
}

/// How much a venue needs the programs that decode video; any, without one.
fn program_need(venue: Option<&Venue>) -> ProgramNeed {
    let is_decoded =
        |source: &Source| matches!(source, Source::Video { .. } | Source::Ffmpeg { .. });
    match venue {
        Some(venue) if !venue.cameras.iter().any(|it| is_decoded(&it.source)) => ProgramNeed::None,
        _ => ProgramNeed::Video,
    }
}

/// What `venue` says of who may talk to whom; nothing, without one.
fn exposure(venue: Option<&Venue>) -> Exposure {
    Exposure {
        has_keys: venue.is_some_and(|it| it.security.certificates.is_some()),
        allow_plaintext: venue.is_some_and(|it| it.security.allow_plaintext),
    }
}
