"""Trace files: what a run leaves behind, to be played again.

A file is a line that says what it is, then frames (`wherry.trace.codec`) as one zlib stream that is flushed after
every frame, so that a file which a crash cuts short is read up to its last whole frame.
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
from wherry.trace.codec import Decoder, Encoder, split
from wherry.trace.records import Record, thinned

MAGIC = b"wherry-trace: 1\n"
FILE_NAME = "trace.wherry"
LARGEST_FILE = 1_000_000_000  # bytes, packed and unpacked
RECORDED_EVERY = 0.4  # s between two records of what is seen
COMPRESSION = 1  # zlib level, while a run goes; 6 saves 8 % more in twice the time


class Recorder:
    """A sink that writes a trace file; use it as a context manager.

    Args:
        path: The file; what was there before is replaced.

    Raises:
        InputError: The file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._file: FileIO = path.open("wb", buffering=0)  # what is written is out of this process's hands
        except OSError as error:
            raise InputError(path, "", f"cannot be written: {error.strerror}") from error
        self._encoder = Encoder()
        self._compressor = zlib.compressobj(COMPRESSION)
        self._put(MAGIC)
        self._record = thinned(self._write, RECORDED_EVERY)

    def __call__(self, record: Record) -> None:
        """Write a record, and see to it that it survives a crash of this process.

        Raises:
            InputError: The file cannot be written any more.
        """
        self._record(record)

    def _write(self, record: Record) -> None:
        data = self._compressor.compress(self._encoder.encode(record))
        self._put(data + self._compressor.flush(zlib.Z_SYNC_FLUSH))

    def _put(self, data: bytes) -> None:
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
        """End the file."""
        if not self._file.closed:
            self._put(self._compressor.flush(zlib.Z_FINISH))
            self._file.close()


def packed(frames: bytes) -> bytes:
    """A trace file's content of frames in a row."""
    return MAGIC + zlib.compress(frames)


def find_trace(run: Path) -> Path:
    """The trace of a run's folder, or the file itself."""
    return run / FILE_NAME if run.is_dir() else run


def load_frames(path: Path) -> bytes:
    """The whole frames of a trace file in a row, checked.

    Raises:
        InputError: The file cannot be read or is no trace, or a frame in it is damaged.
    """
    return b"".join(frame for frame, _ in _frames(path))


def load_trace(run: Path) -> list[Record]:
    """The records of a trace file, or of a run's folder.

    Raises:
        InputError: The file cannot be read or is no trace, or a record in it is damaged.
    """
    return [record for _, record in _frames(find_trace(run))]


def _frames(path: Path) -> Iterator[tuple[bytes, Record]]:
    """Every whole frame of a file, and its record, which is how it is checked.

    The rest of a file that was cut short is left out.
    """
    content = read_bytes(path, limit=LARGEST_FILE)
    if not content.startswith(MAGIC):
        raise InputError(path, "first line", f"is not {MAGIC.decode().strip()!r}: no trace, or of another version")
    unpacker = zlib.decompressobj()
    try:
        data = unpacker.decompress(content[len(MAGIC) :], LARGEST_FILE)
    except zlib.error as error:
        raise InputError(path, "", f"is damaged: {error}") from error
    if unpacker.unconsumed_tail:
        raise InputError(path, "", f"holds more than {LARGEST_FILE:,} bytes")
    decoder = Decoder(str(path))
    number = 0
    for number, frame in enumerate(split(data), start=1):
        yield frame, decoder.decode(frame, f"frame {number}")
    if number == 0:
        raise InputError(path, "", "holds no record")
