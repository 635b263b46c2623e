"""The patch codec's decoder in Python, as in docs/patch_codec.md: the maps of one person in one camera from their bytes.

Slow and simple: every number is computed as the page describes, in single precision where the page requires it. Needs numpy.
"""

import pathlib
import re

import numpy as np

F = np.float32
PRIORS = pathlib.Path(__file__).parents[2] / "proto/src/patch/gaussian/priors.rs"


# Range coder.

LEAST, MEMORY, BEFOREHAND = 64, 60, 10


class Probability:
    """Probability of a 0, of 65,536, and the number of bits it has learnt from."""

    def __init__(self, of_zero=1 << 15, seen=0):
        self.of_zero, self.seen = of_zero, seen

    def learn(self, bit):
        if bit:
            self.of_zero -= (self.of_zero - LEAST) // (self.seen + 2)
        else:
            self.of_zero += (65536 - LEAST - self.of_zero) // (self.seen + 2)
        self.seen = min(self.seen + 1, MEMORY)


class BitReader:
    def __init__(self, data):
        self.data, self.at, self.code, self.range = data, 0, 0, 0xFFFFFFFF
        for _ in range(4):
            self.pull()

    def pull(self):
        byte = self.data[self.at] if self.at < len(self.data) else 0
        self.at += 1
        self.code = (self.code << 8 | byte) & 0xFFFFFFFF

    def bit(self, probability):
        share = (self.range >> 16) * probability.of_zero
        bit = self.code >= share
        if bit:
            self.code -= share
            self.range -= share
        else:
            self.range = share
        probability.learn(bit)
        while self.range < 1 << 24:
            self.range = self.range << 8 & 0xFFFFFFFF
            self.pull()
        return int(bit)

    def even(self):
        return self.bit(Probability())

    def plain(self, bits):
        value = 0
        for _ in range(bits):
            value = value << 1 | self.even()
        return value

    def left(self):
        """Unused bytes at the end; negative if the bytes ended too early."""
        return len(self.data) + 3 - self.at


def number(reader, contexts):
    """An integer near 0: 20 contexts."""
    if not reader.bit(contexts[0]):
        return 0
    negative = reader.bit(contexts[1])
    n = 0
    while n < 9 and reader.bit(contexts[2 + n]):
        n += 1
    value = 1
    for i in reversed(range(n)):
        value = value << 1 | (reader.bit(contexts[11 + i]) if i + 1 == n else reader.even())
    return -value if negative else value


def tree(reader, contexts):
    node = 1
    while node < len(contexts) + 1:
        node = node << 1 | reader.bit(contexts[node - 1])
    return node - len(contexts) - 1


def count(reader, contexts):
    n = 0
    while n < len(contexts) and reader.bit(contexts[n]):
        n += 1
    return n


# Single precision.


def floor(x):
    near = F(F(x + F(8388608)) - F(8388608))
    return F(near - F(1)) if near > x else near


def ceil(x):
    near = F(F(x + F(8388608)) - F(8388608))
    return F(near + F(1)) if near < x else near


TERMS = [F(t) for t in (1.5353362e-4, 1.3398874e-3, 9.618437e-3, 5.5503325e-2, 2.4022647e-1, 6.931472e-1, 1.0)]


def exp2(x):
    x = min(max(x, F(-126)), F(126))
    above = floor(F(x + F(128.5)))
    f = F(x - F(above - F(128)))
    power = F(0)
    for term in TERMS:
        power = F(F(power * f) + term)
    return F(power * np.uint32(int(above - F(1)) << 23).view(F))


def exp(x):
    return exp2(F(x * F(1.44269504088896340736)))


def not_below_zero(x):
    return x if x > 0 else F(0)


def at_most(most, x):
    return x if x < most else most


def span_start(center, reach, size):
    return ceil(at_most(size, not_below_zero(F(center - reach))))


def span_end(center, reach, size):
    last = F(center + reach)
    after = F(0) if last < 0 else F(1)
    return at_most(size, F(floor(at_most(size, not_below_zero(last))) + after))


# Modes.

