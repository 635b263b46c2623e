//! `lab faults`: runs the faults of a venue's first month, and prints a table of their effects.
//!
//! Every fault has a live venue of its own: nodes as processes, edges behind relays, recorded maps. Each measured value has
//! an upper limit. Some faults are simulated: clocks are wrong inside an edge only, disks are mounted, links are relays.
//! Scenarios cover cameras that hang, key files and mixed versions.

mod clocks;
mod disks;
mod links;
mod nodes;
mod stage;
mod strangers;
mod table;

use std::path::Path;

use anyhow::{Context as _, anyhow, bail};
use farfield::output;
use farfield_node::process::{NodeError, say};

use self::stage::Field;
use self::table::{FaultOutcome, FaultRow, FaultTable};

/// Arguments of `lab faults`.
#[derive(Debug, clap::Args)]
pub(crate) struct FaultsArgs {
    /// Faults to run; default: all.
    #[arg(value_name = "FAULT")]
    faults: Vec<String>,
    /// List the faults and exit.
    #[arg(long)]
    list: bool,
    /// Run only faults that take seconds, each for a shorter time.
    #[arg(long)]
    quick: bool,
    /// Fail if a value exceeds its limit, with `--quick` three times its limit.
    #[arg(long)]
    check: bool,
}

/// A fault of a venue.
struct Fault {
    name: &'static str,
    about: &'static str,
    /// Whether it takes seconds only.
    is_quick: bool,
    drive: fn(&Field) -> anyhow::Result<FaultOutcome>,
}

/// All faults, in the order of their runs.
const FAULTS: [Fault; 23] = [
    Fault {
        name: "lopsided-link",
        about: "a link with 30 ms one way and 10 ms the other, and a clock that NTP keeps right",
        is_quick: true,
        drive: clocks::asymmetric_link,
    },
    Fault {
        name: "clock-set",
        about: "one clock that begins 2 s wrong and is set right, and one that is set wrong by 2 s meanwhile",
        is_quick: false,
        drive: clocks::clock_set,
    },
    Fault {
        name: "fusion-killed",
        about: "fusion is killed and started again",
        is_quick: true,
        drive: nodes::fusion_killed,
    },
    Fault {
        name: "fusion-down",
        about: "fusion is killed and started again 4 s later",
        is_quick: true,
        drive: nodes::fusion_down,
    },
    Fault {
        name: "edge-killed",
        about: "an edge is killed and started again",
        is_quick: true,
        drive: nodes::edge_killed,
    },
    Fault {
        name: "cut-short",
        about: "a link is cut for 0.7 s",
        is_quick: true,
        drive: links::cut_short,
    },
    Fault {
        name: "cut-long",
        about: "a link is cut for 3 s",
        is_quick: false,
        drive: links::cut_long,
    },
    Fault {
        name: "outages-300",
        about: "eight runners; all links are cut for 0.3 s every 4, 5.9 and 7 s",
        is_quick: false,
        drive: links::of_300_ms,
    },
    Fault {
        name: "outages-500",
        about: "the same for 0.5 s",
        is_quick: false,
        drive: links::of_500_ms,
    },
    Fault {
        name: "outages-700",
        about: "the same for 0.7 s",
        is_quick: false,
        drive: links::of_700_ms,
    },
    Fault {
        name: "outages-1000",
        about: "the same for 1 s",
        is_quick: false,
        drive: links::of_1000_ms,
    },
    Fault {
        name: "fusion-restart",
        about: "eight runners; fusion is killed and started again 2 s later",
        is_quick: false,
        drive: links::fusion_restarted,
    },
    Fault {
        name: "fusion-stopped",
        about: "eight runners; fusion is stopped for 3 s",
        is_quick: false,
        drive: links::fusion_stopped,
    },
    Fault {
        name: "loss",
        about: "a fifth of the datagrams of all links is lost at random",
        is_quick: true,
        drive: links::loss,
    },
    Fault {
        name: "bottleneck",
        about: "four edges and eight people behind one link of 1 Mbit/s",
        is_quick: false,
        drive: links::bottleneck,
    },
    Fault {
        name: "flood",
        about: "a stranger floods fusion with noise in the name of an edge, while all is recorded",
        is_quick: true,
        drive: nodes::flood,
    },
    Fault {
        name: "garbage-quic",
        about: "garbage at a quic/ endpoint while a node joins",
        is_quick: true,
        drive: strangers::garbage_quic,
    },
    Fault {
        name: "garbage-tls",
        about: "garbage and silent connections at a tls/ endpoint while a node joins",
        is_quick: false,
        drive: strangers::garbage_tls,
    },
    Fault {
        name: "few-handles",
        about: "1,100 silent connections at a tls/ endpoint of a fusion that may open 1,024 handles",
        is_quick: true,
        drive: strangers::few_handles,
    },
    Fault {
        name: "two-fusions",
        about: "two fusions that are started at the same moment, and the first dies",
        is_quick: false,
        drive: nodes::two_fusions,
    },
    Fault {
        name: "disk-full",
        about: "the disk of the results is full for a while",
        is_quick: true,
        drive: disks::full,
    },
    Fault {
        name: "disk-hangs",
        about: "the disk of the results and the recording hangs for 22 s",
        is_quick: false,
        drive: disks::hangs,
    },
    Fault {
        name: "disk-errors",
        about: "the disk refuses to write two files of the results, and to sync a third",
        is_quick: true,
        drive: disks::errors,
    },
];

