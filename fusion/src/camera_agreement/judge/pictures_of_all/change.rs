//! What may have been done to pictures before keypoints were looked for in them, or to the keypoints when they were written.

use nalgebra::Vector2;

use super::super::super::geometry::SightLines;
use super::super::super::report::PictureOfAll;

/// Changes smaller than this are none: of scale, natural logarithm, and of place, shares of a picture.
const LEAST_SCALED: f64 = 0.05;
const LEAST_SHIFTED: f64 = 0.03;
/// Logarithms of the scales that are tried: from and to, and how far apart.
const SCALES: (f64, f64) = (-0.9, 1.7);
const SCALE_STEP: f64 = 0.06;
const WIDE_SCALE_STEP: f64 = 0.1;
/// Shifts that are tried: up to so large a share of a picture, and how far apart.
const FARTHEST_SHIFT: f64 = 0.42;
const SHIFT_STEP: f64 = 0.06;
/// How many times as tall pictures are as others in which keypoints are found: the usual ones of 2160, 1440, 1200, 1080, 720, 540 and 480
/// rows that are a third apart or more.
const SIZES: [f64; 9] = [
    2160.0 / 1440.0,
    2.0,
    3.0,
    4.0,
    2.25,
    1200.0 / 720.0,
    4.0 / 3.0,
    2.5,
    2160.0 / 1200.0,
];

/// What was done to pictures, or to what was written of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Deed {
    /// They were turned or reflected.
    Turned,
    /// Made smaller or larger, with bars around them or without.
    Scaled,
    /// Squeezed.
    Squeezed,
    /// Cut.
    Cut,
    /// Several of these.
    Mixed,
}

impl Deed {
    /// Those that are looked for at large.
    pub(super) const ALL: [Self; 4] = [Self::Turned, Self::Scaled, Self::Squeezed, Self::Cut];

    /// Along what it may be more or less: the logarithms of both scales, and both shifts.
    pub(super) fn axes(self) -> &'static [[f64; 4]] {
        match self {
            Self::Turned => &[],
            Self::Scaled => &[[1.0, 1.0, 0.0, 0.0]],
            Self::Squeezed => &[[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]],
            Self::Cut => &[[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]],
            Self::Mixed => &[
                [1.0, 1.0, 0.0, 0.0],
                [1.0, -1.0, 0.0, 0.0],
                [0.0, 0.0, 1.0, 0.0],
                [0.0, 0.0, 0.0, 1.0],
            ],
        }
    }
}

/// Where keypoints of a picture are meant to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Change {
    /// What was done.
    pub(super) deed: Deed,
    /// x and y exchanged, first.
    transposed: bool,
    /// Counted from the other side, then.
    flipped: [bool; 2],
    /// Scaled about the corner, then.
    pub(super) scale: [f64; 2],
    /// Shifted by such shares of the picture's sides, at last.
    pub(super) shift: [f64; 2],
}

impl Change {
    pub(super) const NONE: Self = Self {
        deed: Deed::Mixed,
        transposed: false,
        flipped: [false; 2],
        scale: [1.0; 2],
        shift: [0.0; 2],
    };

    /// Where a place of a picture of this size is meant, pixels.
    pub(super) fn of(&self, [x, y]: [f64; 2], size_px: &Vector2<f64>) -> [f32; 2] {
        let turned = if self.transposed { [y, x] } else { [x, y] };
        std::array::from_fn(|axis| {
            let side_px = size_px[axis];
            let at = if self.flipped[axis] {
                side_px - 1.0 - turned[axis]
            } else {
                turned[axis]
            };
            (self.scale[axis] * at + self.shift[axis] * side_px) as f32
        })
    }

    /// With so much more along an axis of its deed: about the corner, of a mixture about the middle of the picture.
    pub(super) fn with(&self, along: &[f64; 4], by: f64) -> Self {
        let mut changed = *self;
        for axis in 0..2 {
            let factor = libm::exp(by * along[axis]);
            changed.scale[axis] *= factor;
            if self.deed == Deed::Mixed {
                changed.shift[axis] = factor * (self.shift[axis] - 0.5) + 0.5;
            }
            changed.shift[axis] += by * along[2 + axis];
        }
        changed
    }