STEPS, WIDEST, MOST_TILTED, OUTSIDE, FURTHER = 16, 24, 6, 4, 18
SIGMA, REACH2 = F(2.05), F(8)
# By level from 1: omitted bits of positions and heights, steps of widths and correlations.
RECIPES = {1: (0, 0, 1, 1), 2: (0, 1, 1, 1), 3: (1, 2, 1, 1), 4: (1, 3, 2, 2), 5: (1, 3, 2, 2), 6: (2, 4, 4, 8)}
CORRECTION_STEPS = (4, 8, 12, 20, 24, 32, 40, 0, 0, 0, 0)
NEAR = [
    ((0, 0), (0, 0)), ((0, 0), (4, -14)), ((1, 1), (-14, -1)), ((1, 1), (10, 7)), ((2, 2), (-12, 7)), ((3, 3), (16, 78)),
    ((4, 5), (-16, 0)), ((5, 5), (8, 100)), ((6, 6), (-8, 96)), ((7, 7), (0, 60)), ((8, 8), (8, 40)), ((5, 5), (0, 215)),
    ((11, 11), (-32, -2)), ((11, 11), (0, 155)), ((12, 13), (0, 0)), ((13, 13), (0, 150)), ((14, 15), (0, 0)),
]
# Contexts, in the order of the priors: number of each.
PARTS = {"position": 38 * 20, "height": 5 * 15, "width": 27 * 20, "count": 3 * 4, "corrected": 3, "window": 4 * 20, "zero": 20, "sign": 5, "size": 36}


def fresh_contexts():
    priors = [int(n) for n in re.findall(r"\d+", PRIORS.read_text().split("= [")[1].split("]")[0])]
    if len(priors) != sum(PARTS.values()):
        raise ValueError(f"{PRIORS}: {len(priors)} priors")
    every = [Probability(prior << 8, BEFOREHAND) if prior else Probability() for prior in priors]
    parts, at = {}, 0
    for name, n in PARTS.items():
        parts[name] = every[at : at + n]
        at += n
    return parts


class Scale:
    def __init__(self, width, height):
        self.width, self.height = width, height
        self.cells = max(F(F(width) / F(48)), F(F(height) / F(64)))
        self.last = [int(F(F(n) / self.cells)) * STEPS for n in (width, height)]

    def sigma(self, width):
        steps = min(max(width + WIDEST, 0), 2 * WIDEST)
        return F(F(SIGMA * self.cells) * exp2(F(F(F(steps) - F(WIDEST)) / F(12))))


