//! `farfield completions` and `farfield man`, generated from the command line definition.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::Command;
use clap_complete::Shell;
use clap_mangen::Man;
use farfield_fusion::export::unfinished::write_whole;
use farfield_node::process::NodeError;

use crate::exchange::target::check_folder;
use crate::output;

/// Arguments of `farfield completions`.
#[derive(Debug, clap::Args)]
pub(crate) struct CompletionsArgs {
    /// Which shell.
    #[arg(value_name = "SHELL")]
    shell: Shell,
}

/// Arguments of `farfield man`.
#[derive(Debug, clap::Args)]
pub(crate) struct ManArgs {
    /// Folder for the pages; existing pages are replaced.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Prints the completion script of `cli` for a shell.
///
/// # Errors
/// When it cannot be printed.
pub(crate) fn completions(args: &CompletionsArgs, mut cli: Command) -> Result<(), NodeError> {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut cli, "farfield", &mut text);
    output::print(&String::from_utf8_lossy(&text)).map_err(NodeError::Failed)
}

/// Writes the manual of `cli`: `farfield.1`, and `farfield-COMMAND.1` for every command and subcommand.
///
/// # Errors
/// When the folder cannot be created, or a page cannot be written.
pub(crate) fn man(args: &ManArgs, cli: Command) -> Result<(), NodeError> {
    let folder = &args.out;
    check_folder("--out", folder).map_err(NodeError::Refused)?;
    std::fs::create_dir_all(folder)
        .with_context(|| format!("making {}", folder.display()))
        .map_err(NodeError::Failed)?;
    let mut n_pages = 0;
    for (name, page) in pages(cli).map_err(NodeError::Failed)? {
        let path = folder.join(name);
        write_whole(path.clone(), &page)
            .with_context(|| format!("writing {}", path.display()))
            .map_err(NodeError::Failed)?;
        n_pages += 1;
    }
    let message = format!("{n_pages} manual pages in {}\n", folder.display());
    output::print(&message).map_err(NodeError::Failed)
}

/// Name and text of every page.
fn pages(cli: Command) -> anyhow::Result<Vec<(String, Vec<u8>)>> {
    let mut cli = cli.disable_help_subcommand(true);
    cli.build();
    let page = |command: Command, name: String| {
        let mut text = Vec::new();
        Man::new(command.disable_help_flag(true)).render(&mut text)?;
        anyhow::Ok((format!("{name}.1"), text))
    };
    let mut pages = Vec::new();
    let mut left = vec![(cli, "farfield".to_owned())];
    while let Some((command, name)) = left.pop() {
        // Every subcommand that a page names has a page of its own.
        for below in command.get_subcommands() {
            left.push((below.clone(), format!("{name}-{}", below.get_name())));
        }
        pages.push(page(command, name)?);
    }
    Ok(pages)
}

#[cfg(test)]
mod tests {
    use clap::{CommandFactory as _, ValueEnum as _};

    use super::*;
    use crate::cli::FarfieldCli;

    #[test]
    fn every_command_has_a_page() {
        let pages = pages(FarfieldCli::command()).unwrap();
        for name in [
            "farfield.1",
            "farfield-run.1",
            "farfield-man.1",
            "farfield-people-split.1",
            "farfield-calibrate-points.1",
        ] {
            let (_, page) = pages.iter().find(|(found, _)| found == name).unwrap();
            let page = String::from_utf8(page.clone()).unwrap();
            assert!(page.contains(".SH NAME"), "{page}");
        }
        let run = pages
            .iter()
            .find(|(name, _)| name == "farfield-run.1")
            .unwrap();
        let run = String::from_utf8(run.1.clone()).unwrap();
        assert!(run.contains("overlay"), "{run}");
    }

    #[test]
    fn every_shell_gets_completions_of_every_command() {
        for shell in Shell::value_variants() {
            let mut text = Vec::new();
            let mut cli = FarfieldCli::command();
            clap_complete::generate(*shell, &mut cli, "farfield", &mut text);
            let text = String::from_utf8(text).unwrap();
            assert!(
                text.contains("evaluate") && text.contains("overlay"),
                "{shell}"
            );
        }
    }
}
