//! The lossless coder: one traversal of a map, shared by encoder and decoder, with a prediction at
//! every step.
//!
//! For every map it codes whether it is empty, and its first row relative to that of the previous
//! map (keypoints of one body are close together). Then, row by row, it codes the start and end
//! relative to the previous row, and the cells between. The prediction of a cell assumes that the
//! peak is a product of a column and a row, as every upright Gaussian is. The coder writes the
//! difference, in contexts of the errors of the neighbours' predictions.

mod around;

use std::cmp::Ordering;

use self::around::{Around, Left};
use super::entropy::range_coder::{BitCoder, Probability};
use super::maps::{MAX_SIDE, Written};

/// Sides of a map: known in both directions.
#[derive(Debug, Clone, Copy)]
pub(in crate::patch) struct Shape {
    pub(in crate::patch) width: usize,
    pub(in crate::patch) height: usize,
    /// Smallest nonzero cell, at least 1.
    pub(in crate::patch) floor: u8,
}

/// Codes maps; reuses its memory from patch to patch.
#[derive(Debug, Clone)]
pub(in crate::patch) struct LosslessCoder {
    learnt: Learnt,
    /// Whether the previous map was empty, and the position of its first row and that row's first
    /// cell.
    last_empty: bool,
    last_first: [usize; 2],
    /// Prediction errors by column: of the row above up to here, and of this row so far.
    errors: [u8; MAX_SIDE],
    around: Around,
}

/// The adaptive state within a patch.
#[derive(Debug, Clone)]
struct Learnt {
    empty_map: [Probability; 2],
    empty_row: [Probability; 2],
    first_row: Signed,
    rows: Unsigned,
    first_start: Signed,
    first_width: Unsigned,
    start: [Signed; 3],
    end: [Signed; 3],
    zero: [Probability; 8],
    /// By kind of prediction, then by class of error.
    cell: [Signed; KINDS * ERROR_CLASSES],
}

/// Kinds of predictions.
const KINDS: usize = 5;
/// Classes of prediction errors.
const ERROR_CLASSES: usize = 4;

/// Start and end of a row: first and last nonzero cell.
#[derive(Debug, Clone, Copy)]
struct RowSpan {
    start: usize,
    end: usize,
}

impl Learnt {
    const fn nothing() -> Self {
        let even = Probability::even();
        Self {
            empty_map: [even; 2],
            empty_row: [even; 2],
            first_row: Signed::new(),
            rows: Unsigned::new(),
            first_start: Signed::new(),
            first_width: Unsigned::new(),
            start: [Signed::new(); 3],
            end: [Signed::new(); 3],
            zero: [even; 8],
            cell: [Signed::new(); KINDS * ERROR_CLASSES],
        }
    }
}

impl LosslessCoder {
    /// Without learnt contexts.
    pub(in crate::patch) fn new() -> Self {
        Self {
            learnt: Learnt::nothing(),
            last_empty: false,
            last_first: [0; 2],
            errors: [0; MAX_SIDE],
            around: Around::new(),
        }
    }

    /// Resets all state, before the first map of a patch.
    pub(in crate::patch) fn reset(&mut self, width: usize, height: usize) {
        self.learnt = Learnt::nothing();
        self.last_empty = false;
        self.last_first = [height / 2, width / 2];
    }

