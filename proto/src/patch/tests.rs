//! Requirements on the codec as a whole: both directions, at every compression level.

use proptest::prelude::*;

use super::*;

/// Draws a Gaussian of `height` around (x, y), sigma in cells; each cell keeps its maximum.
fn draw(cells: &mut [u8], width: usize, peak: [f32; 2], sigma: f32, height: f32) {
    for (i, cell) in cells.iter_mut().enumerate() {
        let (dx, dy) = ((i % width) as f32 - peak[0], (i / width) as f32 - peak[1]);
        let value = height * (-(dx * dx + dy * dy) / (2.0 * sigma * sigma)).exp();
        *cell = quantize(value).max(*cell);
    }
}

/// Positions of 17 keypoints of an upright person on a map of 48 x 64 cells.
const BODY: [[f32; 2]; 17] = [
    [24.2, 9.1],
    [25.4, 8.0],
    [22.9, 8.1],
    [27.1, 8.9],
    [21.2, 9.2],
    [30.3, 16.4],
    [17.6, 16.7],
    [33.9, 24.2],
    [13.8, 24.9],
    [34.7, 31.6],
    [12.4, 31.1],
    [28.1, 32.8],
    [20.2, 32.5],
    [28.9, 43.7],
    [19.1, 43.9],
    [29.3, 55.2],
    [18.4, 54.6],
];

fn body(sigma: f32, second_peak: f32) -> Maps {
    let mut maps = Maps::new(48, 64, BODY.len());
    for (k, peak) in BODY.into_iter().enumerate() {
        let height = 0.55 + 0.025 * k as f32;
        draw(maps.cells_mut(k), 48, peak, sigma, height);
        draw(
            maps.cells_mut(k),
            48,
            BODY[(k + 5) % BODY.len()],
            sigma,
            height * second_peak,
        );
    }
    maps
}

fn above(maps: &Maps, floor: u8) -> Maps {
    let mut kept = maps.clone();
    for k in 0..kept.keypoints() {
        kept.cells_mut(k)
            .iter_mut()
            .filter(|c| **c < floor)
            .for_each(|c| *c = 0);
    }
    kept
}

fn check(maps: &Maps, floor: u8) -> usize {
    let encoded = Encoder::new().encode_above(maps, floor);
    let mut decoded = Maps::default();
    Decoder::new().decode(&encoded, &mut decoded).unwrap();
    assert_eq!(decoded, above(maps, floor));
    encoded.bytes.len()
}

#[test]
fn a_person_costs_some_hundreds_of_bytes() {
    let cells: usize = (0..17)
        .map(|k| {
            above(&body(2.0, 0.0), FLOOR)
                .cells(k)
                .iter()
                .filter(|c| **c > 0)
                .count()
        })
        .sum();
    let bytes = check(&body(2.0, 0.0), FLOOR);
    let with_second = check(&body(2.0, 0.4), FLOOR);
    let finer = check(&body(3.0, 0.0), FLOOR);
    println!(
        "17 maps of 48 x 64, {cells} cells above the floor: {bytes} bytes; with second peaks {with_second}; sigma 3: {finer}"
    );
    assert!(bytes < 500, "{bytes}");
    assert!(with_second < 900, "{with_second}");
}

#[test]
fn empty_maps_cost_next_to_nothing() {
    assert!(check(&Maps::new(256, 256, 64), FLOOR) <= 6);
}

fn decoded(maps: &Maps, level: CompressionLevel) -> (Maps, usize) {
    let encoded = Encoder::new().encode(maps, level);
    let mut decoded = Maps::default();
    Decoder::new().decode(&encoded, &mut decoded).unwrap();
    (decoded, encoded.bytes.len())
}

/// The largest error of a cell.
fn off(a: &Maps, b: &Maps) -> u8 {
    let cells = a.cells.iter().zip(&b.cells);
    cells.map(|(a, b)| a.abs_diff(*b)).max().unwrap()
}

#[test]
fn every_level_takes_fewer_bytes_than_the_one_before() {
    let maps = body(2.1, 0.5);
    let bytes: Vec<usize> = CompressionLevel::all()
        .map(|q| decoded(&maps, q).1)
        .collect();
    assert!(bytes.is_sorted_by(|a, b| a >= b), "{bytes:?}");
    assert!(bytes[0] > 10 * bytes[bytes.len() - 1], "{bytes:?}");
}

