"""Reading files with a size limit, making folders, and writing files so that a crash never leaves half of one."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from wherry.errors import InputError


def read_bytes(path: str | Path, *, limit: int) -> bytes:
    """Read a whole file of at most ``limit`` bytes.

    Raises:
        InputError: The file is missing, unreadable, not a file, or larger than ``limit``.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            data = file.read(limit + 1)
    except OSError as error:
        raise InputError(path, "", error.strerror or str(error)) from error
    if len(data) > limit:
        raise InputError(path, "", f"is larger than the {limit:,} bytes that such a file may have")
    return data


def read_text(path: str | Path, *, limit: int) -> str:
    """Read a whole UTF-8 file of at most ``limit`` bytes.

    Raises:
        InputError: As `read_bytes`, or the file is not UTF-8 text.
    """
    try:
        return read_bytes(path, limit=limit).decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(path, f"byte {error.start}", "is not UTF-8 text") from error


def write_atomically(path: str | Path, data: str | bytes) -> None:
    """Write a file so that a reader, or a crash, sees either the old content or the whole new one.

    Raises:
        InputError: The folder does not exist or cannot be written to.
    """
    path = Path(path)
    content = data.encode("utf-8") if isinstance(data, str) else data
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as error:
        raise InputError(path, "", f"cannot be written: {error.strerror}") from error
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except OSError as error:
        Path(temporary).unlink(missing_ok=True)
        raise InputError(path, "", f"cannot be written: {error.strerror}") from error
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def make_folder(folder: str | Path) -> None:
    """Make a folder, and those that it lies in, and see that it can be written to.

    Raises:
        InputError: It cannot be made, or written to.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, "", f"cannot be made: {error.strerror or error}") from error
    probe = folder / ".probe"
    write_atomically(probe, "")
    probe.unlink()


@contextmanager
def growing_file(path: str | Path) -> Iterator[Path]:
    """A place to write a file to bit by bit; it gets its name when the block ends, however it ends.

    Until then it is called ``NAME.part`` with the file's own ending behind; that is what a killed process leaves.

    Raises:
        InputError: The folder does not exist or cannot be written to.
    """
    path = Path(path)
    unfinished = path.with_name(f"{path.stem}.part{path.suffix}")
    try:
        unfinished.touch()
    except OSError as error:
        raise InputError(path, "", f"cannot be written: {error.strerror}") from error
    try:
        yield unfinished
    finally:
        unfinished.replace(path)
