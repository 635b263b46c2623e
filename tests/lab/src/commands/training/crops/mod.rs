//! `lab training-crops`: rendered crops of people, with their keypoints, to train and measure the embedded
//! pose network on. What the records hold is stated in [`record`].

mod moment;
mod record;
mod viewing;

use farfield_node::process::NodeError;

use self::record::CropRecord;
use super::shards::{SetArgs, TrainingSet};

/// Width and height of the network's input, pixels.
const INPUT_PX: [usize; 2] = [160, 224];

/// What `lab training-crops` is told.
#[derive(Debug, clap::Args)]
pub(in crate::commands) struct CropsArgs {
    #[command(flatten)]
    set: SetArgs,
}

/// Writes the crops.
///
/// # Errors
/// When a clip is missing or wrong, or a file cannot be written.
pub(in crate::commands) fn write(args: &CropsArgs) -> Result<(), NodeError> {
    let set = TrainingSet {
        name: "crops",
        shard: 1000,
        record: |clips, scenery, seed, number| {
            CropRecord::make(clips, scenery, seed, number).bytes()
        },
    };
    set.write(&args.set)
}
