//! What can be said on the laboratory's command line.
//!
//! Studies that run live start nodes as processes of this very program. So a first argument that is a
//! command of `farfield` is handed on to it, unseen in the help: `lab edge VENUE ...` is an edge, and the
//! scenarios test the operator's commands through the same program. Exit codes are those of `farfield`.

mod budget;
mod bytes;
mod codec;
mod crowd;
mod delays;
mod faults;
mod figures;
mod fuzz;
mod links;
mod live_pixels;
mod made_maps;
mod maps;
mod render;
mod scene_argument;
mod soak;
mod suite;
mod training;
mod walk_venue;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use farfield_edge::network::answer_trial;
use farfield_node::process::{Ending, exit_code};

use self::budget::BudgetArgs;
use self::bytes::BytesArgs;
use self::codec::CodecArgs;
use self::crowd::CrowdArgs;
use self::delays::DelaysArgs;
use self::faults::FaultsArgs;
use self::figures::FiguresArgs;
use self::fuzz::corpus::CorpusArgs;
use self::fuzz::seeds::FuzzSeedsArgs;
use self::links::LinksArgs;
use self::live_pixels::LivePixelsArgs;
use self::maps::MapsArgs;
use self::render::RenderArgs;
use self::soak::SoakArgs;
use self::suite::SuiteArgs;
use self::training::crops::CropsArgs;
use self::training::frames::FramesArgs;
use self::walk_venue::WalkVenueArgs;

/// How good Farfield is, and why: suites and studies over simulated venues and recordings.
///
/// Exit codes: 0 done, 1 ran but failed, 2 wrong input or usage.
#[derive(Debug, Parser)]
#[command(name = "lab", version)]
struct Lab {
    #[command(subcommand)]
    command: LabCommand,
}

/// One thing to do.
#[derive(Debug, Subcommand)]
enum LabCommand {
    /// Run fixed scenes in this process and score them, beside plain triangulation.
    Suite(SuiteArgs),
    /// What is said of cameras of which nothing is wrong: false alarms, over scenes.
    Agreement(suite::agreement::AgreementArgs),
    /// What maps cost on the wire against what they are worth: every compression level of our codec beside
    /// what others send, all through the same loop.
    Bytes(BytesArgs),
    /// How good a venue is over links that are far, thin and lossy: all nodes live, as processes.
    Links(LinksArgs),
    /// A venue of videos at its real rate, with real networks, beside the same venue in lock-step.
    LivePixels(LivePixelsArgs),
    /// What a venue meets in its first month, driven for real: clocks, nodes, links, strangers, disks.
    Faults(FaultsArgs),
    /// Many people and viewpoints, live: whether fusion keeps up with sets that were made beforehand.
    Crowd(CrowdArgs),
    /// Whether anything grows in a venue that runs live for long.
    Soak(SoakArgs),
    /// One scene with changed parameters: its figures, and where the error comes from.
    Budget(BudgetArgs),
    /// What a delay is worth: live, smoothed with 50, 100 and 200 ms, and in two passes.
    Delays(DelaysArgs),
    /// Render ticks of a scene as one camera sees them, and say how long it took.
    Render(RenderArgs),
    /// Write down the maps of a scene or a venue, before any codec.
    Maps(MapsArgs),
    /// What each compression level of the codec makes of maps that were written down.
    Codec(CodecArgs),
    /// Render crops of people with their keypoints, to train the embedded pose network on.
    TrainingCrops(CropsArgs),
    /// Render pictures with the boxes of their people, to train the embedded detector on.
    TrainingFrames(FramesArgs),
    /// Write whole inputs for the fuzz targets of binary formats.
    FuzzSeeds(FuzzSeedsArgs),
    /// Take the corpus of the fuzz targets out of its archive, or put it back.
    FuzzCorpus(CorpusArgs),
    /// Print the figures of the project's own code, each beside its goal.
    Figures(FiguresArgs),
    /// Write the sample venue of two walkers anew.
    WalkVenue(WalkVenueArgs),
}

/// Does what the command line of this process says.
///
/// Ends the process itself, with exit code 2, on wrong usage.
pub fn main() -> ExitCode {
    if let Some(code) = answer_trial() {
        return code;
    }
    let first = std::env::args_os().nth(1);
    if first.is_some_and(|first| first.to_str().is_some_and(farfield::knows)) {
        return farfield::main();
    }
    let done = match Lab::parse().command {
        LabCommand::Suite(args) => suite::suite(&args),
        LabCommand::Agreement(args) => suite::agreement::agreement(&args),
        LabCommand::Bytes(args) => bytes::study(&args),
        LabCommand::Links(args) => links::links(&args),
        LabCommand::LivePixels(args) => live_pixels::live_pixels(&args),
        LabCommand::Faults(args) => faults::faults(&args),
        LabCommand::Crowd(args) => crowd::crowd(&args),
        LabCommand::Soak(args) => soak::soak(&args),
        LabCommand::Budget(args) => budget::budget(&args),
        LabCommand::Delays(args) => delays::delays(&args),
        LabCommand::Render(args) => render::render(&args),
        LabCommand::Maps(args) => maps::write(&args),
        LabCommand::Codec(args) => codec::measure(&args),
        LabCommand::TrainingCrops(args) => training::crops::write(&args),
        LabCommand::TrainingFrames(args) => training::frames::write(&args),
        LabCommand::FuzzSeeds(args) => fuzz::seeds::write_seeds(&args),
        LabCommand::FuzzCorpus(args) => fuzz::corpus::corpus(&args),
        LabCommand::Figures(args) => figures::print(&args),
        LabCommand::WalkVenue(args) => walk_venue::write(&args),
    };
    exit_code(done.map(|()| Ending::Done))
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Lab::command().debug_assert();
    }

    #[test]
    fn no_command_hides_one_of_farfield() {
        for command in Lab::command().get_subcommands() {
            let name = command.get_name();
            assert!(!farfield::knows(name), "{name}");
        }
    }
}
