//! Rendered people to train and measure the embedded networks: crops for the pose network, images for the detector. A
//! training set is a number of files of records.

mod camera;
pub(super) mod crops;
pub(super) mod frames;
mod people;
mod photo;

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use farfield::output;
use farfield_node::process::NodeError;
use farfield_sim::motion::Clip;
use rayon::prelude::*;

use self::people::Scenery;

/// Common arguments of training sets.
#[derive(Debug, clap::Args)]
pub(super) struct SetArgs {
    /// The folder to write to.
    out: PathBuf,
    /// Number of records.
    records: usize,
    /// Seed: a record does not depend on the number of records.
    seed: u64,
    /// BVH files with the postures of people.
    #[arg(value_name = "CLIP", required = true)]
    clips: Vec<PathBuf>,
}

/// A set of records of one kind.
pub(super) struct TrainingSet {
    /// First part of the file names.
    pub(super) name: &'static str,
    /// Records of one file.
    pub(super) shard: usize,
    /// The bytes of a record, from the seed and its number.
    pub(super) record: fn(&[Clip], &Scenery, u64, u64) -> Vec<u8>,
}

impl TrainingSet {
    /// Draws all records and writes them by file.
    ///
    /// # Errors
    /// A clip is missing or wrong, or a file cannot be written.
    pub(super) fn write(&self, args: &SetArgs) -> Result<(), NodeError> {
        let clips = args.clips.iter().map(|path| Clip::load(path));
        let clips = clips
            .collect::<Result<Vec<_>, _>>()
            .map_err(NodeError::refused)?;
        let write = || {
            std::fs::create_dir_all(&args.out)
                .with_context(|| format!("making {}", args.out.display()))?;
            let scenery = Scenery::new(args.seed);
            (0..args.records)
                .step_by(self.shard)
                .try_for_each(|first| self.write_shard(args, &clips, &scenery, first))
        };
        write().map_err(NodeError::Failed)
    }

    fn write_shard(
        &self,
        args: &SetArgs,
        clips: &[Clip],
        scenery: &Scenery,
        first: usize,
    ) -> anyhow::Result<()> {
        let numbers = first..args.records.min(first + self.shard);
        let records: Vec<Vec<u8>> = numbers
            .into_par_iter()
            .map(|number| (self.record)(clips, scenery, args.seed, number as u64))
            .collect();
        let (name, seed, shard) = (self.name, args.seed, first / self.shard);
        let path = args.out.join(format!("{name}_{seed}_{shard:06}.bin"));
        write_whole(&path, &records.concat())
            .with_context(|| format!("writing {}", path.display()))?;
        output::print(&format!("{}\n", path.display()))
    }
}

/// Writes a file under a temporary name, and renames it when it is complete.
fn write_whole(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let unfinished = path.with_extension("tmp");
    std::fs::write(&unfinished, bytes)?;
    std::fs::rename(&unfinished, path)
}
