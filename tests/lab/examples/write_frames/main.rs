//! Writes rendered pictures with the boxes of the people in them, to train and measure the embedded detector on:
//! `cargo run --release -p farfield-lab --example write_frames -- OUT FRAMES SEED CLIP...`.
//!
//! CLIP is a BVH file. What the records of `OUT/frames_*.bin` hold is stated in [`record`].

#[path = "../write_crops/camera.rs"]
mod camera;
mod glance;
#[path = "../write_crops/people.rs"]
mod people;
#[path = "../write_crops/photo.rs"]
mod photo;
mod record;
#[path = "../write_crops/scenery.rs"]
mod scenery;

use std::path::PathBuf;

use anyhow::{Context as _, bail};
use farfield_sim::motion::Clip;
use rayon::prelude::*;

use record::Record;
use scenery::Scenery;

/// Width and height of a picture, pixels: a part of the detector's input, which is all convolutions.
const FRAME_PX: [u32; 2] = [320, 192];
/// Pictures of one file.
const SHARD: usize = 500;

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [out, frames, seed, clips @ ..] = arguments.as_slice() else {
        bail!("usage: write_frames OUT FRAMES SEED CLIP...");
    };
    let out = PathBuf::from(out);
    let frames: usize = frames.parse().context("FRAMES is not a number")?;
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
    for start in (0..frames).step_by(SHARD) {
        let numbers = start..frames.min(start + SHARD);
        let records: Vec<Vec<u8>> = numbers
            .into_par_iter()
            .map(|number| Record::make(&clips, &scenery, seed, number as u64).bytes())
            .collect();
        let path = out.join(format!("frames_{seed}_{:06}.bin", start / SHARD));
        let unfinished = path.with_extension("tmp");
        std::fs::write(&unfinished, records.concat())
            .and_then(|()| std::fs::rename(&unfinished, &path))
            .with_context(|| format!("writing `{}`", path.display()))?;
        println!("{}", path.display());
    }
    Ok(())
}
