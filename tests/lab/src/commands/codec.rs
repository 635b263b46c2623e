//! `lab codec`: compression levels on stored maps, and the codec's priors.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, ensure};
use farfield::output;
use farfield_node::process::NodeError;
use farfield_proto::patch::{CompressionLevel, Decoder, EncodedMaps, Encoder, FLOOR, Maps};

/// Arguments of `lab codec`.
///
/// Columns: bytes per patch; root mean square and 99th percentile of the errors of cells that are above the floor on either
/// side, of 255; microseconds per patch to encode and to decode.
#[derive(Debug, clap::Args)]
pub(super) struct CodecArgs {
    /// Files of `lab maps`.
    #[arg(value_name = "MAPS", required = true)]
    files: Vec<PathBuf>,
    /// Print the codec's priors for its source code instead of a table.
    #[arg(long)]
    learn: bool,
}

/// Prints a table per file, or the priors of all.
///
/// # Errors
/// A file cannot be read or has no maps, or the result cannot be printed.
pub(super) fn measure(args: &CodecArgs) -> Result<(), NodeError> {
    let files = args.files.iter().map(|path| read(path));
    let files: Vec<Vec<Maps>> = files
        .collect::<anyhow::Result<_>>()
        .map_err(NodeError::Refused)?;
    if args.learn {
        return output::print(&priors(files)).map_err(NodeError::Failed);
    }
    for (path, maps) in args.files.iter().zip(files) {
        let text = table(&path.display().to_string(), maps).map_err(NodeError::Failed)?;
        output::print(&text).map_err(NodeError::Failed)?;
    }
    Ok(())
}

fn read(path: &Path) -> anyhow::Result<Vec<Maps>> {
    let bytes = std::fs::read(path).with_context(|| format!("reading {}", path.display()))?;
    let mut rest = &bytes[..];
    let mut all = Vec::new();
    while let [width, height, keypoints, cells @ ..] = rest {
        let mut maps = Maps::new((*width).into(), (*height).into(), (*keypoints).into());
        let area = maps.width() * maps.height();
        if cells.len() < area * maps.keypoints() {
            break;
        }
        for k in 0..maps.keypoints() {
            maps.cells_mut(k)
                .copy_from_slice(&cells[k * area..(k + 1) * area]);
        }
        rest = &cells[area * maps.keypoints()..];
        all.push(maps);
    }
    ensure!(!all.is_empty(), "{}: holds no maps", path.display());
    Ok(all)
}

/// Maps with more cells, as of a finer network: bilinear.
fn enlarged(maps: &Maps, width: usize, height: usize) -> Maps {
    let mut into = Maps::new(width, height, maps.keypoints());
    let (w, h) = (maps.width(), maps.height());
    for k in 0..maps.keypoints() {
        let from = maps.cells(k);
        for (i, cell) in into.cells_mut(k).iter_mut().enumerate() {
            let at = |place: usize, size: usize, new: usize| {
                let x = (place as f32 * size as f32 / new as f32).min((size - 1) as f32);
                (x as usize, (x as usize + 1).min(size - 1), x.fract())
            };
            let (x0, x1, fx) = at(i % width, w, width);
            let (y0, y1, fy) = at(i / width, h, height);
            let value_at = |x: usize, y: usize| f32::from(from[y * w + x]);
            let upper = value_at(x0, y0) + fx * (value_at(x1, y0) - value_at(x0, y0));
            let lower = value_at(x0, y1) + fx * (value_at(x1, y1) - value_at(x0, y1));
            *cell = (upper + fy * (lower - upper)).round() as u8;
        }
    }
    into
}

