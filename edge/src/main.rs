//! The small edge binary, for computers that run nothing else.

use std::process::ExitCode;
use std::sync::Arc;

use clap::Parser;
use farfield_edge::network::answer_trial;
use farfield_edge::node::{self, EdgeArgs};
use farfield_edge::source::RecordedSources;

/// The edge node of one viewpoint: pixels in, patches out.
#[derive(Debug, Parser)]
#[command(name = "farfield-edge", version)]
struct EdgeCli {
    #[command(flatten)]
    edge: EdgeArgs,
}

fn main() -> ExitCode {
    if let Some(code) = answer_trial() {
        return code;
    }
    node::main(EdgeCli::parse().edge, Arc::new(RecordedSources))
}
