//! What can be said on the laboratory's command line.
//!
//! Studies that run live start nodes as processes of this very program. So a first argument that is a
//! command of `farfield` is handed on to it, unseen in the help: `lab edge VENUE ...` is an edge, and the
//! scenarios test the operator's commands through the same program. Exit codes are those of `farfield`.

mod bytes;
mod links;
mod made_maps;
mod soak;
mod suite;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use farfield_fusion::node::{Ending, exit_code};

use self::bytes::BytesArgs;
use self::links::LinksArgs;
use self::soak::SoakArgs;
use self::suite::SuiteArgs;

/// How good Farfield is, and why: suites and studies over simulated venues and recordings.
///
/// Exit codes: 0 done, 1 ran but failed, 2 wrong input or usage.
#[derive(Debug, Parser)]
#[command(name = "lab", version)]
struct Lab {
    #[command(subcommand)]
    command: Command,
}

/// One thing to do.
#[derive(Debug, Subcommand)]
enum Command {
    /// Run fixed scenes in this process and score them, beside plain triangulation.
    Suite(SuiteArgs),
    /// What maps cost on the wire against what they are worth: every quality of our codec beside what
    /// others send, all through the same loop.
    Bytes(BytesArgs),
    /// How good a venue is over links that are far, thin and lossy: all nodes live, as processes.
    Links(LinksArgs),
    /// Whether anything grows in a venue that runs live for long.
    Soak(SoakArgs),
}

/// Does what the command line of this process says.
///
/// Ends the process itself, with exit code 2, on wrong usage.
pub fn main() -> ExitCode {
    let first = std::env::args_os().nth(1);
    if first.is_some_and(|first| first.to_str().is_some_and(farfield::knows)) {
        return farfield::main();
    }
    let done = match Lab::parse().command {
        Command::Suite(args) => suite::suite(&args),
        Command::Bytes(args) => bytes::study(&args),
        Command::Links(args) => links::links(&args),
        Command::Soak(args) => soak::soak(&args),
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