    /// Codes one map: reads `cells`, or writes them over zeros. Returns the written ones, if any.
    pub(in crate::patch) fn map<C: BitCoder>(
        &mut self,
        coder: &mut C,
        shape: Shape,
        cells: &mut [u8],
    ) -> Written {
        let Shape { width, height, .. } = shape;
        let mut written = Written::default();
        let is_empty = |cells: &[u8]| cells.iter().fold(0, |any, &c| any | c) == 0;
        let empty_rows =
            |row: usize, cells: &[u8]| is_empty(&cells[row * width..(row + 1) * width]);
        let empty = coder.code(
            C::WRITES && is_empty(cells),
            &mut self.learnt.empty_map[usize::from(self.last_empty)],
        );
        self.last_empty = empty;
        if empty {
            return written;
        }
        let (mut first, mut last) = (0, 0);
        if C::WRITES {
            first = (0..height).find(|&y| !empty_rows(y, cells)).unwrap_or(0);
            last = (0..height)
                .rfind(|&y| !empty_rows(y, cells))
                .unwrap_or(first);
        }
        let Learnt {
            first_row, rows, ..
        } = &mut self.learnt;
        first = first_row.near(coder, first, self.last_first[0], height - 1);
        last = first + rows.code(coder, last.saturating_sub(first), height - 1 - first);
        self.errors.fill(0);
        self.around.begin();
        let mut above: Option<(RowSpan, Ordering)> = None;
        let mut row_above_empty = false;
        for y in first..=last {
            let inner = y != first && y != last;
            let row_empty = inner
                && coder.code(
                    C::WRITES && empty_rows(y, cells),
                    &mut self.learnt.empty_row[usize::from(row_above_empty)],
                );
            row_above_empty = row_empty;
            if row_empty {
                self.errors.fill(0);
                self.around.skip(y);
                continue;
            }
            let row = &mut cells[y * width..(y + 1) * width];
            let known = if C::WRITES {
                span_of(row)
            } else {
                RowSpan { start: 0, end: 0 }
            };
            let (span, drift) = self.span(coder, known, above, width);
            if let Some((before, _)) = above {
                self.forget_errors(before, span);
            } else {
                self.last_first = [first, span.start];
            }
            above = Some((span, drift));
            written.include(y..y + 1, span.start..span.end + 1);
            self.row(coder, shape, (y, span), row);
        }
        written
    }

    /// Resets the errors of the columns in the span `before` but not in `span`.
    fn forget_errors(&mut self, before: RowSpan, span: RowSpan) {
        if before.start < span.start {
            self.errors[before.start..span.start].fill(0);
        }
        if before.end > span.end {
            self.errors[span.end + 1..=before.end].fill(0);
        }
    }

    /// Codes start and end of a row; also returns in which direction its start moved from the
    /// previous row.
    fn span<C: BitCoder>(
        &mut self,
        coder: &mut C,
        known: RowSpan,
        above: Option<(RowSpan, Ordering)>,
        width: usize,
    ) -> (RowSpan, Ordering) {
        let Some((before, drift)) = above else {
            let Learnt {
                first_start,
                first_width,
                ..
            } = &mut self.learnt;
            let start = first_start.near(coder, known.start, self.last_first[1], width - 1);
            let length = known.end.saturating_sub(start);
            let end = start + first_width.code(coder, length, width - 1 - start);
            return (RowSpan { start, end }, Ordering::Less);
        };
        let start =
            self.learnt.start[class_of(drift)].near(coder, known.start, before.start, width - 1);
        let moved = start.cmp(&before.start);
        let end = self.learnt.end[class_of(moved)].near(
            coder,
            known.end.max(start),
            before.end,
            width - 1,
        );
        (
            RowSpan {
                start,
                end: end.max(start),
            },
            moved,
        )
    }

    /// Codes the cells of row `y` within `span`; the first and the last of them are nonzero.
    fn row<C: BitCoder>(
        &mut self,
        coder: &mut C,
        shape: Shape,
        (y, span): (usize, RowSpan),
        row: &mut [u8],
    ) {
        let RowSpan { start, end } = span;
        let floor = usize::from(shape.floor);
        self.around.begin_row(y, start, end);
        let (mut left, mut left_error) = (Left::default(), 0);
        for x in start..=end {
            let known = C::WRITES.then(|| row.get(x)).flatten();
            let mut cell = known.copied().unwrap_or(0);
            let column = self.around.column(x);
            let error = &mut self.errors[x % MAX_SIDE];
            let maybe_zero = x != start && x != end;
            let zero = &mut self.learnt.zero[column.zero_context(&left)];
            if maybe_zero && coder.code(cell == 0, zero) {
                left_error = 0;
            } else {
                let at = [x, y];
                let (expected, kind) = column.expect(&left, shape.floor, &self.around, at);
                let class = error_class(u32::from(left_error) + u32::from(*error));
                let contexts = &mut self.learnt.cell[kind * ERROR_CLASSES + class];
                // Coded as steps above the floor: no cell is between it and zero.
                let expected = usize::from(expected);
                let step = usize::from(cell).saturating_sub(floor);
                let step = contexts.near(coder, step, expected - floor, 255 - floor);
                cell = (floor + step) as u8;
                left_error = (floor + step).abs_diff(expected) as u8;
            }
            *error = left_error;
            self.around.set(x, cell);
            left.pass(column, cell);
        }
        row[start..=end].copy_from_slice(self.around.end_row(y, start, end));
    }
}

