"""Damage to files: of bytes, of text, of YAML and JSON documents, and of packed contents."""

from __future__ import annotations

import gzip
import io
import json
import re
import sqlite3
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.random import Generator
from PIL import Image

from wherry.trace.framing import split_frames

Mutation = Callable[[bytes, Generator], bytes]

MAX_SIZE = 2_000_000  # bytes of a mutated file
MAX_REPETITIONS = 2_000  # of a chunk that is repeated
BOMB_SIZE = 300_000_000  # bytes that a compressed bomb unpacks to

NUMBER = re.compile(rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
EXTREME_NUMBERS = (
    b"0", b"-0", b"-1", b"1", b"1.5", b"nan", b"inf", b"-inf", b"NaN", b"Infinity", b"1e308", b"-1e308", b"1e400",
    b"1e-320", b"2147483647", b"2147483648", b"-2147483649", b"4294967296", b"9223372036854775808", b"1e18", b"1e9",
    b"100000", b"1000000000", b"0x10", b"010", b"1_000", b"1e", b"--1", b"1.2.3", b"9" * 5000, b"",
)  # fmt: skip
EXTREME_FLOATS = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-320, -1.0, 0.0, 1e9, 1e18, 3.5)
EXTREME_INTEGERS = (0, 1, -1, 127, 255, 2**15, 2**16 - 1, 2**31 - 1, -(2**31), 2**32 - 1, 2**63 - 1, 1_000_000)
EXTREME_VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2**31, 2**63, 10**400, 0.5, float("nan"), float("inf"), -1e308, "", "x", "yes", "1e3",
    "0.5", "\x00", "é\n\u2028", "a" * 5000, [], {}, [[]], [0] * 50, {"a": 1}, {"": None},
)  # fmt: skip


def flip_bits(data: bytes, rng: Generator) -> bytes:
    """Change some bits."""
    changed = bytearray(data)
    for position in rng.integers(0, max(len(data), 1), rng.integers(1, 9)):
        if changed:
            changed[position] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def truncate(data: bytes, rng: Generator) -> bytes:
    """Cut off the end."""
    return data[: int(rng.integers(len(data) + 1))]


def _span(data: bytes, rng: Generator, longest: int = 4096) -> tuple[int, int]:
    """Start and end of a chunk."""
    start = int(rng.integers(len(data) + 1))
    return start, min(len(data), start + int(rng.integers(1, 2 ** rng.integers(1, longest.bit_length()))))


def delete_chunk(data: bytes, rng: Generator) -> bytes:
    """Leave out a chunk."""
    start, end = _span(data, rng)
    return data[:start] + data[end:]


def repeat_chunk(data: bytes, rng: Generator) -> bytes:
    """Repeat a chunk, once or very often."""
    start, end = _span(data, rng)
    count = int(rng.choice([1, 1, 1, 2, 10, MAX_REPETITIONS]))
    return data[:end] + data[start:end] * count + data[end:]


def move_chunk(data: bytes, rng: Generator) -> bytes:
    """Write a chunk over another place."""
    start, end = _span(data, rng)
    place = int(rng.integers(len(data) + 1))
    return data[:place] + data[start:end] + data[place + end - start :]


def fill_chunk(data: bytes, rng: Generator) -> bytes:
    """Overwrite a chunk with zeros, ones or random bytes."""
    start, end = _span(data, rng, 256)
    filling = [bytes(end - start), b"\xff" * (end - start), rng.bytes(end - start)][int(rng.integers(3))]
    return data[:start] + filling + data[end:]


def overwrite_integer(data: bytes, rng: Generator) -> bytes:
    """Overwrite a place with an extreme integer of 1 to 8 bytes."""
    size = int(rng.choice([1, 2, 4, 4, 8]))
    value = int(rng.choice(np.array(EXTREME_INTEGERS, object))) % 2 ** (8 * size)
    place = int(rng.integers(len(data) + 1))
    return data[:place] + value.to_bytes(size, "big" if rng.random() < 0.2 else "little") + data[place + size :]


