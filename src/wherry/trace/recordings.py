"""Trace files: the records of a run, stored for replay.

A file begins with a line that names format and version. Frames (`wherry.trace.framing`) follow as one zlib stream,
flushed after every frame, so that a file truncated by a crash is readable up to its last complete frame.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import Self

from wherry.errors import InputError
from wherry.files import read_bytes
from wherry.trace.codec import Decoder, Encoder
from wherry.trace.framing import split_frames
from wherry.trace.records import Record, throttle_snapshots

MAGIC = b"wherry-trace: 1\n"
TRACE_FILE_NAME = "trace.wherry"
MAX_FILE_SIZE = 300_000_000  # bytes, both compressed and decompressed
SNAPSHOT_PERIOD = 0.4  # s between two recorded snapshots
COMPRESSION_LEVEL = 1  # of zlib, during a run; level 6 makes files 8 % smaller in twice the time


class TraceRecorder:
    """A sink that writes a trace file; use it as a context manager.

    Args:
        path: The file; an existing one is overwritten.

    Raises:
        InputError: The file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._file: FileIO = path.open("wb", buffering=0)  # unbuffered, so that a crash loses nothing
        except OSError as error:
            raise InputError(path, "", f"cannot be written: {error.strerror}") from error
        self._encoder = Encoder()
        self._compressor = zlib.compressobj(COMPRESSION_LEVEL)
        self._write(MAGIC)
        self._record = throttle_snapshots(self._encode, SNAPSHOT_PERIOD)

    def __call__(self, record: Record) -> None:
        """Write a record to the file at once, so that it survives a crash of this process.

        Raises:
            InputError: The file cannot be written.
        """
        self._record(record)

    def _encode(self, record: Record) -> None:
        data = self._compressor.compress(self._encoder.encode(record))
        self._write(data + self._compressor.flush(zlib.Z_SYNC_FLUSH))

    def _write(self, data: bytes) -> None:
        try:
            self._file.write(data)
        except OSError as error:
            self._file.close()
            raise InputError(self.path, "", f"cannot be written: {error.strerror}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Finish and close the file."""
        if not self._file.closed:
            self._write(self._compressor.flush(zlib.Z_FINISH))
            self._file.close()


def pack_frames(frames: bytes) -> bytes:
    """The content of a trace file with the given frames."""
    return MAGIC + zlib.compress(frames)


def find_trace(run: Path) -> Path:
    """Path of the trace file in a run's folder; a path that is not a folder is returned unchanged."""
    return run / TRACE_FILE_NAME if run.is_dir() else run


def load_frames(path: Path) -> bytes:
    """The complete frames of a trace file, each checked by decoding it.

    Raises:
        InputError: The file cannot be read or is not a trace file, or a frame in it is damaged.
    """
    return b"".join(frame for frame, _ in _frames(path))


def load_trace(run: Path) -> list[Record]:
    """The records of a trace file, or of a run's folder.

    Raises:
        InputError: The file cannot be read or is not a trace file, or a record in it is damaged.
    """
    return [record for _, record in _frames(find_trace(run))]


def _frames(path: Path) -> Iterator[tuple[bytes, Record]]:
    """The complete frames of a file, each with its record; an incomplete frame at the end is ignored."""
    content = read_bytes(path, max_bytes=MAX_FILE_SIZE)
    if not content.startswith(MAGIC):
        raise InputError(path, "first line", f"is not {MAGIC.decode().strip()!r}: no trace file, or of another version")
    decompressor = zlib.decompressobj()
    try:
        data = decompressor.decompress(content[len(MAGIC) :], MAX_FILE_SIZE)
    except zlib.error as error:
        raise InputError(path, "", f"is damaged: {error}") from error
    if decompressor.unconsumed_tail:
        raise InputError(path, "", f"contains more than {MAX_FILE_SIZE:,} bytes")
    decoder = Decoder(str(path))
    number = 0
    for number, frame in enumerate(split_frames(data), start=1):
        yield frame, decoder.decode(frame, f"frame {number}")
    if number == 0:
        raise InputError(path, "", "contains no record")
