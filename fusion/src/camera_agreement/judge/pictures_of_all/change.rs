//! Changes of pictures before keypoints were found in them, or of keypoints when they were written.

use nalgebra::Vector2;

use super::super::super::geometry::SightLines;
use super::super::super::report::PictureOfAll;

/// Smallest changes that count: of scale, natural logarithm, and of place, shares of a picture.
const MIN_LOG_SCALE: f64 = 0.05;
const MIN_SHIFT: f64 = 0.03;
/// Range of the logarithms of candidate scales, and the steps between them.
const LOG_SCALES: (f64, f64) = (-0.9, 1.7);
const SCALE_STEP: f64 = 0.06;
const WIDE_SCALE_STEP: f64 = 0.1;
/// Largest candidate shift and the step between shifts, shares of a picture.
const MAX_SHIFT: f64 = 0.42;
const SHIFT_STEP: f64 = 0.06;
/// Ratios of common picture heights (2160, 1440, 1200, 1080, 720, 540 and 480 rows) that differ by a third or more.
const SIZE_RATIOS: [f64; 9] = [
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

/// What was done to pictures or keypoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Transform {
    /// Turned by quarters, or reflected.
    Turned,
    /// Scaled, with or without bars around the picture.
    Scaled,
    /// Scaled differently in x and y.
    Squeezed,
    /// Cropped.
    Cut,
}

impl Transform {
    /// The transforms of the search over all cameras.
    pub(super) const ALL: [Self; 4] = [Self::Turned, Self::Scaled, Self::Squeezed, Self::Cut];

    /// Directions in which it is refined: logarithms of both scales, and both shifts.
    pub(super) fn axes(self) -> &'static [[f64; 4]] {
        match self {
            Self::Turned => &[],
            Self::Scaled => &[[1.0, 1.0, 0.0, 0.0]],
            Self::Squeezed => &[[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]],
            Self::Cut => &[[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]],
        }
    }
}

/// Maps written keypoints of a picture to their true places, in this order of steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Change {
    pub(super) transform: Transform,
    /// Exchanges x and y.
    transposed: bool,
    /// Counts x or y from the other side.
    flipped: [bool; 2],
    /// Scales about the top left corner.
    pub(super) scale: [f64; 2],
    /// Shifts by shares of the picture's sides.
    pub(super) shift: [f64; 2],
}

impl Change {
    pub(super) const NONE: Self = Self {
        transform: Transform::Turned,
        transposed: false,
        flipped: [false; 2],
        scale: [1.0; 2],
        shift: [0.0; 2],
    };

    /// Whether it makes a mirror image of the picture.
    pub(super) fn is_reflection(&self) -> bool {
        self.flipped[0] ^ self.flipped[1] ^ self.transposed
    }

    /// The true place of a written one, pixels.
    pub(super) fn apply(&self, [x, y]: [f64; 2], size_px: &Vector2<f64>) -> [f32; 2] {
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

    /// A step along an axis of its transform, about the top left corner.
    pub(super) fn stepped(&self, along: &[f64; 4], by: f64) -> Self {
        let mut changed = *self;
        for axis in 0..2 {
            let factor = libm::exp(by * along[axis]);
            changed.scale[axis] *= factor;
            changed.shift[axis] += by * along[2 + axis];
        }
        changed
    }

    /// The change to report; `None` if it is too small, an unusual mixture, or the same as other focal lengths.
    pub(super) fn name(&self) -> Option<PictureOfAll> {
        let scaled = self.scale.map(|scale| libm::log(scale).abs());
        let is_scaled = scaled.iter().any(|it| *it >= MIN_LOG_SCALE);
        let is_shifted = self.shift.iter().any(|it| it.abs() >= MIN_SHIFT);
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
            (self.shift[axis] - centred).abs() < MIN_SHIFT
        });
        let is_zoom = is_centred && libm::log(x / y).abs() < MIN_LOG_SCALE;
        let rounded = |value: f64, per: f64| (per * value).round() / per;
        (!is_zoom && (is_scaled || is_shifted)).then(|| PictureOfAll::Resized {
            scale: self.scale.map(|it| rounded(it, 100.0)),
            shift: self.shift.map(|it| rounded(it, 100.0)),
        })
    }
}

/// Candidates of the coarse search: usual changes of pictures before keypoints are found in them. `lines` are those of
/// one camera.
pub(super) fn candidates(lines: &SightLines) -> Vec<Change> {
    let mut all = turned();
    let steps = |(from, to): (f64, f64), step: f64| {
        let n = ((to - from) / step) as usize;
        (0..=n).map(move |i| from + step * i as f64)
    };
    // Scaled, also with bars that make the picture square.
    let [width, height] = [lines.size_px().x, lines.size_px().y];
    let longer = width.max(height);
    let bars = [width, height].map(|side| -0.5 * (longer - side) / side);
    for scale in steps(LOG_SCALES, SCALE_STEP).map(libm::exp) {
        for shift in [[0.0; 2], bars] {
            all.push(Change {
                transform: Transform::Scaled,
                scale: [scale; 2],
                shift,
                ..Change::NONE
            });
        }
    }
    // Scaled differently in x and y.
    for x in steps(LOG_SCALES, WIDE_SCALE_STEP).map(libm::exp) {
        for y in steps(LOG_SCALES, WIDE_SCALE_STEP).map(libm::exp) {
            all.push(Change {
                transform: Transform::Squeezed,
                scale: [x, y],
                ..Change::NONE
            });
        }
    }
    // Cropped.
    let shifts = || steps((-MAX_SHIFT, MAX_SHIFT), SHIFT_STEP);
    for x in shifts() {
        for y in shifts() {
            all.push(Change {
                transform: Transform::Cut,
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
        transform: Transform::Turned,
        transposed,
        flipped: [x, y],
        ..Change::NONE
    };
    all.map(turned).to_vec()
}

/// Candidates for the pictures of one camera: reflected, turned by a quarter, or of another size.
pub(super) fn candidates_of_one() -> Vec<Change> {
    let turned = turned();
    let is_another = |change: &Change| change.name() != Some(PictureOfAll::HalfTurned);
    let scaled = SIZE_RATIOS.into_iter().flat_map(|size| [size, 1.0 / size]);
    let scaled = scaled.map(|scale| Change {
        transform: Transform::Scaled,
        scale: [scale; 2],
        ..Change::NONE
    });
    turned
        .into_iter()
        .filter(is_another)
        .chain(scaled)
        .collect()
}
