//! Time per person and tick, stage by stage, at 4 and 12 viewpoints, and per patch for the codec.
//!
//! `cargo bench -p farfield-lab`
#![expect(clippy::unwrap_used, reason = "a bench without its ring is no bench")]

use std::hint::black_box;
use std::path::PathBuf;
use std::sync::OnceLock;

use anyhow::Context as _;
use divan::Bencher;
use farfield_fusion::align::TickGroup;
use farfield_fusion::estimate::estimator::Estimator;
use farfield_fusion::method::Method;
use farfield_lab::in_process::InProcess;
use farfield_lab::ring::CameraRing;
use farfield_proto::id::CameraIndex;
use farfield_proto::message::PatchSet;
use farfield_proto::patch::{CompressionLevel, Decoder, Encoder, Maps};
use farfield_proto::tick::Tick;

const VIEWPOINTS: [usize; 2] = [4, 12];
/// Ticks of the walk that the benches repeat.
const TICKS: i64 = 60;
/// Lossless, and the levels of a live link from its default on.
const LEVELS: [u8; 4] = [
    CompressionLevel::LOSSLESS.number(),
    CompressionLevel::DEFAULT.number(),
    CompressionLevel::SMALL.number(),
    CompressionLevel::SMALLEST.number(),
];

fn main() {
    let (kind, maps) = maps();
    let mut encoder = Encoder::new();
    for level in LEVELS {
        let compression = CompressionLevel::new(level);
        let sizes = maps
            .iter()
            .map(|maps| encoder.encode(maps, compression).bytes.len());
        println!(
            "{} {kind} patches of 17 maps at compression level {level}: {} bytes on average",
            maps.len(),
            sizes.sum::<usize>() / maps.len().max(1)
        );
    }
    divan::main();
}

/// A track after a warm-up, and the groups of the ticks to come.
struct WalkBench {
    ring: CameraRing,
    method: Method,
    track: Estimator,
    groups: Vec<TickGroup>,
    at: usize,
}

impl WalkBench {
    fn new(n_viewpoints: usize) -> Self {
        let ring = CameraRing::new(n_viewpoints).unwrap();
        let method = CameraRing::method();
        let track = ring.track(&method).unwrap();
        // There and back again, so that the walk repeats without a jump.
        let there = (0..TICKS).chain((1..TICKS - 1).rev());
        let groups = there.map(|tick| ring.group(Tick(tick)).unwrap()).collect();
        let mut walk = Self {
            ring,
            method,
            track,
            groups,
            at: 0,
        };
        for _ in 0..TICKS {
            walk.tick();
        }
        walk
    }

    fn see(&mut self) {
        let group = &self.groups[self.at % self.groups.len()];
        self.at += 1;
        self.track.begin(&self.method);
        for (set, camera) in group.patch_sets.iter().zip(self.ring.cameras()) {
            assert!(
                self.track
                    .see(&set.persons[0], set.viewpoint, camera, &self.method)
            );
        }
        self.track.place_views(&[], 0, &self.method);
    }

    fn tick(&mut self) {
        self.see();
        self.track.search(&self.method);
        self.track.fit_keypoints(&self.method);
        self.track.learn_sites(&self.method);
        self.track.smooth(&self.method);
        self.track.fit_joints(&self.method);
    }

    fn boxes(&mut self) {
        let ahead = self.track.ahead(1.0, &self.method);
        for (index, camera) in self.ring.cameras().iter().enumerate() {
            let own = std::iter::once((CameraIndex(index as u16), camera));
            black_box(self.track.boxes(own, &ahead));
        }
    }
}

#[divan::bench(args = VIEWPOINTS)]
fn one_person_whole_tick(bencher: Bencher<'_, '_>, n_viewpoints: usize) {
    let mut walk = WalkBench::new(n_viewpoints);
    bencher.bench_local(|| {
        walk.tick();
        walk.boxes();
    });
}

#[divan::bench(args = VIEWPOINTS)]
fn stage_0_decode_and_place(bencher: Bencher<'_, '_>, n_viewpoints: usize) {
    let mut walk = WalkBench::new(n_viewpoints);
    bencher.bench_local(|| walk.see());
}

#[divan::bench(args = VIEWPOINTS)]
fn stage_1_lattice(bencher: Bencher<'_, '_>, n_viewpoints: usize) {
    let mut walk = WalkBench::new(n_viewpoints);
    bencher.bench_local(|| walk.track.search(&walk.method));
}

#[divan::bench(args = VIEWPOINTS)]
fn stage_2_ik_1(bencher: Bencher<'_, '_>, n_viewpoints: usize) {
    let mut walk = WalkBench::new(n_viewpoints);
    bencher.bench_local(|| walk.track.fit_keypoints(&walk.method));
}

#[divan::bench(args = VIEWPOINTS)]
fn stage_3_filter(bencher: Bencher<'_, '_>, n_viewpoints: usize) {
    let mut walk = WalkBench::new(n_viewpoints);
    bencher.bench_local(|| walk.track.smooth(&walk.method));
}

#[divan::bench(args = VIEWPOINTS)]
fn stage_4_ik_2(bencher: Bencher<'_, '_>, n_viewpoints: usize) {
    let mut walk = WalkBench::new(n_viewpoints);
    bencher.bench_local(|| walk.track.fit_joints(&walk.method));
}

