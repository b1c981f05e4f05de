"""Frames of the link, written from docs/src/protocol.md: COBS, zero-terminated; inside protocol version (1 byte), kind
(1: request, 2: reply), sequence number (2 bytes, little endian), postcard body, CRC-32 as in Ethernet over all that
(4 bytes, little endian).

Tables and varints are worked out here; no library for COBS, CRC or postcard is used.
"""

from dataclasses import dataclass

REQUEST, REPLY = 1, 2
LONGEST_BODY = 240


class FrameError(ValueError):
    """Bytes that are no frame, or a body that is no message."""


# --- Checksum -------------------------------------------------------------------------------------------------------


def _crc_table():
    """CRC-32 of IEEE 802.3: polynomial 0x04C11DB7, bits reflected, so that each byte is shifted out to the right."""
    reflected = int(f"{0x04C11DB7:032b}"[::-1], 2)
    table = []
    for byte in range(256):
        remainder = byte
        for _ in range(8):
            remainder = (remainder >> 1) ^ (reflected if remainder & 1 else 0)
        table.append(remainder)
    return table


_TABLE = _crc_table()


def crc32(data):
    """CRC-32 as in Ethernet: register preset to ones, result inverted. Of b"123456789" it is 0xCBF43926."""
    register = 0xFFFFFFFF
    for byte in data:
        register = (register >> 8) ^ _TABLE[(register ^ byte) & 0xFF]
    return register ^ 0xFFFFFFFF


# --- COBS (Cheshire and Baker 1999) ---------------------------------------------------------------------------------


def cobs_encode(data):
    """Without the terminating zero. A code byte n says: n - 1 bytes follow, then a zero unless n is 255 or the end."""
    out, block, open_block = bytearray(), bytearray(), True
    for byte in data:
        open_block = True
        if byte == 0:
            out += bytes([len(block) + 1]) + block
            block = bytearray()
        else:
            block.append(byte)
            if len(block) == 254:
                out += b"\xff" + block
                block, open_block = bytearray(), False
    if open_block or block:
        out += bytes([len(block) + 1]) + block
    return bytes(out)


def cobs_decode(data):
    """Of what lies between two zeros."""
    out, place = bytearray(), 0
    while place < len(data):
        code = data[place]
        if code == 0:
            raise FrameError("a zero within a frame")
        block = data[place + 1 : place + code]
        if len(block) != code - 1:
            raise FrameError("a block that reaches beyond the frame")
        out += block
        place += code
        if code != 255 and place < len(data):
            out.append(0)
    return bytes(out)


# --- Frames ---------------------------------------------------------------------------------------------------------


@dataclass
class Frame:
    """What one frame says; `body` is postcard."""

    version: int
    kind: int
    sequence: int
    body: bytes

    def encoded(self):
        """With the terminating zero."""
        inside = bytes([self.version, self.kind]) + self.sequence.to_bytes(2, "little") + self.body
        return cobs_encode(inside + crc32(inside).to_bytes(4, "little")) + b"\0"


def frame(encoded):
    """The frame of the bytes between two zeros, or FrameError."""
    inside = cobs_decode(encoded)
    if len(inside) < 8:
        raise FrameError(f"{len(inside)} bytes are too short for a frame")
    content, checksum = inside[:-4], int.from_bytes(inside[-4:], "little")
    if crc32(content) != checksum:
        raise FrameError(f"checksum {checksum:08x} is not {crc32(content):08x}")
    if len(content) - 4 > LONGEST_BODY:
        raise FrameError(f"a body of {len(content) - 4} bytes")
    return Frame(content[0], content[1], int.from_bytes(content[2:4], "little"), content[4:])


class Splitter:
    """Cuts a stream of bytes at its zeros."""

    def __init__(self):
        self._rest = bytearray()

    def feed(self, data):
        """The stretches that `data` completes, without their zeros; empty ones are left out."""
        self._rest += data
        *whole, rest = bytes(self._rest).split(b"\0")
        self._rest = bytearray(rest)
        return [piece for piece in whole if piece]


