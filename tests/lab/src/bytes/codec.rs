//! The codecs of the comparison: ours, and replacements, each packed as well as possible.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use farfield_edge::pipeline::StandIn;
use farfield_proto::patch::{CompressionLevel, Decoder, EncodedMaps, Encoder, FLOOR, Maps};

/// Level of zstd: the slowest for everyday use.
const ZSTD_LEVEL: i32 = 19;
/// Numbers of a Gaussian with covariance, and of a keypoint: position, height; three of a covariance.
const GAUSSIAN_NUMBERS: usize = 6;
const KEYPOINT_NUMBERS: usize = 3;
/// Bits of a keypoint in fixed point: ten per coordinate, eight for the score.
const KEYPOINT_BITS: usize = 28;
/// Sigma that a receiver of plain keypoints assumes, in 48ths of the map's width.
const KEYPOINT_SIGMA: f32 = 2.0;

/// A way to encode maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Codec {
    /// All cells of every map, with 8 bits, as fusion uses them.
    Whole,
    /// 8 bit cells above the floor, by zstd.
    Zstd,
    /// Ours.
    Ours(CompressionLevel),
    /// At most so many Gaussians with covariance per map, quantised like the modes of that compression level.
    Gaussians(usize, CompressionLevel),
    /// The highest peak of each map, without its shape.
    Keypoints,
}

impl Codec {
    /// All codecs of the comparison.
    pub fn all() -> Vec<Self> {
        let gaussians = [1, 2].into_iter().flat_map(|most| {
            [CompressionLevel::DEFAULT, CompressionLevel::SMALL]
                .map(|level| Self::Gaussians(most, level))
        });
        let mut all = vec![Self::Whole, Self::Zstd];
        all.extend(CompressionLevel::all().map(Self::Ours));
        all.extend(gaussians);
        all.push(Self::Keypoints);
        all
    }

    /// Names of its packings: the same maps packed in different ways.
    pub fn packings(self) -> Vec<String> {
        match self {
            Self::Whole => vec!["f32".to_owned()],
            Self::Zstd => vec![format!("u8 + zstd -{ZSTD_LEVEL}")],
            Self::Ours(level) => vec![format!("ours {} ({level})", level.number())],
            Self::Gaussians(most, level) => vec![
                format!("{most} Gauss, f32 ({level})"),
                format!("{most} Gauss, coded ({level})"),
            ],
            Self::Keypoints => ["f32", "28 bit", "coded"]
                .map(|packing| format!("keypoints, {packing}"))
                .into(),
        }
    }

    /// The compression level of our codec, which needs no stand-in; `None` for the others.
    pub fn level(self) -> Option<CompressionLevel> {
        match self {
            Self::Ours(level) => Some(level),
            _ => None,
        }
    }
}

impl fmt::Display for Codec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.packings().last().map_or("", String::as_str))
    }
}

/// Bytes sent in a run, for each packing of a codec, and patches.
#[derive(Debug, Clone, Default)]
pub struct SentBytes {
    /// In the order of [`Codec::packings`].
    pub bytes: Vec<u64>,
    /// Persons, views and ticks.
    pub patches: u64,
}

/// Another codec in the place of ours.
pub struct Rival {
    codec: Codec,
    encoder: Encoder,
    decoder: Decoder,
    sent: Arc<Mutex<SentBytes>>,
}

impl Rival {
    /// `codec`, which counts into `sent`.
    pub fn new(codec: Codec, sent: Arc<Mutex<SentBytes>>) -> Self {
        Self {
            codec,
            encoder: Encoder::new(),
            decoder: Decoder::new(),
            sent,
        }
    }

    /// Replaces `maps` by the decoded ones. Decoding our own bytes does not fail.
    fn decoded(&mut self, encoded: &EncodedMaps, maps: &mut Maps) {
        if let Err(error) = self.decoder.decode(encoded, maps) {
            debug_assert!(false, "{error}");
        }
    }

    fn gaussians(&mut self, maps: &mut Maps, most: usize, level: CompressionLevel) -> Vec<u64> {
        let encoded = self.encoder.encode_gaussians(maps, level, most);
        self.decoded(&encoded, maps);
        let raw = 4 * GAUSSIAN_NUMBERS * most * maps.keypoints();
        vec![raw as u64, encoded.bytes.len() as u64]
    }

