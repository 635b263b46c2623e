//! `lab figures`: how large the project's own code is, who knows whom, and what is named twice.

use std::path::PathBuf;

use farfield_node::process::NodeError;

use crate::reading::figures::Figures;
use crate::reading::modules::families;
use crate::reading::{OUTSIDE, Workspace};

/// What `lab figures` is told.
#[derive(Debug, clap::Args)]
pub(super) struct FiguresArgs {
    /// The checkout to read.
    #[arg(value_name = "DIR", default_value = ".")]
    root: PathBuf,
    /// Tell each cycle with the file and line of its arrows, and nothing else.
    #[arg(long)]
    cycles: bool,
}

/// Prints the figures.
///
/// # Errors
/// Names the file that cannot be read.
pub(super) fn print(args: &FiguresArgs) -> Result<(), NodeError> {
    let workspace = Workspace::read(&args.root, &OUTSIDE);
    let workspace = workspace.map_err(|error| NodeError::Failed(error.into()))?;
    if args.cycles {
        for cycle in families::cycles(&workspace.crates, &workspace.arrows) {
            println!("{cycle}");
        }
    } else {
        print!("{}", Figures(&workspace));
    }
    Ok(())
}
