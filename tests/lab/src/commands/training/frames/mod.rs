//! `lab training-frames`: rendered images with the boxes of their people, to train and measure the embedded detector.
//! [`FrameRecord`] describes the records.

mod glance;
mod record;

use farfield_node::process::NodeError;

use self::record::FrameRecord;
use super::shards::{SetArgs, TrainingSet};

/// Width and height of an image, pixels: a part of the detector's input, which works since the network is convolutional.
const FRAME_PX: [u32; 2] = [320, 192];

/// Arguments of `lab training-frames`.
#[derive(Debug, clap::Args)]
pub(in crate::commands) struct FramesArgs {
    #[command(flatten)]
    set: SetArgs,
}

/// Writes the images.
///
/// # Errors
/// A clip is missing or wrong, or a file cannot be written.
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