class ModeReader:
    def __init__(self, contexts, keypoints, scale, recipe):
        self.contexts, self.scale = contexts, scale
        self.position_bits, self.height_bits, self.width_step, self.tilt_step = recipe
        self.is_coco = keypoints == 17
        self.middle = [scale.last[0] // 2, scale.last[1] // 5 if self.is_coco else scale.last[1] // 2]
        self.peaks, self.last_count, self.last_height, self.last_widths = [], 1, None, [0, 0, 0]

    def part(self, name, index, size):
        return self.contexts[name][index * size : (index + 1) * size]

    def expected(self):
        nearest = next((peak for peak in reversed(self.peaks) if peak is not None), self.middle)
        if not self.is_coco:
            return nearest, 17
        k = len(self.peaks)
        of, offset = NEAR[k]
        at = []
        for axis in (0, 1):
            near = self.peaks[of[axis]] if of[axis] < k else None
            at.append(near[axis] + offset[axis] if near is not None else nearest[axis])
        return at, k

    def map(self, reader):
        n = count(reader, self.part("count", min(self.last_count, 2), 4))
        self.last_count = n
        modes, (expected, kind) = [], self.expected()
        for _ in range(n):
            modes.append(self.mode(reader, expected, kind))
            expected, kind = modes[-1]["at"], FURTHER
        self.peaks.append(modes[0]["at"] if modes else None)
        return modes

    def mode(self, reader, expected, kind):
        at = []
        for axis in (0, 1):
            near = expected[axis] >> 2
            off = number(reader, self.part("position", 2 * kind + axis, 20))
            fine = reader.plain(2 - self.position_bits) << self.position_bits
            at.append(min(max((near + off) << 2 | fine, -OUTSIDE * STEPS), self.scale.last[axis] + OUTSIDE * STEPS))
        last = self.last_height
        of_height = 4 if kind == FURTHER else 0 if last is None else 1 + (last > 127) + (last > 207)
        upper = tree(reader, self.part("height", of_height, 15))
        step = upper << (4 - self.height_bits) | reader.plain(4 - self.height_bits)
        height = step << self.height_bits | (1 << self.height_bits) // 2
        if kind != FURTHER:
            self.last_height = height
        coded, steps = [0, 0, 0], [self.width_step, self.width_step, self.tilt_step]
        for i in range(3):
            if i == 2 and self.tilt_step > MOST_TILTED:
                continue
            neighbour = coded[0] if i == 1 else self.last_widths[i]
            kind_of_step = (steps[i] > 1) + (steps[i] > 2)
            coded[i] = number(reader, self.part("width", (kind_of_step * 3 + i) * 3 + min(abs(neighbour), 2), 20))
        self.last_widths = coded
        across, down, tilt = (min(max(c * s, -most), most) for c, s, most in zip(coded, steps, (WIDEST, WIDEST, MOST_TILTED)))
        return {"at": at, "height": height, "width": (across, down), "tilt": tilt}


def draw(mode, scale, cells):
    """Writes the mode to a map (rows x columns) where it is higher."""
    x, y = (F(F(F(at) / F(STEPS)) * scale.cells) for at in mode["at"])
    sx, sy = (scale.sigma(width) for width in mode["width"])
    tilt = F(F(mode["tilt"]) * F(1 / 8))
    rest = F(F(1) - F(tilt * tilt))
    a = F(F(1) / F(F(sx * sx) * rest))
    b_of_a = F(F(-tilt / F(F(sx * sy) * rest)) / a)
    sy2, across, fall = F(sy * sy), F(sx * np.sqrt(rest)), exp(-a)
    width, height = F(scale.width), F(scale.height)
    reach = F(sy * np.sqrt(REACH2))
    first, end = int(span_start(y, reach, height)), int(span_end(y, reach, height))
    for row in range(min(first, end), end):
        dy = F(F(row) - y)
        middle = F(x - F(b_of_a * dy))
        down = F(F(dy * dy) / sy2)
        half = F(across * np.sqrt(not_below_zero(F(REACH2 - down))))
        start, stop = span_start(middle, half, width), span_end(middle, half, width)
        dx = F(start - middle)
        value = F(F(mode["height"]) * exp(F(F(-0.5) * F(F(F(a * dx) * dx) + down))))
        ratio = exp(F(-a * F(dx + F(0.5))))
        for column in range(int(start), int(stop)):
            cell = int(floor(at_most(F(255), F(value + F(0.5)))))
            cells[row, column] = max(cells[row, column], cell)
            value, ratio = F(value * ratio), F(ratio * fall)


# Corrections.


class CorrectionReader:
    def __init__(self, contexts, scale):
        self.contexts, self.scale = contexts, scale
        self.pitch = max(scale.cells, F(1))
        self.places = []
        for size in (scale.width, scale.height):
            n = int(np.ceil(F(F(size - 1) / self.pitch))) + 1
            self.places.append([min(int(F(F(F(place) * self.pitch) + F(0.5))), size - 1) for place in range(n)])

    def read(self, reader, cells, step):
        window = []
        for axis in (0, 1):
            size = len(self.places[axis])
            first = number(reader, self.contexts["window"][40 * axis : 40 * axis + 20]) + size // 2
            first = min(max(first, 0), size - 1)
            length = number(reader, self.contexts["window"][40 * axis + 20 : 40 * axis + 40]) + 8
            window.append(range(first, min(first + max(length, 1), size)))
        columns, rows = window
        values = np.zeros((len(rows), len(columns)), int)
        for j, row in enumerate(rows):
            for i, column in enumerate(columns):
                around = [
                    values[j, i - 1] if i else 0,
                    values[j - 1, i] if j else 0,
                    values[j - 1, i - 1] if i and j else 0,
                    values[j - 1, i + 1] if j and i + 1 < len(columns) else 0,
                ]
                shown = cells[self.places[1][row], self.places[0][column]]
                values[j, i] = self.value(reader, around, shown)
        self.add(cells, step, columns, rows, values)

    def value(self, reader, around, shown):
        left, up, above_left, above_right = (min(abs(int(v)), 64) for v in around)
        near = 2 * (left + up) + above_left + above_right
        kind = sum(near > most for most in (0, 1, 3, 6)) * 4 + sum(shown > most for most in (0, 39, 119))
        if not reader.bit(self.contexts["zero"][kind]):
            return 0
        signs = int(np.sign(around[0]) + np.sign(around[1]))
        negative = reader.bit(self.contexts["sign"][signs + 2])
        kind = min(near // 4, 2)
        size = 1
        for context in self.contexts["size"][12 * kind : 12 * kind + 12]:
            if not reader.bit(context):
                break
            size += 1
        else:
            size += abs(number(reader, [Probability() for _ in range(20)]))
        size = min(size, 255)
        return -size if negative else size

    def add(self, cells, step, columns, rows, values):
        if self.pitch <= 1:
            part = cells[rows.start : rows.stop, columns.start : columns.stop]
            part[:] = np.clip(part + step * values, 0, 255)
            return
        pitch = self.pitch

        def reach(places, size):
            first = int(max(F(F(F(places.start) - F(1)) * pitch), F(0)))
            return range(min(first, size), min(int(F(F(places.stop) * pitch)) + 1, size))

        def split(cell):
            place = F(F(cell) / pitch)
            return int(place), F(place - F(int(place)))

        def at(i, j):
            return F(values[j - rows.start, i - columns.start]) if i in columns and j in rows else F(0)

        for y in reach(rows, self.scale.height):
            j, fy = split(y)
            for x in reach(columns, self.scale.width):
                i, fx = split(x)
                upper = F(at(i, j) + F(fx * F(at(i + 1, j) - at(i, j))))
                lower = F(at(i, j + 1) + F(fx * F(at(i + 1, j + 1) - at(i, j + 1))))
                sum_ = F(F(F(cells[y, x]) + F(F(step) * F(upper + F(fy * F(lower - upper))))) + F(0.5))
                cells[y, x] = int(min(max(sum_, F(0)), F(255)))


# Without loss.


class Unsigned:
    """A number from 0 to 255."""

    def __init__(self):
        self.length, self.second = [Probability() for _ in range(8)], [Probability() for _ in range(8)]

    def read(self, reader, limit):
        if limit == 0:
            return 0
        n = count(reader, self.length)
        value = 1
        for i in reversed(range(n)):
            value = value << 1 | (reader.bit(self.second[i]) if i + 1 == n else reader.even())
        return min(value - 1, limit)


class Signed:
    """A number near an expected one."""

    def __init__(self):
        self.other, self.less, self.distance = Probability(), Probability(), (Unsigned(), Unsigned())

    def read(self, reader, expected, limit):
        if limit == 0 or not reader.bit(self.other):
            return expected
        less = 0 if expected == 0 else 1 if expected == limit else reader.bit(self.less)
        room = expected if less else limit - expected
        distance = 1 + self.distance[less].read(reader, room - 1)
        return expected - distance if less else expected + distance


class LosslessReader:
    def __init__(self, width, height, floor_):
        self.width, self.height, self.floor = width, height, floor_
        self.empty_map, self.empty_row = [Probability(), Probability()], [Probability(), Probability()]
        self.first_row, self.rows, self.first_start, self.first_width = Signed(), Unsigned(), Signed(), Unsigned()
        self.start, self.end = [Signed() for _ in range(3)], [Signed() for _ in range(3)]
        self.zero = [Probability() for _ in range(8)]
        self.cell = [[Signed() for _ in range(4)] for _ in range(5)]
        self.last_empty, self.last_first = 0, (height // 2, width // 2)

    def map(self, reader, cells):
        self.last_empty = reader.bit(self.empty_map[self.last_empty])
        if self.last_empty:
            return
        first = self.first_row.read(reader, self.last_first[0], self.height - 1)
        last = first + self.rows.read(reader, self.height - 1 - first)
        errors, span, drift, above_empty = [0] * self.width, None, 0, 0
        for y in range(first, last + 1):
            row_empty = reader.bit(self.empty_row[above_empty]) if y not in (first, last) else 0
            above_empty = row_empty
            if row_empty:
                errors = [0] * self.width
                continue
            if span is None:
                start = self.first_start.read(reader, self.last_first[1], self.width - 1)
                end = start + self.first_width.read(reader, self.width - 1 - start)
                self.last_first = (first, start)
            else:
                start = self.start[drift].read(reader, span[0], self.width - 1)
                drift = 1 + (start > span[0]) - (start < span[0])
                end = max(start, self.end[drift].read(reader, span[1], self.width - 1))
            span = (start, end)
            self.row(reader, y, start, end, cells, errors)

    def row(self, reader, y, start, end, cells, errors):
        errors[:start] = [0] * start
        errors[end + 1 :] = [0] * (self.width - end - 1)

        def cell(up, back, x):
            inside = y - up >= 0 and 0 <= x - back < self.width
            # Of the row itself only the cells before x; columns before the start of a row are 0.
            return int(cells[y - up, x - back]) if inside and (up or back) else 0

        for x in range(start, end + 1):
            c = lambda up, back: cell(up, back, x)
            above_right = cell(1, -1, x)
            context = (c(0, 1) == 0) | (c(1, 0) == 0) << 1 | (above_right == 0) << 2
            if x not in (start, end) and reader.bit(self.zero[context]):
                errors[x] = 0
                continue
            expected, kind = self.expect(c)
            error = (errors[x - 1] if x else 0) + errors[x]
            of_error = 0 if error <= 1 else 1 if error <= 4 else 2 if error <= 12 else 3
            step = self.cell[kind][of_error].read(reader, expected - self.floor, 255 - self.floor)
            cells[y, x] = self.floor + step
            errors[x] = abs(self.floor + step - expected)

    def expect(self, c):
        left, up = c(0, 1), c(1, 0)
        from_left = scaled(left, [(c(k, 0), c(k, 1)) for k in (1, 2, 3)])
        from_up = scaled(up, [(c(0, k), c(1, k)) for k in (1, 2, 3)])
        if from_left is not None and from_up is not None:
            value, kind = (from_left + from_up + 1) // 2, 0
        elif from_left is not None or from_up is not None:
            value, kind = from_left if from_left is not None else from_up, 1
        elif left > 0:
            value, kind = scaled(left, [(left, c(0, 2))]), 2
            value = left if value is None else value
        elif up > 0:
            value, kind = scaled(up, [(up, c(2, 0))]), 3
            value = up if value is None else value
        else:
            value, kind = self.floor, 4
        return min(max(value, self.floor), 255), kind


def scaled(value, pairs):
    a = sum(p for p, q in pairs if p > 0 and q > 0)
    b = sum(q for p, q in pairs if p > 0 and q > 0)
    return (value * a + b // 2) // b if value > 0 and b > 0 else None


def decode(data, width, height, keypoints):
    """The maps, keypoints x rows x columns, of 255; and the compression level."""
    if not (1 <= width <= 256 and 1 <= height <= 256 and 1 <= keypoints <= 64):
        raise ValueError(f"{keypoints} maps of {width} x {height} cells")
    reader = BitReader(data)
    level = min(reader.plain(4), 6)
    maps = np.zeros((keypoints, height, width), int)
    if level == 0:
        lossless = LosslessReader(width, height, max(reader.plain(8), 1))
        for cells in maps:
            lossless.map(reader, cells)
    else:
        step = CORRECTION_STEPS[reader.plain(4) % len(CORRECTION_STEPS)]
        scale, contexts = Scale(width, height), fresh_contexts()
        modes, corrections = ModeReader(contexts, keypoints, scale, RECIPES[level]), CorrectionReader(contexts, scale)
        for cells in maps:
            peaks = modes.map(reader)
            for mode in peaks:
                draw(mode, scale, cells)
            if step and reader.bit(contexts["corrected"][min(len(peaks), 2)]):
                corrections.read(reader, cells, step)
    if reader.left() != 0:
        raise ValueError(f"{reader.left()} bytes are left over")
    return maps, level
