
use std::path::PathBuf;

use farfield_node::process::NodeError;
use farfield_sim::keypoint_venue::KeypointVenue;

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
pub(super) fn write(args: &WalkVenueArgs) -> Result<(), NodeError> {
    let venue = KeypointVenue::two_walkers();
    venue
        .and_then(|venue| venue.write(&args.folder))
        .map_err(NodeError::Failed)
}
