"""Reads the records of an uncompressed MCAP file in order, as in docs/protocol.md. No dependencies; see mcap.dev for the format."""

import struct
import zlib

MAGIC = b"\x89MCAP0\r\n"


class Fields:
    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, form):
        values = struct.unpack_from("<" + form, self.data, self.at)
        self.at += struct.calcsize("<" + form)
        return values if len(values) > 1 else values[0]

    def bytes(self, length):
        self.at += length
        if self.at > len(self.data):
            raise ValueError("a record that ends too early")
        return self.data[self.at - length : self.at]

    def text(self):
        return self.bytes(self.take("I")).decode()

    def texts(self):
        end = self.take("I") + self.at
        found = {}
        while self.at < end:
            name = self.text()
            found[name] = self.text()
        return found


class Recording:
    """`profile`, `facts` (metadata by name), `files` (attachments by name), `schemas`, `channels` by id, and `messages`:
    (topic, encoding, log time, publish time, sequence, bytes)."""

    def __init__(self, data):
        if not data.startswith(MAGIC) or not data.endswith(MAGIC):
            raise ValueError("no whole MCAP file")
        self.facts, self.files, self.schemas, self.channels, self.messages = {}, {}, {}, {}, []
        self.chunks, self.profile = 0, None
        self.records(data, len(MAGIC))

    def records(self, data, at):
        while at + 9 <= len(data):
            kind, length = struct.unpack_from("<BQ", data, at)
            fields = Fields(data[at + 9 : at + 9 + length])
            at += 9 + length
            if kind == 0x0F:  # End of data; an index follows.
                return
            {0x01: self.header, 0x03: self.schema, 0x04: self.channel, 0x05: self.message, 0x06: self.chunk, 0x09: self.file, 0x0C: self.fact}.get(
                kind, lambda _: None
            )(fields)

    def header(self, fields):
        self.profile = fields.text()

    def schema(self, fields):
        number, name, encoding = fields.take("H"), fields.text(), fields.text()
        self.schemas[number] = (name, encoding, fields.bytes(fields.take("I")))

    def channel(self, fields):
        number, schema = fields.take("HH")
        self.channels[number] = (fields.text(), fields.text(), schema)

    def message(self, fields):
        channel, sequence, log, publish = fields.take("HIQQ")
        topic, encoding, _ = self.channels[channel]
        self.messages.append((topic, encoding, log, publish, sequence, fields.data[fields.at :]))

    def chunk(self, fields):
        _, _, size, checksum = fields.take("QQQI")
        compression = fields.text()
        records = fields.bytes(fields.take("Q"))
        if compression or len(records) != size or checksum not in (0, zlib.crc32(records)):
            raise ValueError("a chunk that is compressed, or damaged")
        self.chunks += 1
        self.records(records, 0)

    def file(self, fields):
        fields.take("QQ")
        name, kind = fields.text(), fields.text()
        self.files[name] = (kind, fields.bytes(fields.take("Q")))

    def fact(self, fields):
        name = fields.text()
        self.facts[name] = fields.texts()
