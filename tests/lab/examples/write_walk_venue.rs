//! Writes the sample venue `examples/walk` anew: `cargo run -p farfield-lab --example write_walk_venue -- examples/walk`.

use std::path::PathBuf;

use anyhow::Context as _;
use farfield_sim::keypoint_venue::KeypointVenue;

fn main() -> anyhow::Result<()> {
    let dir = std::env::args_os()
        .nth(1)
        .map(PathBuf::from)
        .context("usage: write_walk_venue DIR")?;
    KeypointVenue::two_walkers()?.write(&dir)
}