def overwrite_float(data: bytes, rng: Generator) -> bytes:
    """Overwrite a place, mostly an aligned one, with an extreme float of 4 or 8 bytes."""
    form = "<d" if rng.random() < 0.6 else "<f"
    with np.errstate(over="ignore"):
        value = np.array(rng.choice(EXTREME_FLOATS), form).tobytes()
    place = int(rng.integers(len(data) + 1))
    place -= place % 4 if rng.random() < 0.7 else 0
    return data[:place] + value + data[place + len(value) :]


BYTES: tuple[Mutation, ...] = (
    flip_bits, truncate, delete_chunk, repeat_chunk, move_chunk, fill_chunk, overwrite_integer, overwrite_float,
)  # fmt: skip


def change_number(data: bytes, rng: Generator) -> bytes:
    """Replace some numbers of a text by extreme ones."""
    found = list(NUMBER.finditer(data))
    for match in reversed(_some(found, rng)):
        data = data[: match.start()] + EXTREME_NUMBERS[int(rng.integers(len(EXTREME_NUMBERS)))] + data[match.end() :]
    return data


def _some(items: Sequence[Any], rng: Generator) -> list[Any]:
    """One or a few of the items, in their order."""
    count = min(len(items), int(rng.choice([1, 1, 1, 2, 5])))
    return [items[i] for i in sorted(rng.choice(len(items), count, replace=False))] if count else []


def change_lines(data: bytes, rng: Generator) -> bytes:
    """Leave out, repeat, swap or shuffle lines."""
    lines = data.split(b"\n")
    first, second = (int(i) for i in rng.integers(len(lines), size=2))
    match int(rng.integers(5)):
        case 0:
            del lines[first]
        case 1:
            lines[second:second] = lines[first : first + int(rng.integers(1, 20))]
        case 2:
            lines[first], lines[second] = lines[second], lines[first]
        case 3:
            lines[first:first] = [lines[first]] * int(rng.integers(1, MAX_REPETITIONS))
        case _:
            rng.shuffle(lines)  # type: ignore[arg-type]
    return b"\n".join(lines)


def change_words(data: bytes, rng: Generator) -> bytes:
    """Leave out, repeat, swap or replace words of a line."""
    lines = data.split(b"\n")
    number = int(rng.integers(len(lines)))
    words = lines[number].split(b" ")
    first, second = (int(i) for i in rng.integers(len(words), size=2))
    match int(rng.integers(5)):
        case 0:
            del words[first]
        case 1:
            words[first:first] = [words[second]] * int(rng.integers(1, 100))
        case 2:
            words[first], words[second] = words[second], words[first]
        case 3:
            words[first] = EXTREME_NUMBERS[int(rng.integers(len(EXTREME_NUMBERS)))]
        case _:
            words[first] = b"word"
    lines[number] = b" ".join(words)
    return b"\n".join(lines)


def change_encoding(data: bytes, rng: Generator) -> bytes:
    """Use another encoding, other line ends, tabs, or characters that are none."""
    text = data.decode("utf-8", errors="replace")
    match int(rng.integers(8)):
        case 0:
            return text.encode("utf-16")
        case 1:
            return text.encode("utf-8-sig")
        case 2:
            return data.replace(b"\n", b"\r\n")
        case 3:
            return data.replace(b"\n", b"\r")
        case 4:
            return data.replace(b" ", b"\t")
        case 5:
            return text.replace(" ", "\u00a0\u2003").encode()
        case 6:
            start, _ = _span(data, rng)
            return data[:start] + b"\xe9\x00\xff" + data[start:]
        case _:
            return text.encode("utf-16-le", errors="replace")


TEXT: tuple[Mutation, ...] = (
    change_number, change_number, change_number, change_lines, change_words, change_words, change_encoding,
)  # fmt: skip


