//! What each quality makes of maps that were written down, and what the codec should know beforehand.
//!
//! ```text
//! cargo run --release -p farfield-proto --example patch_table -- MAPS...        a table
//! cargo run --release -p farfield-proto --example patch_table -- --learn MAPS...  the priors
//! ```
//!
//! MAPS are files of `farfield-lab`'s example `write_maps`. The table's columns: bytes a patch; root
//! mean square and 99th percentile of the errors of cells that are above the floor on either side, of
//! 255; microseconds a patch to encode and to decode.
#![expect(clippy::disallowed_methods, reason = "a table of times needs a clock")]

use std::time::Instant;

use farfield_proto::patch::{Decoder, EncodedMaps, Encoder, FLOOR, Maps, Quality};

fn read(path: &str) -> std::io::Result<Vec<Maps>> {
    let bytes = std::fs::read(path)?;
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
    Ok(all)
}

/// Maps of more cells, as a finer network's would be: bilinear.
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
            let of = |x: usize, y: usize| f32::from(from[y * w + x]);
            let upper = of(x0, y0) + fx * (of(x1, y0) - of(x0, y0));
            let lower = of(x0, y1) + fx * (of(x1, y1) - of(x0, y1));
            *cell = (upper + fy * (lower - upper)).round() as u8;
        }
    }
    into
}

fn line(name: &str, all: &[Maps], encode: impl Fn(&mut Encoder, &Maps) -> EncodedMaps) {
    let mut encoder = Encoder::new();
    let began = Instant::now();
    let encoded: Vec<_> = all.iter().map(|maps| encode(&mut encoder, maps)).collect();
    let encode_us = began.elapsed().as_secs_f64() * 1e6 / all.len() as f64;
    let (mut decoder, mut into) = (Decoder::new(), Maps::default());
    let began = Instant::now();
    for encoded in &encoded {
        if let Err(error) = decoder.decode(encoded, &mut into) {
            println!("{error}");
        }
    }
    let decode_us = began.elapsed().as_secs_f64() * 1e6 / all.len() as f64;
    let mut errors = [0u64; 256];
    for (maps, encoded) in all.iter().zip(&encoded) {
        if decoder.decode(encoded, &mut into).is_ok() {
            for k in 0..maps.keypoints() {
                for (&a, &b) in maps.cells(k).iter().zip(into.cells(k)) {
                    if a.max(b) >= FLOOR {
                        errors[usize::from(a.abs_diff(b))] += 1;
                    }
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
    println!(
        "{name:>12} {:8.1} B {:7.2} rms {:4} p99 {encode_us:8.1} us {decode_us:8.1} us",
        bytes as f64 / all.len() as f64,
        (squares / n.max(1) as f64).sqrt(),
        p99.unwrap_or(0),
    );
}

/// Prints the mean of what an encoder has learnt after every patch, when it forgets nothing; patches of
/// all files and lossy qualities take turns.
fn print_priors(files: &[String]) -> std::io::Result<()> {
    const ROUNDS: usize = 150;
    const WARM: usize = 15;
    let all = files.iter().map(|file| {
        let every = read(file)?;
        let step = every.len().div_ceil(ROUNDS).max(1);
        Ok(every.into_iter().step_by(step).collect())
    });
    let all: Vec<Vec<Maps>> = all.collect::<std::io::Result<_>>()?;
    let mut encoder = Encoder::new();
    let mut sums: Vec<f64> = Vec::new();
    for round in 0..ROUNDS {
        for maps in all
            .iter()
            .filter_map(|maps| maps.get(round % maps.len().max(1)))
        {
            for quality in Quality::all().skip(2) {
                encoder.encode_on(maps, quality);
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
        // Nothing that occurs stays even to the last bit.
        if sum.to_bits() == even.to_bits() {
            "0".to_owned()
        } else {
            share.to_string()
        }
    });
    for row in table.collect::<Vec<String>>().chunks(20) {
        println!("    {},", row.join(", "));
    }
    Ok(())
}

fn main() -> std::io::Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let learn = args.first().is_some_and(|first| first == "--learn");
    let files = &args[usize::from(learn)..];
    if learn {
        return print_priors(files);
    }
    for file in files {
        let every: Vec<Maps> = read(file)?;
        let step = every.len().div_ceil(300).max(1);
        let all: Vec<Maps> = every.into_iter().step_by(step).collect();
        println!("{file}: {} patches", all.len());
        for quality in Quality::all() {
            line(&quality.to_string(), &all, |encoder, maps| {
                encoder.encode(maps, quality)
            });
        }
        for most in [1, 2] {
            let name = format!("{most} Gaussian");
            line(&name, &all, |encoder, maps| {
                encoder.encode_gaussians(maps, Quality::DEFAULT, most)
            });
        }
        let fine: Vec<Maps> = all.iter().map(|maps| enlarged(maps, 72, 96)).collect();
        for quality in [Quality::DEFAULT, Quality::SMALL] {
            line(&format!("72x96 {quality}"), &fine, |encoder, maps| {
                encoder.encode(maps, quality)
            });
        }
    }
    Ok(())
}
