"""postcard in Python, as in docs/protocol.md: types that read and write bytes. No dependencies.

A type has `read(data, at, path, seen)`, which returns value and next position and calls `seen` with every part, and
`write(value)`. Bytes that end too early raise an IndexError, other invalid bytes a ValueError.
"""

import math
import struct


class Leaf:
    """A type without parts: `take(data, at)` returns value and next position, `put(value)` bytes."""

    def __init__(self, name, take, put):
        self.name, self.take, self.put = name, take, put

    def read(self, data, at, path, seen):
        value, end = self.take(data, at)
        seen(at, end, path, self.name, value)
        return value, end

    def write(self, value):
        return self.put(value)


def varint(bits):
    def take(data, at):
        value = shift = 0
        while True:
            byte = data[at]
            at += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                break
            if shift >= bits:
                raise ValueError("a varint that is too long")
        if value >> bits:
            raise ValueError("a varint that is too large")
        return value, at

    def put(value):
        bytes_ = bytearray()
        while value >= 128:
            bytes_.append(value & 127 | 128)
            value >>= 7
        return bytes(bytes_) + bytes([value])

    return take, put


def zigzag(bits):
    take_unsigned, put_unsigned = varint(bits)

    def take(data, at):
        value, at = take_unsigned(data, at)
        return value >> 1 ^ -(value & 1), at

    return take, lambda value: put_unsigned(2 * value if value >= 0 else -2 * value - 1)


def taken(data, at, length):
    if at + length > len(data):
        raise IndexError("the bytes end")
    return bytes(data[at : at + length])


def fixed(form):
    size = struct.calcsize(form)

    def take(data, at):
        (value,) = struct.unpack(form, taken(data, at, size))
        if not math.isfinite(value):
            raise ValueError(f"a number that is {value}")
        return value, at + size

    return take, lambda value: struct.pack(form, value)


def one_byte(most):
    def take(data, at):
        if data[at] > most:
            raise ValueError(f"{data[at]} where at most {most} may stand")
        return data[at], at + 1

    return take, lambda value: bytes([value])


U8 = Leaf("u8", *one_byte(255))
BOOL = Leaf("bool", *one_byte(1))
U16, U32, U64 = (Leaf(f"u{bits}", *varint(bits)) for bits in (16, 32, 64))
I32, I64 = (Leaf(f"i{bits}", *zigzag(bits)) for bits in (32, 64))
F32, F64 = Leaf("f32", *fixed("<f")), Leaf("f64", *fixed("<d"))


class Bytes:
    """A length, at most `most`, and that many bytes; text is UTF-8."""

    def __init__(self, name, most=None):
        self.name, self.most = name, most

    def read(self, data, at, path, seen):
        length, start = U32.take(data, at)
        if self.most is not None and length > self.most:
            raise ValueError(f"{path}: {length} bytes where at most {self.most} may be")
        value = taken(data, start, length)
        value = value.decode() if self.name == "text" else value
        seen(at, start + length, path, self.name, value)
        return value, start + length

    def write(self, value):
        raw = value.encode() if self.name == "text" else value
        return U32.put(len(raw)) + raw


TEXT, BYTES = Bytes("text"), Bytes("bytes")


class Raw:
    """A fixed number of bytes, without a length."""

    def __init__(self, length):
        self.length, self.name = length, f"{length} bytes"

    def read(self, data, at, path, seen):
        value, end = taken(data, at, self.length), at + self.length
        seen(at, end, path, self.name, value)
        return value, end

    def write(self, value):
        return value


class Option:
    """0, or 1 and a value."""

    def __init__(self, of):
        self.of, self.name = of, f"{of.name}?"

    def read(self, data, at, path, seen):
        there, after = BOOL.take(data, at)
        seen(at, after, path, "option", "there" if there else "none")
        return self.of.read(data, after, path, seen) if there else (None, after)

    def write(self, value):
        return b"\0" if value is None else b"\1" + self.of.write(value)


class List:
    """A number, at most `most`, and that many values."""

    def __init__(self, of, most=None):
        self.of, self.most, self.name = of, most, f"[{of.name}]"

    def read(self, data, at, path, seen):
        count, after = U32.take(data, at)
        if self.most is not None and count > self.most:
            raise ValueError(f"{path}: {count} values where at most {self.most} may be")
        if count > len(data) - after:
            raise ValueError(f"{path}: {count} values in {len(data) - after} bytes")
        seen(at, after, path, "count", count)
        values, at = [], after
        for i in range(count):
            value, at = self.of.read(data, at, f"{path}[{i}]", seen)
            values.append(value)
        return values, at

    def write(self, values):
        return U32.put(len(values)) + b"".join(map(self.of.write, values))


class Array:
    """A fixed number of values, without a number."""

    def __init__(self, of, length):
        self.of, self.length, self.name = of, length, f"{length} {of.name}"

    def read(self, data, at, path, seen):
        values = []
        for i in range(self.length):
            value, at = self.of.read(data, at, f"{path}[{i}]", seen)
            values.append(value)
        return values, at

    def write(self, values):
        return b"".join(map(self.of.write, values))


class Struct:
    """Fields in order."""

    def __init__(self, name, **fields):
        self.name, self.fields = name, fields

    def read(self, data, at, path, seen):
        values = {}
        for name, of in self.fields.items():
            values[name], at = of.read(data, at, f"{path}.{name}" if path else name, seen)
        return values, at

    def write(self, values):
        return b"".join(of.write(values[name]) for name, of in self.fields.items())


class Enum:
    """The number of a variant, and the variant's fields. A value is (name, fields), or the name alone."""

    def __init__(self, name, *plain, **variants):
        self.name, self.variants = name, {**{name: None for name in plain}, **variants}

    def read(self, data, at, path, seen):
        which, after = U32.take(data, at)
        if which >= len(self.variants):
            raise ValueError(f"{path}: no {self.name} has the number {which}")
        variant, of = list(self.variants.items())[which]
        seen(at, after, path, self.name, variant)
        if of is None:
            return variant, after
        fields, after = of.read(data, after, f"{path}.{variant}", seen)
        return (variant, fields), after

    def write(self, value):
        variant, fields = value if isinstance(value, tuple) else (value, None)
        number = U32.put(list(self.variants).index(variant))
        return number if fields is None else number + self.variants[variant].write(fields)