def _changed_tree(tree: Any, rng: Generator) -> Any:
    """A document with some of its values, keys or entries changed."""
    places = list(_places(tree))
    for container, key in reversed(_some(places, rng)):
        if (isinstance(container, dict) and key not in container) or (
            isinstance(container, list) and key >= len(container)
        ):
            continue
        match int(rng.integers(6)):
            case 0 if isinstance(container, dict):
                container[f"{key}x"] = container.pop(key)
            case 1:
                del container[key]
            case 2:
                other, other_key = places[int(rng.integers(len(places)))]
                if (isinstance(other, dict) and other_key in other) or (
                    isinstance(other, list) and other_key < len(other)
                ):
                    container[key] = json.loads(json.dumps(other[other_key], default=str))
            case 3:
                container[key] = _nested(container[key], int(rng.choice([1, 2, 40, 200])), rng)
            case _:
                container[key] = EXTREME_VALUES[int(rng.integers(len(EXTREME_VALUES)))]
    return tree


def _places(tree: Any) -> Any:
    """All containers of a document with their keys or indices."""
    if isinstance(tree, dict | list):
        for key in list(tree) if isinstance(tree, dict) else range(len(tree)):
            yield tree, key
            yield from _places(tree[key])


def _nested(value: Any, depth: int, rng: Generator) -> Any:
    """A value within lists or mappings."""
    for _ in range(depth):
        value = [value] if rng.random() < 0.5 else {"a": value}
    return value


def change_yaml(data: bytes, rng: Generator) -> bytes:
    """Change values of a YAML document, or its notation."""
    if rng.random() < 0.3 or b"&" in data:  # PyYAML itself would expand the aliases of an earlier mutation
        return _change_notation(data, rng)
    tree = _changed_tree(yaml.safe_load(data), rng)
    flow_style = (None, True, False)[int(rng.integers(3))]
    return yaml.dump(tree, sort_keys=False, allow_unicode=True, default_flow_style=flow_style).encode()


def _change_notation(data: bytes, rng: Generator) -> bytes:
    """Tabs, quotes, tags, directives, anchors, repeated keys and further documents."""
    lines = data.split(b"\n")
    number = int(rng.integers(len(lines)))
    key, colon, value = lines[number].partition(b": ")
    match int(rng.integers(9)):
        case 0:
            lines[number] = key + b":\t" + value
        case 1 if colon:
            lines[number] = key + b': "' + value + b'"'
        case 2 if colon:
            lines[number] = key + b": !!" + [b"float ", b"int ", b"str ", b"bool ", b"x "][int(rng.integers(5))] + value
        case 3:
            lines.insert(
                0, [b"%YAML 1.1\n---", b"%YAML:1.0\n---", b"---", b"%FOO", b"...", b"--- x"][int(rng.integers(6))]
            )
        case 4:
            lines.append(b"---\na: 1" if rng.random() < 0.5 else b"---")
        case 5:
            lines.insert(0, b"l0: &l0 [x]")
            lines[1:1] = [b"l%d: &l%d [%s]" % (i, i, b",".join([b"*l%d" % (i - 1)] * 9)) for i in range(1, 12)]
        case 6 if colon:
            lines[number] = key + b": &x {<<: *x, a: *x}"
        case 7:
            lines.insert(number, lines[number])
        case _:
            lines[number] = key + colon + (b"[" * 3000 if rng.random() < 0.5 else b"{a: " * 300)
    return b"\n".join(lines)


def change_json(data: bytes, rng: Generator) -> bytes:
    """Change values of a JSON document."""
    if rng.random() < 0.02:
        return data.replace(b":", b":" + b"[" * 100_000, 1)
    return json.dumps(_changed_tree(json.loads(data), rng), default=str).encode()