/// Runs the faults and prints the table.
///
/// # Errors
/// An unknown name, a run that failed, and with `--check` a limit that was exceeded.
pub(crate) fn faults(args: &FaultsArgs) -> Result<(), NodeError> {
    if args.list {
        let lines = FAULTS.iter().map(|it| {
            let quick = if it.is_quick { "quick" } else { "" };
            format!("{:14} {quick:6} {}\n", it.name, it.about)
        });
        return output::print(&lines.collect::<String>()).map_err(NodeError::Failed);
    }
    let chosen = choose(args).map_err(NodeError::Refused)?;
    let scratch = tempfile::tempdir().map_err(NodeError::failed)?;
    let table = drive(args, &chosen, scratch.path()).map_err(NodeError::Failed)?;
    output::print(&table.to_string()).map_err(NodeError::Failed)?;
    let broken = if args.check {
        table.broken()
    } else {
        table.failed()
    };
    if broken.is_empty() {
        Ok(())
    } else {
        Err(NodeError::Failed(anyhow!("{}", broken.join("; "))))
    }
}

fn choose(args: &FaultsArgs) -> anyhow::Result<Vec<&'static Fault>> {
    let known = |name: &String| FAULTS.iter().any(|fault| fault.name == name);
    if let Some(unknown) = args.faults.iter().find(|name| !known(name)) {
        let names: Vec<&str> = FAULTS.iter().map(|fault| fault.name).collect();
        bail!(
            "unknown fault {unknown}; expected one of {}",
            names.join(", ")
        );
    }
    let is_chosen = |fault: &&Fault| match &args.faults[..] {
        [] => fault.is_quick || !args.quick,
        names => names.iter().any(|name| name == fault.name),
    };
    Ok(FAULTS.iter().filter(is_chosen).collect())
}

fn drive(
    args: &FaultsArgs,
    chosen: &[&'static Fault],
    folder: &Path,
) -> anyhow::Result<FaultTable> {
    let field = Field::make(folder, args.quick).context("making the maps")?;
    let mut table = FaultTable::new(args.quick);
    for fault in chosen {
        say(format_args!("{}: {}", fault.name, fault.about));
        let outcome = (fault.drive)(&field);
        let row = FaultRow {
            fault: fault.name,
            outcome: outcome.unwrap_or_else(|error| FaultOutcome::Failed(format!("{error:#}"))),
        };
        say(format_args!("{row}"));
        table.rows.push(row);
    }
    Ok(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args(names: &[&str], quick: bool) -> FaultsArgs {
        FaultsArgs {
            faults: names.iter().map(|&name| name.to_owned()).collect(),
            list: false,
            quick,
            check: true,
        }
    }

    fn names(args: &FaultsArgs) -> Vec<&'static str> {
        choose(args)
            .unwrap()
            .iter()
            .map(|fault| fault.name)
            .collect()
    }

    #[test]
    fn without_names_all_or_all_quick_faults_run() {
        assert_eq!(names(&args(&[], false)).len(), FAULTS.len());
        let quick = names(&args(&[], true));
        assert!(
            quick.contains(&"loss") && !quick.contains(&"bottleneck"),
            "{quick:?}"
        );
    }

    #[test]
    fn named_faults_run_and_unknown_names_are_refused() {
        assert_eq!(
            names(&args(&["bottleneck", "loss"], true)),
            ["loss", "bottleneck"]
        );
        let refused = choose(&args(&["flod"], false)).err().unwrap().to_string();
        assert!(
            refused.contains("flod") && refused.contains("flood"),
            "{refused}"
        );
    }
}
