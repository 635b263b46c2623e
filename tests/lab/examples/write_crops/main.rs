//! Writes rendered crops of people, with their keypoints, to train and measure the embedded network on:
//! `cargo run --release -p farfield-lab --example write_crops -- OUT CROPS SEED CLIP...`.
//!
//! CLIP is a BVH file. What the records of `OUT/crops_*.bin` hold is stated in [`record`].

mod camera;
mod moment;
mod people;
mod photo;
mod record;
mod scenery;
mod viewing;

use std::path::PathBuf;

use anyhow::{Context as _, bail};
use farfield_sim::motion::Clip;
use rayon::prelude::*;

use record::Record;
use scenery::Scenery;

/// Width and height of the network's input, pixels.
const INPUT_PX: [usize; 2] = [160, 224];
/// Crops of one file.
const SHARD: usize = 1000;

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [out, crops, seed, clips @ ..] = arguments.as_slice() else {
        bail!("usage: write_crops OUT CROPS SEED CLIP...");
    };
    let out = PathBuf::from(out);
    let crops: usize = crops.parse().context("CROPS is not a number")?;
    let seed: u64 = seed.parse().context("SEED is not a number")?;
    let clips = clips
        .iter()
        .map(|path| Clip::load(path.as_ref()))
        .collect::<Result<Vec<_>, _>>()?;
    if clips.is_empty() {
        bail!("no clips were named");
    }
    std::fs::create_dir_all(&out).with_context(|| format!("making `{}`", out.display()))?;
    let scenery = Scenery::new(seed);
    for start in (0..crops).step_by(SHARD) {
        let numbers = start..crops.min(start + SHARD);
        let records: Vec<Vec<u8>> = numbers
            .into_par_iter()
            .map(|number| Record::make(&clips, &scenery, seed, number as u64).bytes())
            .collect();
        let path = out.join(format!("crops_{seed}_{:06}.bin", start / SHARD));
        let unfinished = path.with_extension("tmp");
        std::fs::write(&unfinished, records.concat())
            .and_then(|()| std::fs::rename(&unfinished, &path))
            .with_context(|| format!("writing `{}`", path.display()))?;
        println!("{}", path.display());
    }
    Ok(())
}
