//! `lab training-frames`: rendered pictures with the boxes of the people in them, to train and measure the
//! embedded detector on. What the records hold is stated in [`record`].

mod glance;
mod record;

use farfield_node::process::NodeError;

use self::record::FrameRecord;
use super::shards::{SetArgs, TrainingSet};

/// Width and height of a picture, pixels: a part of the detector's input, which is all convolutions.
const FRAME_PX: [u32; 2] = [320, 192];

/// What `lab training-frames` is told.
#[derive(Debug, clap::Args)]
pub(in crate::commands) struct FramesArgs {
    #[command(flatten)]
    set: SetArgs,
}

/// Writes the pictures.
///
/// # Errors
/// When a clip is missing or wrong, or a file cannot be written.
pub(in crate::commands) fn write(args: &FramesArgs) -> Result<(), NodeError> {
    let set = TrainingSet {
        name: "frames",
        shard: 500,
        record: |clips, scenery, seed, number| {
            FrameRecord::make(clips, scenery, seed, number).bytes()
        },
    };
    set.write(&args.set)
}