# --- Postcard (postcard.jamesmunns.com/wire-format) -----------------------------------------------------------------
#
# A schema is one of: "bool", "u8", "u16", "u32", "u64", "i16"; ("option", S); ("list", S); "bytes" and "string", which
# begin with their length; ("array", n, S) without a length; {"field": S, ...} in order; ("enum", [("Name", S or None), ...]),
# whose number is the position. A value of an enum is (name, content).

_BITS = {"u16": 16, "u32": 32, "u64": 64}


class Reader:
    """Reads values off the front of a body."""

    def __init__(self, body):
        self._body, self._place = body, 0

    def take(self, count):
        piece = self._body[self._place : self._place + count]
        if len(piece) != count:
            raise FrameError("a body that ends too soon")
        self._place += count
        return piece

    def varint(self, bits):
        """Little endian groups of seven bits; the highest bit of a byte says that another follows."""
        value, shift = 0, 0
        while True:
            byte = self.take(1)[0]
            value |= (byte & 0x7F) << shift
            shift += 7
            if not byte & 0x80:
                break
            if shift >= bits + 7:
                raise FrameError("an endless integer")
        if value >> bits:
            raise FrameError(f"{value} does not fit {bits} bits")
        return value

    def value(self, schema):
        """The next value of this schema."""
        if schema == "bool" or schema == "u8":
            byte = self.take(1)[0]
            if schema == "bool" and byte > 1:
                raise FrameError(f"{byte} is no truth value")
            return bool(byte) if schema == "bool" else byte
        if isinstance(schema, str) and schema in _BITS:
            return self.varint(_BITS[schema])
        if schema == "i16":
            folded = self.varint(16)
            return folded // 2 if folded % 2 == 0 else -(folded + 1) // 2
        if schema in ("bytes", "string"):
            piece = bytes(self.take(self.varint(32)))
            return piece.decode() if schema == "string" else piece
        if isinstance(schema, dict):
            return {name: self.value(inner) for name, inner in schema.items()}
        match schema:
            case ("option", inner):
                return self.value(inner) if self.value("bool") else None
            case ("list", inner):
                return [self.value(inner) for _ in range(self.varint(32))]
            case ("array", count, inner):
                return [self.value(inner) for _ in range(count)]
            case ("enum", variants):
                number = self.varint(32)
                if number >= len(variants):
                    raise FrameError(f"variant {number} of {len(variants)}")
                name, inner = variants[number]
                return (name, None if inner is None else self.value(inner))
        raise TypeError(schema)

    def done(self):
        """FrameError if something is left."""
        if self._place != len(self._body):
            raise FrameError(f"{len(self._body) - self._place} bytes too many")


def _varint(value):
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def written(schema, value):
    """The bytes of a value."""
    if schema in ("bool", "u8"):
        return bytes([int(value)])
    if isinstance(schema, str) and schema in _BITS:
        return _varint(value)
    if schema == "i16":
        return _varint(2 * value if value >= 0 else -2 * value - 1)
    if schema in ("bytes", "string"):
        raw = value.encode() if schema == "string" else value
        return _varint(len(raw)) + raw
    if isinstance(schema, dict):
        return b"".join(written(inner, value[name]) for name, inner in schema.items())
    match schema:
        case ("option", inner):
            return b"\0" if value is None else b"\1" + written(inner, value)
        case ("list", inner):
            return _varint(len(value)) + b"".join(written(inner, entry) for entry in value)
        case ("array", count, inner):
            assert len(value) == count
            return b"".join(written(inner, entry) for entry in value)
        case ("enum", variants):
            name, content = value
            number = [variant for variant, _ in variants].index(name)
            inner = variants[number][1]
            return _varint(number) + (b"" if inner is None else written(inner, content))
    raise TypeError(schema)


def read(schema, body):
    """The value that is all of a body."""
    reader = Reader(body)
    value = reader.value(schema)
    reader.done()
    return value