fn line(
    name: &str,
    all: &[Maps],
    encode: impl Fn(&mut Encoder, &Maps) -> EncodedMaps,
) -> anyhow::Result<String> {
    let mut encoder = Encoder::new();
    let began = now();
    let encoded: Vec<_> = all.iter().map(|maps| encode(&mut encoder, maps)).collect();
    let encode_us = began.elapsed().as_secs_f64() * 1e6 / all.len() as f64;
    let (mut decoder, mut into) = (Decoder::new(), Maps::default());
    let began = now();
    for encoded in &encoded {
        decoder.decode(encoded, &mut into)?;
    }
    let decode_us = began.elapsed().as_secs_f64() * 1e6 / all.len() as f64;
    let mut errors = [0u64; 256];
    for (maps, encoded) in all.iter().zip(&encoded) {
        decoder.decode(encoded, &mut into)?;
        for k in 0..maps.keypoints() {
            for (&a, &b) in maps.cells(k).iter().zip(into.cells(k)) {
                if a.max(b) >= FLOOR {
                    errors[usize::from(a.abs_diff(b))] += 1;
                }
            }
        }
    }
    let n: u64 = errors.iter().sum();
    let squares: f64 = (0..256).map(|e| errors[e] as f64 * (e * e) as f64).sum();
    let mut sum = 0;
    let p99 = errors.iter().position(|&count| {
        sum += count;
        sum * 100 >= n * 99
    });
    let bytes: usize = encoded.iter().map(|e| e.bytes.len()).sum();
    Ok(format!(
        "{name:>12} {:8.1} B {:7.2} rms {:4} p99 {encode_us:8.1} us {decode_us:8.1} us\n",
        bytes as f64 / all.len() as f64,
        (squares / n.max(1) as f64).sqrt(),
        p99.unwrap_or(0),
    ))
}

#[expect(
    clippy::disallowed_methods,
    reason = "a table of times needs a clock, outside every core"
)]
fn now() -> Instant {
    Instant::now()
}

/// One line per compression level, for few Gaussians instead of maps, and for maps with more cells.
fn table(name: &str, every: Vec<Maps>) -> anyhow::Result<String> {
    let step = every.len().div_ceil(300).max(1);
    let all: Vec<Maps> = every.into_iter().step_by(step).collect();
    let mut text = format!("{name}: {} patches\n", all.len());
    for level in CompressionLevel::all() {
        text += &line(&level.to_string(), &all, |encoder, maps| {
            encoder.encode(maps, level)
        })?;
    }
    for most in [1, 2] {
        let name = format!("{most} Gaussian");
        text += &line(&name, &all, |encoder, maps| {
            encoder.encode_gaussians(maps, CompressionLevel::DEFAULT, most)
        })?;
    }
    let fine: Vec<Maps> = all.iter().map(|maps| enlarged(maps, 72, 96)).collect();
    for level in [CompressionLevel::DEFAULT, CompressionLevel::SMALL] {
        text += &line(&format!("72x96 {level}"), &fine, |encoder, maps| {
            encoder.encode(maps, level)
        })?;
    }
    Ok(text)
}

/// The mean of an encoder's learnt state after every patch, without forgetting; patches of all files and lossy levels take
/// turns.
fn priors(files: Vec<Vec<Maps>>) -> String {
    const ROUNDS: usize = 150;
    const WARM: usize = 15;
    let all = files.into_iter().map(|every| {
        let step = every.len().div_ceil(ROUNDS).max(1);
        every.into_iter().step_by(step).collect()
    });
    let all: Vec<Vec<Maps>> = all.collect();
    let mut encoder = Encoder::new();
    let mut sums: Vec<f64> = Vec::new();
    for round in 0..ROUNDS {
        for maps in all
            .iter()
            .filter_map(|maps| maps.get(round % maps.len().max(1)))
        {
            for level in CompressionLevel::all().skip(2) {
                encoder.encode_on(maps, level);
            }
        }
        if round >= WARM {
            let learnt = encoder.learnt();
            sums.resize(learnt.len(), 0.0);
            for (sum, probability) in sums.iter_mut().zip(learnt) {
                *sum += f64::from(probability);
            }
        }
    }
    let even = f64::from(1u16 << 15) * (ROUNDS - WARM) as f64;
    let table = sums.iter().map(|&sum| {
        let share = (sum / even * 128.0).round().clamp(1.0, 255.0);
        // A probability that is still exactly even never occurred.
        if sum.to_bits() == even.to_bits() {
            "0".to_owned()
        } else {
            share.to_string()
        }
    });
    let rows = table.collect::<Vec<String>>();
    let rows = rows
        .chunks(20)
        .map(|row| format!("    {},\n", row.join(", ")));
    rows.collect()
}
