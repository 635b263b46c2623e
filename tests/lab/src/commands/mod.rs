//! The laboratory's command line.
//!
//! Live studies start nodes as processes of this same program. So a first argument that is a command of `farfield` is passed
//! on to it, hidden in the help: `lab edge VENUE ...` is an edge, and the scenarios test the operator's commands through the
//! same program. Exit codes are those of `farfield`.

mod budget;
mod bytes;
mod checkout;
mod codec;
mod crowd;
mod delays;
mod faults;
mod fuzz;
mod links;
mod live_pixels;
mod maps;
mod real;
mod render;
mod scenes;
mod soak;
mod suite;
mod training;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use farfield_edge::network::answer_trial;
use farfield_node::process::{Ending, exit_code};

use self::budget::BudgetArgs;
use self::bytes::BytesArgs;
use self::checkout::{FiguresArgs, WalkVenueArgs};
use self::codec::CodecArgs;
use self::crowd::CrowdArgs;
use self::delays::DelaysArgs;
use self::faults::FaultsArgs;
use self::fuzz::{CorpusArgs, FuzzSeedsArgs};
use self::links::LinksArgs;
use self::live_pixels::LivePixelsArgs;
use self::maps::MapsArgs;
use self::real::RealArgs;
use self::render::RenderArgs;
use self::soak::SoakArgs;
use self::suite::SuiteArgs;
use self::training::crops::CropsArgs;
use self::training::frames::FramesArgs;

/// Suites and studies of Farfield's accuracy over simulated venues and recordings.
///
/// Exit codes: 0 done, 1 ran but failed, 2 wrong input or usage.
#[derive(Debug, Parser)]
#[command(name = "lab", version)]
struct Lab {
    #[command(subcommand)]
    command: LabCommand,
}

#[derive(Debug, Subcommand)]
enum LabCommand {
    /// Run fixed scenes in this process, and score them against plain triangulation.
    Suite(SuiteArgs),
    /// Count false alarms about cameras in scenes without wrong cameras.
    Agreement(suite::AgreementArgs),
    /// Compare bytes on the wire and accuracy of our codec at every compression level and of other codecs.
    Bytes(BytesArgs),
    /// Measure accuracy over links that are far, thin and lossy, with all nodes live as processes.
    Links(LinksArgs),
    /// Compare a venue of videos at its real rate with the same venue in lock-step.
    LivePixels(LivePixelsArgs),
    /// Run real recordings, and compare with views that were withheld and with plain triangulation.
    Real(RealArgs),
    /// Run the faults of a venue's first month: clocks, nodes, links, strangers, disks.
    Faults(FaultsArgs),
    /// Check that fusion keeps up with recorded sets of many people and viewpoints, live.
    Crowd(CrowdArgs),
    /// Check that nothing grows in a venue that runs live for long.
    Soak(SoakArgs),
    /// Run one scene with changed parameters, and print its scores and the error after each stage.
    Budget(BudgetArgs),
    /// Compare live poses, smoothed poses with 50, 100 and 200 ms of delay, and two passes.
    Delays(DelaysArgs),
    /// Render ticks of a scene for one camera, and print the durations.
    Render(RenderArgs),
    /// Write the maps of a scene or a venue, before any codec, to a file.
    Maps(MapsArgs),
    /// Measure the codec's compression levels on stored maps.
    Codec(CodecArgs),
    /// Render crops of people with their keypoints, to train the embedded pose network.
    TrainingCrops(CropsArgs),
    /// Render images with the boxes of their people, to train the embedded detector.
    TrainingFrames(FramesArgs),
    /// Write complete inputs for the fuzz targets of binary formats.
    FuzzSeeds(FuzzSeedsArgs),
    /// Unpack the corpus of the fuzz targets from its archive, or pack it.
    FuzzCorpus(CorpusArgs),
    /// Print figures of the project's own code with their goals.
    Figures(FiguresArgs),
    /// Write the sample venue of two walkers.
    WalkVenue(WalkVenueArgs),
}

/// The folder of scenes, recordings and networks: `$FARFIELD_DATA`, else ../shared.
fn recordings_folder() -> PathBuf {
    let set = std::env::var_os("FARFIELD_DATA");
    set.map_or_else(|| PathBuf::from("../shared"), PathBuf::from)
}

/// Runs the command of this process's command line.
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
        LabCommand::Agreement(args) => suite::agreement(&args),
        LabCommand::Bytes(args) => bytes::study(&args),
        LabCommand::Links(args) => links::links(&args),
        LabCommand::LivePixels(args) => live_pixels::live_pixels(&args),
        LabCommand::Real(args) => real::real(&args),
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
        LabCommand::FuzzSeeds(args) => fuzz::write_seeds(&args),
        LabCommand::FuzzCorpus(args) => fuzz::corpus(&args),
        LabCommand::Figures(args) => checkout::print_figures(&args),
        LabCommand::WalkVenue(args) => checkout::write_walk_venue(&args),
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