def change_array(array: np.ndarray[Any, Any], rng: Generator) -> np.ndarray[Any, Any]:
    """An array with other values, another length, shape or type."""
    array = array.copy()
    match int(rng.integers(8)):
        case 0:
            return array[: len(array) // 2] if array.ndim else array
        case 1:
            return np.repeat(array, 2, axis=0) if array.ndim else array
        case 2:
            return array.astype(str(rng.choice(["f4", "f8", "i2", "i8", "u1", "c8", "S3", "?"])))
        case 3:
            return array.reshape(-1, 1) if array.ndim == 1 else array.reshape(-1)
        case _ if array.size and array.dtype.kind in "fiu":
            values = EXTREME_FLOATS if array.dtype.kind == "f" else EXTREME_INTEGERS
            places = rng.integers(array.size, size=int(rng.choice([1, 1, 3, array.size])))
            for place in places:
                value = values[int(rng.integers(len(values)))]
                array.reshape(-1)[place] = (
                    np.array(value, object if isinstance(value, int) else float).astype(array.dtype, casting="unsafe")
                    if isinstance(value, float)
                    else np.uint64(value % 2**64).astype(array.dtype)
                )
            return array
    return array


def change_npz(data: bytes, rng: Generator) -> bytes:
    """Change arrays of an npz file, or the JSON document in one of them, or leave arrays out."""
    with np.load(io.BytesIO(data)) as archive:
        arrays = {name: archive[name] for name in archive.files}
    for name in _some(sorted(arrays), rng):
        if name == "head":
            arrays[name] = np.frombuffer(change_json(arrays[name].tobytes(), rng), np.uint8)
        elif rng.random() < 0.1:
            del arrays[name]
        else:
            with np.errstate(all="ignore"):
                arrays[name] = change_array(arrays[name], rng)
    if rng.random() < 0.002:
        arrays["scan_ranges"] = np.zeros(BOMB_SIZE // 8)
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def unzip_and(*mutations: Mutation) -> Mutation:
    """A mutation of the content of one entry of a zip file."""

    def change_entry(data: bytes, rng: Generator) -> bytes:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = {name: archive.read(name) for name in archive.namelist()}
        name = sorted(entries)[int(rng.integers(len(entries)))]
        entries[name] = mutations[int(rng.integers(len(mutations)))](entries[name], rng)
        file = io.BytesIO()
        with zipfile.ZipFile(file, "w") as archive:
            for entry, content in entries.items():
                archive.writestr(entry, content)
        return file.getvalue()

    return change_entry


def gunzip_and(*mutations: Mutation) -> Mutation:
    """A mutation of the content of a gzip file."""

    def change_content(data: bytes, rng: Generator) -> bytes:
        content = gzip.decompress(data)
        match int(rng.integers(40)):
            case 0:
                return gzip.compress(gzip.compress(content, 1), 1)
            case 1:
                return data + data
            case 2 if rng.random() < 0.1:
                return gzip.compress(content + bytes(BOMB_SIZE), 1)
            case 3 if rng.random() < 0.1:
                return gzip.compress(content + b"\n" * (BOMB_SIZE // 10), 1)
        return gzip.compress(mutations[int(rng.integers(len(mutations)))](content, rng), 1)

    return change_content


def change_png(data: bytes, rng: Generator) -> bytes:
    """Change a chunk of a PNG file and correct its checksum, or store the picture in another way."""
    if rng.random() < 0.3:
        image = Image.open(io.BytesIO(data))
        mode = str(rng.choice(["1", "L", "LA", "P", "RGB", "RGBA", "I;16"]))
        file = io.BytesIO()
        image.convert("L").convert(mode).save(file, str(rng.choice(["PNG", "TIFF"])))
        return file.getvalue()
    chunks, offset = [], 8
    while offset + 8 <= len(data):
        (length,) = struct.unpack_from(">I", data, offset)
        chunks.append((data[offset + 4 : offset + 8], data[offset + 8 : offset + 8 + length]))
        offset += 12 + length
    number = int(rng.integers(len(chunks)))
    kind, content = chunks[number]
    if kind == b"IHDR" and rng.random() < 0.5:
        sizes = [0, 1, 7, 9_999, 65_536, 2**31 - 1]
        content = struct.pack(">II", int(rng.choice(sizes)), int(rng.choice(sizes))) + content[8:]
    elif kind == b"IDAT" and rng.random() < 0.5:
        content = zlib.compress(any_of(BYTES)(zlib.decompress(content), rng))
    else:
        content = any_of(BYTES)(content, rng)
    chunks[number] = kind, content
    if rng.random() < 0.1:
        chunks.insert(number, (b"zTXt", b"a\0\0" + zlib.compress(bytes(20_000_000), 1)))
    return data[:8] + b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body)) for name, body in chunks
    )


def change_trace(data: bytes, rng: Generator) -> bytes:
    """Change the header or the arrays of a frame of a trace, and correct its checksum."""
    magic, _, packed = data.partition(b"\n")
    frames = list(split_frames(zlib.decompressobj().decompress(packed)))
    number = int(rng.integers(len(frames)))
    body = frames[number][8:]
    (length,) = struct.unpack_from("<I", body)
    header, arrays = body[4 : 4 + length], body[4 + length :]
    if rng.random() < 0.6:
        header = change_json(header, rng)
        header += b" " * (-len(header) % 4)
    else:
        arrays = any_of(BYTES)(arrays, rng)
    body = struct.pack("<I", len(header)) + header + arrays
    frames[number] = struct.pack("<II", len(body), zlib.crc32(body)) + body
    if rng.random() < 0.2:
        frames[number:number] = [frames[int(rng.integers(len(frames)))]]
    bomb = bytes(2 * BOMB_SIZE) if rng.random() < 0.005 else b""
    return magic + b"\n" + zlib.compress(b"".join(frames) + bomb, 1)


def change_sqlite(data: bytes, rng: Generator) -> bytes:
    """Change values in the tables of a database, or leave rows or tables out."""
    values = (*EXTREME_VALUES[:12], *EXTREME_VALUES[13:20], rng.bytes(20), int(rng.integers(2**62)))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "database"
        path.write_bytes(data)
        connection = sqlite3.connect(path)
        tables = [row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        table = tables[int(rng.integers(len(tables)))]
        columns = [row[1] for row in connection.execute(f"PRAGMA table_info({table})")]
        column = columns[int(rng.integers(len(columns)))]
        rows = [row[0] for row in connection.execute(f"SELECT rowid FROM {table}")]  # noqa: S608 - a name of our own
        row = rows[int(rng.integers(len(rows)))]
        match int(rng.integers(8)):
            case 0:
                connection.execute(f"DELETE FROM {table} WHERE rowid = {row}")  # noqa: S608
            case 1:
                connection.execute(f"DROP TABLE {table}")
            case 2 | 3:
                (content,) = connection.execute(f"SELECT data FROM messages WHERE rowid = {row}").fetchone()  # noqa: S608
                content = any_of(BYTES)(content, rng)
                connection.execute(f"UPDATE messages SET data = ? WHERE rowid = {row}", (content,))  # noqa: S608
            case _:
                value = values[int(rng.integers(len(values)))]
                if isinstance(value, int):
                    value = max(-(2**63), min(value, 2**63 - 1))
                connection.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = {row}", (value,))  # noqa: S608
        connection.commit()
        connection.close()
        return path.read_bytes()


def any_of(mutations: Sequence[Mutation]) -> Mutation:
    """One of the mutations, chosen at each call."""

    def change(data: bytes, rng: Generator) -> bytes:
        return mutations[int(rng.integers(len(mutations)))](data, rng)

    return change


def mutate(files: Mapping[str, bytes], mutations: Mapping[str, Sequence[Mutation]], rng: Generator) -> dict[str, bytes]:
    """The files of a seed, at least one of them damaged in one to four ways.

    Args:
        files: Contents by path.
        mutations: Mutations by the suffix of the path; ``""`` for all others.
        rng: Source of randomness.
    """
    damaged = dict(files)
    for _ in range(int(rng.choice([1, 1, 2, 4]))):
        name = sorted(damaged)[int(rng.integers(len(damaged)))]
        suffix = max((suffix for suffix in mutations if name.endswith(suffix)), key=len)
        own = mutations[suffix]
        chosen = own if rng.random() < 0.75 else BYTES
        try:
            damaged[name] = chosen[int(rng.integers(len(chosen)))](damaged[name], rng)[:MAX_SIZE]
        except Exception:
            damaged[name] = any_of(BYTES)(damaged[name], rng)[:MAX_SIZE]
    if len(damaged) > 1 and rng.random() < 0.03:
        del damaged[sorted(damaged)[int(rng.integers(len(damaged)))]]
    return damaged
