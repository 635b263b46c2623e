//! Commands for a checkout: `lab figures` measures the code, `lab walk-venue` writes the sample venue.

use std::path::PathBuf;

use farfield_node::process::NodeError;

use crate::reading::Workspace;
use crate::reading::figures::Figures;

/// Arguments of `lab figures`.
#[derive(Debug, clap::Args)]
pub(super) struct FiguresArgs {
    /// The checkout to read.
    #[arg(value_name = "DIR", default_value = ".")]
    root: PathBuf,
}

/// Prints the figures.
///
/// # Errors
/// Names the file that cannot be read.
pub(super) fn print(args: &FiguresArgs) -> Result<(), NodeError> {
    let workspace = Workspace::read(&args.root);
    let workspace = workspace.map_err(|error| NodeError::Failed(error.into()))?;
    print!("{}", Figures(&workspace));
    Ok(())
}
