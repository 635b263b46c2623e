//! Commands for a checkout: `lab figures` measures the code, `lab walk-venue` writes the sample venue.

use std::path::PathBuf;

use farfield_node::process::NodeError;
use farfield_sim::keypoint_venue::KeypointVenue;

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
pub(super) fn print_figures(args: &FiguresArgs) -> Result<(), NodeError> {
    let workspace = Workspace::read(&args.root);
    let workspace = workspace.map_err(|error| NodeError::Failed(error.into()))?;
    print!("{}", Figures(&workspace));
    Ok(())
}

/// Arguments of `lab walk-venue`.
#[derive(Debug, clap::Args)]
pub(super) struct WalkVenueArgs {
    /// The folder: `examples/walk` of a checkout.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

/// Writes the sample venue `examples/walk`.
///
/// # Errors
/// Names the file that cannot be written.
pub(super) fn write_walk_venue(args: &WalkVenueArgs) -> Result<(), NodeError> {
    let venue = KeypointVenue::two_walkers();
    venue
        .and_then(|venue| venue.write(&args.folder))
        .map_err(NodeError::Failed)
}
