//! `lab training-crops`: rendered crops of people with their keypoints, to train and measure the embedded pose network.
//! [`CropRecord`] describes the records.

mod moment;
mod record;
mod viewing;

use farfield_node::process::NodeError;

use self::record::CropRecord;
use super::shards::{SetArgs, TrainingSet};

/// Width and height of the network's input, pixels.
const INPUT_PX: [usize; 2] = [160, 224];

/// Arguments of `lab training-crops`.
#[derive(Debug, clap::Args)]
pub(in crate::commands) struct CropsArgs {
    #[command(flatten)]
    set: SetArgs,
}

/// Writes the crops.
///
/// # Errors
/// A clip is missing or wrong, or a file cannot be written.
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