    /// What that is called; `None` where it is nothing, or a mixture that nobody makes, or other focal lengths of all.
    pub(super) fn name(&self) -> Option<PictureOfAll> {
        let scaled = self.scale.map(|scale| libm::log(scale).abs());
        let is_scaled = scaled.iter().any(|it| *it >= LEAST_SCALED);
        let is_shifted = self.shift.iter().any(|it| it.abs() >= LEAST_SHIFTED);
        let turned = match (self.transposed, self.flipped) {
            (false, [false, false]) => None,
            (false, [true, false]) => Some(PictureOfAll::Mirrored),
            (false, [false, true]) => Some(PictureOfAll::FromBelow),
            (false, [true, true]) => Some(PictureOfAll::HalfTurned),
            (true, [a, b]) if a == b => Some(PictureOfAll::XAndYExchanged),
            (true, _) => Some(PictureOfAll::QuarterTurned),
        };
        if turned.is_some() {
            return turned.filter(|_| !is_scaled && !is_shifted);
        }
        let [x, y] = self.scale;
        let is_centred = (0..2).all(|axis| {
            let centred = 0.5 * (1.0 - self.scale[axis]);
            (self.shift[axis] - centred).abs() < LEAST_SHIFTED
        });
        let is_zoom = is_centred && libm::log(x / y).abs() < LEAST_SCALED;
        let rounded = |value: f64, per: f64| (per * value).round() / per;
        (!is_zoom && (is_scaled || is_shifted)).then(|| PictureOfAll::Resized {
            scale: self.scale.map(|it| rounded(it, 100.0)),
            shift: self.shift.map(|it| rounded(it, 100.0)),
        })
    }
}

/// The changes that are tried first: what people do with pictures before they look for keypoints in them. `lines` are those of one
/// of the cameras.
pub(super) fn tried(lines: &SightLines) -> Vec<Change> {
    let mut all = turned();
    let steps = |(from, to): (f64, f64), step: f64| {
        let n = ((to - from) / step) as usize;
        (0..=n).map(move |i| from + step * i as f64)
    };
    // Smaller or larger; and so with bars above and below that make a square of it.
    let [width, height] = [lines.size_px().x, lines.size_px().y];
    let longer = width.max(height);
    let bars = [width, height].map(|side| -0.5 * (longer - side) / side);
    for scale in steps(SCALES, SCALE_STEP).map(libm::exp) {
        for shift in [[0.0; 2], bars] {
            all.push(Change {
                deed: Deed::Scaled,
                scale: [scale; 2],
                shift,
                ..Change::NONE
            });
        }
    }
    // Squeezed.
    for x in steps(SCALES, WIDE_SCALE_STEP).map(libm::exp) {
        for y in steps(SCALES, WIDE_SCALE_STEP).map(libm::exp) {
            all.push(Change {
                deed: Deed::Squeezed,
                scale: [x, y],
                ..Change::NONE
            });
        }
    }
    // Cut.
    let shifts = || steps((-FARTHEST_SHIFT, FARTHEST_SHIFT), SHIFT_STEP);
    for x in shifts() {
        for y in shifts() {
            all.push(Change {
                deed: Deed::Cut,
                shift: [x, y],
                ..Change::NONE
            });
        }
    }
    all
}

/// Turns by quarters, and reflections.
fn turned() -> Vec<Change> {
    let all = [
        (false, true, false),
        (false, false, true),
        (false, true, true),
        (true, false, false),
        (true, true, false),
        (true, false, true),
        (true, true, true),
    ];
    let turned = |(transposed, x, y)| Change {
        deed: Deed::Turned,
        transposed,
        flipped: [x, y],
        ..Change::NONE
    };
    all.map(turned).to_vec()
}

/// The changes of one camera's pictures that are tried: reflected, turned by a quarter, or of another size.
pub(super) fn tried_of_one() -> Vec<Change> {
    let turned = turned();
    let is_another = |change: &Change| change.name() != Some(PictureOfAll::HalfTurned);
    let scaled = SIZES.into_iter().flat_map(|size| [size, 1.0 / size]);
    let scaled = scaled.map(|scale| Change {
        deed: Deed::Scaled,
        scale: [scale; 2],
        ..Change::NONE
    });
    turned
        .into_iter()
        .filter(is_another)
        .chain(scaled)
        .collect()
}