#[test]
fn two_peaks_stay_two_at_every_level() {
    let maps = body(2.0, 0.8);
    for level in CompressionLevel::all() {
        let (decoded, bytes) = decoded(&maps, level);
        assert!(off(&maps, &decoded) < 50, "{level}");
        assert!(
            level == CompressionLevel::LOSSLESS || bytes < 180,
            "{level}: {bytes}"
        );
    }
}

#[test]
fn the_default_level_stays_within_its_tolerance() {
    for (sigma, second) in [(1.7, 0.0), (2.0, 0.5), (2.6, 0.9), (3.5, 0.3)] {
        let maps = body(sigma, second);
        let (decoded, bytes) = decoded(&maps, CompressionLevel::DEFAULT);
        // The tolerance of its first step, and the floor below which nothing is visible.
        assert!(off(&maps, &decoded) <= 18, "{sigma} {second}");
        assert!(bytes <= 290);
    }
}

#[test]
fn finer_maps_of_the_same_people_take_the_same_bytes() {
    let mut fine = Maps::new(72, 96, BODY.len());
    for (k, [x, y]) in BODY.into_iter().enumerate() {
        draw(
            fine.cells_mut(k),
            72,
            [1.5 * x, 1.5 * y],
            3.0,
            0.55 + 0.025 * k as f32,
        );
    }
    for level in [
        CompressionLevel::DEFAULT,
        CompressionLevel::SMALL,
        CompressionLevel::SMALLEST,
    ] {
        let (of_fine, of_coarse) = (decoded(&fine, level).1, decoded(&body(2.0, 0.0), level).1);
        assert!(
            of_fine.abs_diff(of_coarse) <= of_coarse / 10,
            "{level}: {of_fine} {of_coarse}"
        );
    }
}

#[test]
fn an_encoder_keeps_no_state_between_patches() {
    let mut encoder = Encoder::new();
    let first = encoder.encode(&body(2.0, 0.3), CompressionLevel::LOSSLESS);
    encoder.encode(&body(3.0, 0.0), CompressionLevel::SMALL);
    assert_eq!(
        encoder.encode(&body(2.0, 0.3), CompressionLevel::LOSSLESS),
        first
    );
}

#[test]
fn impossible_sizes_are_refused_before_anything_is_allocated() {
    for (width, height, keypoints) in [
        (0, 8, 1),
        (8, 0, 1),
        (8, 8, 0),
        (257, 8, 1),
        (8, 257, 1),
        (8, 8, 65),
    ] {
        let encoded = EncodedMaps {
            width,
            height,
            keypoints,
            bytes: vec![0; 40],
        };
        let mut maps = Maps::default();
        let refused = Decoder::new().decode(&encoded, &mut maps);
        assert!(matches!(refused, Err(PatchError::Size { .. })));
        assert_eq!(maps.cells.capacity(), 0);
    }
}

#[test]
fn a_cut_or_lengthened_patch_is_refused() {
    let whole = Encoder::new().encode(&body(2.0, 0.0), CompressionLevel::LOSSLESS);
    let mut maps = Maps::default();
    let mut cut = whole.clone();
    cut.bytes.truncate(whole.bytes.len() / 2);
    assert!(matches!(
        Decoder::new().decode(&cut, &mut maps),
        Err(PatchError::TooShort { .. })
    ));
    let mut long = whole;
    long.bytes.push(7);
    assert_eq!(
        Decoder::new().decode(&long, &mut maps),
        Err(PatchError::TooLong { left: 1 })
    );
}

#[test]
fn a_probability_is_rounded_to_a_cell() {
    assert_eq!(
        [0.0, 1.0, 2.0, -1.0, f32::NAN, 0.5].map(quantize),
        [0, 255, 255, 0, 0, 128]
    );
}

