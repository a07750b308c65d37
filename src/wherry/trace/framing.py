"""Frames: the binary encoding of one record, for trace files and for the page's socket.

A frame is::

    u32  number of bytes after the checksum (all numbers are little-endian)
    u32  CRC-32 of those bytes
    u32  number of bytes of the header
         the header, JSON: {"type": "Said", "time": 1.5, …, "arrays": [["points", "<i2", [360, 2]], …]}
         the arrays in row-major order, each aligned to 4 bytes from the frame's first byte
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Header = dict[str, Any]
Arrays = Mapping[str, Array]

PREFIX = struct.Struct("<III")  # number of bytes after the checksum, checksum, number of bytes of the header
CHECKSUM_END = 8  # offset of the first byte that the checksum covers
_DTYPES = ("<i2", "<i4", "<f4", "|u1")


def encode_frame(header: Header, arrays: Arrays) -> bytes:
    """The frame of a header and arrays."""
    described = [[name, array.dtype.str, list(array.shape)] for name, array in arrays.items()]
    text = json.dumps({**header, "arrays": described}, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    parts = [text]
    for array in arrays.values():
        data = np.ascontiguousarray(array).tobytes()
        parts.append(data + b"\0" * (-len(data) % 4))
    body = struct.pack("<I", len(text)) + b"".join(parts)
    return struct.pack("<II", len(body), zlib.crc32(body)) + body


def decode_frame(data: bytes) -> tuple[Header, dict[str, Array]]:
    """Header and arrays of a frame.

    Raises:
        ValueError: The checksum does not match, or the header describes no valid array.
    """
    length, checksum, header_length = PREFIX.unpack_from(data)
    if len(data) != CHECKSUM_END + length or zlib.crc32(data[CHECKSUM_END:]) != checksum:
        raise ValueError("the checksum does not match")
    offset = PREFIX.size + header_length
    header = json.loads(data[PREFIX.size : offset])
    arrays = {}
    for name, dtype, shape in header["arrays"]:
        if dtype not in _DTYPES or not all(isinstance(side, int) and side >= 0 for side in shape):
            raise ValueError(f"invalid array of type {dtype} and shape {shape}")
        count = math.prod(shape)
        arrays[str(name)] = np.frombuffer(data, dtype, count, offset).reshape(shape)
        offset += count * np.dtype(dtype).itemsize
        offset += -offset % 4
    return header, arrays


def split_frames(data: bytes) -> Iterator[bytes]:
    """The complete frames in a byte string; an incomplete frame at its end is ignored."""
    start = 0
    while start + PREFIX.size <= len(data):
        end = start + CHECKSUM_END + PREFIX.unpack_from(data, start)[0]
        if end > len(data):
            return
        yield data[start:end]
        start = end
