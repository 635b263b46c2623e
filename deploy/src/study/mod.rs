//! `farfield study`: figures about the method, made anew.

mod bytes;
mod links;
mod made_maps;
mod soak;

use farfield_fusion::node::NodeError;

use self::bytes::BytesArgs;
use self::links::LinksArgs;
use self::soak::SoakArgs;

/// What is studied.
#[derive(Debug, clap::Subcommand)]
pub(crate) enum Study {
    /// What maps cost on the wire against what they are worth: every quality of our codec beside what
    /// others send, all through the same loop.
    Bytes(BytesArgs),
    /// How good a venue is over links that are far, thin and lossy: all nodes live, as processes.
    Links(LinksArgs),
    /// Whether anything grows in a venue that runs live for long.
    Soak(SoakArgs),
}

/// Makes the study and prints it.
///
/// # Errors
/// When a scene is missing or wrong, a run fails, or the result cannot be written.
pub(crate) fn study(study: &Study) -> Result<(), NodeError> {
    match study {
        Study::Bytes(args) => bytes::study(args),
        Study::Links(args) => links::links(args),
        Study::Soak(args) => soak::soak(args),
    }
}