fn any_maps() -> impl Strategy<Value = Maps> {
    (1usize..40, 1usize..40, 1usize..5, 0u8..=255).prop_flat_map(
        |(width, height, keypoints, sparse)| {
            let cell = (any::<u8>(), any::<u8>())
                .prop_map(move |(c, keep)| if keep < sparse { 0 } else { c });
            prop::collection::vec(cell, width * height * keypoints).prop_map(move |cells| {
                let mut maps = Maps::new(width, height, keypoints);
                maps.cells.copy_from_slice(&cells);
                maps
            })
        },
    )
}

/// Checks that all cells outside the written region are zero.
fn check_written(maps: &Maps) {
    for k in 0..maps.keypoints() {
        let Written { rows, columns } = maps.written(k);
        for (i, &cell) in maps.cells(k).iter().enumerate() {
            let inside = rows.contains(&(i / maps.width)) && columns.contains(&(i % maps.width));
            assert!(inside || cell == 0, "map {k}: cell {i} is {cell}");
        }
    }
}

/// Decodes arbitrary bytes: it must end, within the stated memory.
fn check_hostile(encoded: &EncodedMaps) {
    let mut maps = Maps::default();
    let result = Decoder::new().decode(encoded, &mut maps);
    assert!(maps.cells.capacity() <= MAX_CELLS);
    check_written(&maps);
    if result.is_ok() {
        let [width, height] = [encoded.width, encoded.height].map(usize::from);
        assert_eq!(
            maps.cells.len(),
            width * height * usize::from(encoded.keypoints)
        );
    }
}

proptest! {
    #[test]
    fn cells_above_the_floor_are_read_back(maps in any_maps(), floor in any::<u8>()) {
        check(&maps, floor);
    }

    #[test]
    fn any_maps_can_be_sent_at_any_level(maps in any_maps(), level in 0u8..8) {
        let level = CompressionLevel::new(level);
        let (decoded, bytes) = decoded(&maps, level);
        assert_eq!((decoded.width, decoded.height), (maps.width, maps.height));
        check_written(&decoded);
        // The last level bounds the size for any content.
        assert!(level < CompressionLevel::SMALLEST || bytes <= 95);
    }

    #[test]
    fn decoded_maps_contain_nothing_of_earlier_patches(
        sigmas in (1.0f32..5.0, 1.0f32..5.0), second_peaks in (0.0f32..0.9, 0.0f32..0.9), levels in (0u8..8, 0u8..8),
        damage in (any::<prop::sample::Index>(), any::<u8>()),
    ) {
        let maps = (body(sigmas.0, second_peaks.0), body(sigmas.1, second_peaks.1));
        let encoded = |maps: &Maps, level| Encoder::new().encode(maps, CompressionLevel::new(level));
        let (mut first, second) = (encoded(&maps.0, levels.0), encoded(&maps.1, levels.1));
        if !first.bytes.is_empty() {
            let at = damage.0.index(first.bytes.len());
            first.bytes[at] ^= damage.1;
        }
        let (mut decoder, mut used, mut fresh) = (Decoder::new(), Maps::default(), Maps::default());
        let _whether_readable = decoder.decode(&first, &mut used);
        decoder.decode(&second, &mut used).unwrap();
        Decoder::new().decode(&second, &mut fresh).unwrap();
        prop_assert_eq!(&used, &fresh);
        check_written(&used);
        used.resize(second.width.into(), second.height.into(), second.keypoints.into());
        prop_assert!(used.cells.iter().all(|&cell| cell == 0));
    }

    #[test]
    fn random_bytes_never_panic(
        width in 0u16..300, height in 0u16..300, keypoints in 0u8..70,
        bytes in prop::collection::vec(any::<u8>(), 0..600),
    ) {
        check_hostile(&EncodedMaps { width, height, keypoints, bytes });
    }

    #[test]
    fn damaged_bytes_never_panic(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        length in any::<prop::sample::Index>(),
        level in 0u8..7,
        sides in prop::option::of((1u16..=256, 1u16..=256)),
    ) {
        let mut encoded = Encoder::new().encode(&body(2.0, 0.4), CompressionLevel::new(level));
        let len = encoded.bytes.len();
        for (at, byte) in changes {
            encoded.bytes[at.index(len)] = byte;
        }
        encoded.bytes.truncate(1 + length.index(2 * len));
        if let Some((width, height)) = sides {
            (encoded.width, encoded.height) = (width, height);
        }
        check_hostile(&encoded);
    }
}