fn span_of(row: &[u8]) -> RowSpan {
    let start = row.iter().position(|&c| c != 0).unwrap_or(0);
    RowSpan {
        start,
        end: row.iter().rposition(|&c| c != 0).unwrap_or(start),
    }
}

fn class_of(moved: Ordering) -> usize {
    match moved {
        Ordering::Less => 0,
        Ordering::Equal => 1,
        Ordering::Greater => 2,
    }
}

/// Class of the summed errors of the left and the upper prediction.
fn error_class(sum: u32) -> usize {
    // Counted without branches, because the class is unpredictable.
    usize::from(sum > 1) + usize::from(sum > 4) + usize::from(sum > 12)
}

/// Contexts of a small number: its length in bits, then its highest bits.
#[derive(Debug, Clone, Copy)]
struct Unsigned {
    length: [Probability; Self::MOST_BITS],
    second: [Probability; Self::MOST_BITS],
}

impl Unsigned {
    /// Largest number of bits after the first of a number plus one.
    const MOST_BITS: usize = 8;

    const fn new() -> Self {
        Self {
            length: [Probability::even(); Self::MOST_BITS],
            second: [Probability::even(); Self::MOST_BITS],
        }
    }

    /// Codes `number`, which is at most `limit` (at most 255); a read value is limited to that.
    #[inline]
    fn code<C: BitCoder>(&mut self, coder: &mut C, number: usize, limit: usize) -> usize {
        if limit == 0 {
            return 0;
        }
        let whole = number + 1;
        let bits = whole.ilog2() as usize;
        let mut length = 0;
        while length < Self::MOST_BITS && coder.code(length < bits, &mut self.length[length]) {
            length += 1;
        }
        let mut coded = 1;
        if let Some(second) = length.checked_sub(1) {
            coded = 2 | usize::from(coder.code(whole >> second & 1 == 1, &mut self.second[second]));
            // Bits below the second are practically random.
            for i in (0..second).rev() {
                coded = coded << 1 | usize::from(coder.even(whole >> i & 1 == 1));
            }
        }
        (coded - 1).min(limit)
    }
}

/// Contexts of a number near a predicted one.
#[derive(Debug, Clone, Copy)]
struct Signed {
    other: Probability,
    less: Probability,
    distance: [Unsigned; 2],
}

impl Signed {
    const fn new() -> Self {
        Self {
            other: Probability::even(),
            less: Probability::even(),
            distance: [Unsigned::new(); 2],
        }
    }

    /// Codes `number`, predicted near `expected`; both are at most `limit`.
    #[inline]
    fn near<C: BitCoder>(
        &mut self,
        coder: &mut C,
        number: usize,
        expected: usize,
        limit: usize,
    ) -> usize {
        if limit == 0 || !coder.code(number != expected, &mut self.other) {
            return expected;
        }
        // At an end of the range there is only one direction.
        let less = match expected {
            0 => false,
            end if end == limit => true,
            _ => coder.code(number < expected, &mut self.less),
        };
        let room = if less { expected } else { limit - expected };
        let distance = number.abs_diff(expected).saturating_sub(1);
        let distance = 1 + self.distance[usize::from(less)].code(coder, distance, room - 1);
        if less {
            expected - distance
        } else {
            expected + distance
        }
    }
}