    fn keypoints(&mut self, maps: &mut Maps) -> Vec<u64> {
        let peaks = self.encoder.peaks(maps);
        let coded = self
            .encoder
            .encode_gaussians(maps, CompressionLevel::SMALLEST, 1);
        let sigma = KEYPOINT_SIGMA * maps.width() as f32 / 48.0;
        let width = maps.width();
        for (k, peak) in peaks.into_iter().enumerate() {
            let cells = maps.cells_mut(k);
            cells.fill(0);
            let Some(([x, y], height)) = peak else {
                continue;
            };
            for (i, cell) in cells.iter_mut().enumerate() {
                let (dx, dy) = ((i % width) as f32 - x, (i / width) as f32 - y);
                let value = height * (-(dx * dx + dy * dy) / (2.0 * sigma * sigma)).exp();
                *cell = value.round() as u8;
            }
        }
        let n = maps.keypoints();
        let packed = (KEYPOINT_BITS * n).div_ceil(8);
        vec![
            (4 * KEYPOINT_NUMBERS * n) as u64,
            packed as u64,
            coded.bytes.len() as u64,
        ]
    }
}

impl StandIn for Rival {
    fn recode(&mut self, maps: &mut Maps) {
        let bytes = match self.codec {
            Codec::Whole => {
                let cells = maps.width() * maps.height() * maps.keypoints();
                vec![4 * cells as u64]
            }
            Codec::Zstd => vec![zstd(maps)],
            Codec::Ours(level) => {
                let encoded = self.encoder.encode(maps, level);
                self.decoded(&encoded, maps);
                vec![encoded.bytes.len() as u64]
            }
            Codec::Gaussians(most, level) => self.gaussians(maps, most, level),
            Codec::Keypoints => self.keypoints(maps),
        };
        let mut sent = self.sent.lock().unwrap_or_else(PoisonError::into_inner);
        sent.patches += 1;
        sent.bytes.resize(bytes.len(), 0);
        for (sum, bytes) in sent.bytes.iter_mut().zip(bytes) {
            *sum += bytes;
        }
    }
}

/// Clears the cells below the floor; returns the compressed size of the others.
fn zstd(maps: &mut Maps) -> u64 {
    let mut all = Vec::new();
    for k in 0..maps.keypoints() {
        let cells = maps.cells_mut(k);
        cells
            .iter_mut()
            .filter(|c| **c < FLOOR)
            .for_each(|c| *c = 0);
        all.extend_from_slice(cells);
    }
    // Compression in memory does not fail.
    zstd::bulk::compress(&all, ZSTD_LEVEL).map_or(0, |bytes| bytes.len() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two_peaks() -> Maps {
        let mut maps = Maps::new(48, 64, 17);
        for k in 0..17 {
            for (i, cell) in maps.cells_mut(k).iter_mut().enumerate() {
                let near = |x: f64, y: f64, height: f64| {
                    let (dx, dy) = ((i % 48) as f64 - x, (i / 48) as f64 - y);
                    height * (-(dx * dx + dy * dy) / 8.0).exp()
                };
                let both = near(12.3, 20.0, 240.0).max(near(34.6, 41.2, 200.0));
                *cell = both.round() as u8;
            }
        }
        maps
    }

    fn recoded(codec: Codec) -> (Maps, SentBytes) {
        let sent = Arc::new(Mutex::new(SentBytes::default()));
        let mut maps = two_peaks();
        Rival::new(codec, Arc::clone(&sent)).recode(&mut maps);
        let sent = sent.lock().unwrap().clone();
        (maps, sent)
    }

    #[test]
    fn every_packing_has_its_bytes() {
        for codec in Codec::all() {
            let (_, sent) = recoded(codec);
            assert_eq!(sent.bytes.len(), codec.packings().len(), "{codec}");
            assert!(sent.bytes.iter().all(|&bytes| bytes > 10), "{codec}");
        }
    }

    #[test]
    fn codecs_with_one_peak_lose_the_second() {
        let second = 41 * 48 + 35;
        let height = |codec| recoded(codec).0.cells(3)[second];
        assert!(height(Codec::Ours(CompressionLevel::SMALL)) > 180);
        assert!(height(Codec::Gaussians(2, CompressionLevel::SMALL)) > 180);
        assert!(height(Codec::Gaussians(1, CompressionLevel::SMALL)) < 10);
        assert!(height(Codec::Keypoints) < 10);
    }
}
