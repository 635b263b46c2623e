//! `farfield run`: every node of a venue as a process of this machine, in lock-step over loopback or live.
//!
//! Check (everything that can be refused, before anything is created) -> claim -> watch -> report.
mod args;
mod check;
mod children;
mod node_lines;
mod place;
mod progress;
mod report;
mod values;
mod verdict;
mod watch;

use std::path::Path;
use std::process::ExitCode;

use farfield_fusion_node::FolderClaim;
use farfield_node::log::start_log;
use farfield_node::process::{Ending, ErrorFormat, NodeError, exit_code_with_format, say};

pub(crate) use self::args::RunArgs;
pub(crate) use self::check::{RunPlan, check};
pub(crate) use self::progress::{Follow, ProgressDetail, TimeLeft};
pub(crate) use self::report::done;
pub(crate) use self::verdict::{RunEnd, RunVerdict};
pub(crate) use self::watch::Session;

use self::progress::ProgressLine;
use crate::overlay::{draw_poses, overlay};

/// Runs a venue to its end and prints the results.
pub(crate) fn main(args: RunArgs) -> ExitCode {
    start_log();
    let told = ErrorFormat::as_json_if(args.json);
    exit_code_with_format(run(args), told)
}

fn run(args: RunArgs) -> Result<Ending, NodeError> {
    let json = args.json;
    let (mut plan, networks) = check(args)?;
    if !networks.backend.is_empty() {
        say(format_args!("{}", networks.backend));
    }
    drop(networks);
    let mut session = Session::open()?;
    // From here on signals are caught: the folder shows that the run has begun.
    let claim =
        FolderClaim::take(plan.out.as_deref(), &plan.venue.name).map_err(NodeError::Refused)?;
    plan.stage(claim.folder()).map_err(NodeError::Failed)?;
    let end = session.watch(&plan, claim.folder(), &mut ProgressLine::new(&plan))?;
    finish(&plan, &claim, end, json)
}

/// Draws the overlays and prints the results of the run.
pub(crate) fn finish(
    plan: &RunPlan,
    claim: &FolderClaim,
    end: RunEnd,
    json: bool,
) -> Result<Ending, NodeError> {
    let out = claim.folder();
    if end.last.is_none() {
        report::discard_unfinished(out);
    } else {
        claim.salvage();
    }
    if matches!(end.verdict, RunVerdict::Done) {
        draw(plan, out).map_err(NodeError::Failed)?;
    }
    let agreed = match end.verdict {
        RunVerdict::Done if plan.strict => report::check_agreement(out).map_err(NodeError::Failed),
        _ => Ok(()),
    };
    let printed = match &end.verdict {
        // JSON output has one object: the error.
        RunVerdict::Failed(_) if json => Ok(()),
        _ if json && agreed.is_err() => Ok(()),
        _ => report::print(out, json).map_err(NodeError::Failed),
    };
    if report::has_unfinished(out) {
        let files = out.join("*.tmp");
        say(format_args!("unfinished files are in {}", files.display()));
    }
    match end.verdict {
        RunVerdict::Done => printed.and(agreed).map(|()| Ending::Done),
        RunVerdict::Interrupted => printed.map(|()| Ending::Interrupted),
        RunVerdict::Failed(error) => Err(error),
    }
}

/// Draws the overlay ticks of the plan with the poses that the run has recorded.
fn draw(plan: &RunPlan, out: &Path) -> anyhow::Result<()> {
    let of = (&plan.venue, &plan.overlay[..], &*out.join("poses.jsonl"));
    draw_poses(of, out, |camera, tick, persons| {
        overlay(&plan.sources, &plan.venue, camera, tick, persons)
    })
}