#[divan::bench(args = VIEWPOINTS)]
fn stage_5_boxes(bencher: Bencher<'_, '_>, n_viewpoints: usize) {
    let mut walk = WalkBench::new(n_viewpoints);
    bencher.bench_local(|| walk.boxes());
}

/// Maps of the treadmill recording by its real network, if both are installed, else drawn maps.
fn maps() -> &'static (&'static str, Vec<Maps>) {
    static MAPS: OnceLock<(&str, Vec<Maps>)> = OnceLock::new();
    MAPS.get_or_init(|| match real_maps() {
        Ok(maps) => ("real", maps),
        Err(error) => {
            println!("SKIPPED real maps ({error:#}): the patch benches use drawn ones");
            (
                "drawn",
                decoded(
                    &CameraRing::new(4)
                        .unwrap()
                        .group(Tick(0))
                        .unwrap()
                        .patch_sets,
                ),
            )
        }
    })
}

fn real_maps() -> anyhow::Result<Vec<Maps>> {
    let default_root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared");
    let root = std::env::var_os("FARFIELD_DATA").map_or_else(|| default_root.into(), PathBuf::from);
    let mut run = InProcess::open(&root.join("data/pose2sim/single/venue.toml"))?;
    let mut maps = Vec::new();
    for _ in 0..6 {
        let trace = run
            .step()?
            .context("the recording is shorter than six ticks")?;
        maps.extend(
            trace
                .edges
                .iter()
                .flat_map(|edge| decoded(&edge.patch_sets)),
        );
    }
    Ok(maps)
}

fn decoded(sets: &[PatchSet]) -> Vec<Maps> {
    let mut decoder = Decoder::new();
    let patches = sets.iter().flat_map(|set| &set.persons);
    let decoded = patches.map(|patch| {
        let mut maps = Maps::new(1, 1, 1);
        decoder.decode(&patch.maps, &mut maps).unwrap();
        maps
    });
    decoded.collect()
}

/// Maps with 1.5 times as many cells along each side, as of a finer network.
fn finer(maps: &Maps) -> Maps {
    let (width, height) = (maps.width() * 3 / 2, maps.height() * 3 / 2);
    let mut into = Maps::new(width, height, maps.keypoints());
    for k in 0..maps.keypoints() {
        for (i, cell) in into.cells_mut(k).iter_mut().enumerate() {
            // Bilinear interpolation.
            let at = |place: usize, size: usize| {
                let x = place as f64 / 1.5;
                let first = (x as usize).min(size - 1);
                (first, (first + 1).min(size - 1), x - first as f64)
            };
            let (x0, x1, fx) = at(i % width, maps.width());
            let (y0, y1, fy) = at(i / width, maps.height());
            let of = |x: usize, y: usize| f64::from(maps.cells(k)[y * maps.width() + x]);
            let upper = of(x0, y0) + fx * (of(x1, y0) - of(x0, y0));
            let lower = of(x0, y1) + fx * (of(x1, y1) - of(x0, y1));
            *cell = (upper + fy * (lower - upper)).round() as u8;
        }
    }
    into
}

/// Encodes and decodes all patches in turn, so that the mean covers their variety; `FINE` maps have 72 x 96 cells instead
/// of 48 x 64.
#[divan::bench(args = LEVELS, consts = [false, true])]
fn patch_encode_and_decode<const FINE: bool>(bencher: Bencher<'_, '_>, level: u8) {
    let (_, maps) = maps();
    let maps: Vec<Maps> = if FINE {
        maps.iter().map(finer).collect()
    } else {
        maps.clone()
    };
    let (mut encoder, mut decoder) = (Encoder::new(), Decoder::new());
    let (mut into, mut next) = (Maps::new(1, 1, 1), 0);
    bencher.bench_local(|| {
        next += 1;
        let encoded = encoder.encode(
            black_box(&maps[next % maps.len()]),
            CompressionLevel::new(level),
        );
        decoder.decode(&encoded, &mut into)
    });
}

#[divan::bench(args = LEVELS)]
fn patch_encode(bencher: Bencher<'_, '_>, level: u8) {
    let (_, maps) = maps();
    let (mut encoder, mut bytes, mut next) = (Encoder::new(), Vec::new(), 0);
    bencher.bench_local(|| {
        next += 1;
        let maps = black_box(&maps[next % maps.len()]);
        encoder.encode_into(maps, CompressionLevel::new(level), &mut bytes);
    });
}

#[divan::bench(args = LEVELS)]
fn patch_decode(bencher: Bencher<'_, '_>, level: u8) {
    let (_, maps) = maps();
    let mut encoder = Encoder::new();
    let compression = CompressionLevel::new(level);
    let encoded: Vec<_> = maps
        .iter()
        .map(|maps| encoder.encode(maps, compression))
        .collect();
    let (mut decoder, mut into, mut next) = (Decoder::new(), Maps::new(1, 1, 1), 0);
    bencher.bench_local(|| {
        next += 1;
        decoder.decode(black_box(&encoded[next % encoded.len()]), &mut into)
    });
}
