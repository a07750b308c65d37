"""Reading files with a size limit, creating folders, and writing files atomically."""

from __future__ import annotations

import codecs
import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path

from wherry.errors import InputError

MAX_NUMBERED_FOLDERS = 1000  # folders of one name that are tried
BLOCK_SIZE = 1_000_000  # bytes that are read at once


def read_bytes(path: str | Path, *, max_bytes: int) -> bytes:
    """Read a whole file of at most ``max_bytes`` bytes.

    Raises:
        InputError: The file is missing, unreadable, not a file, or larger than ``max_bytes``.
    """
    path = Path(path)
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            raise InputError(path, "", "is not a file")  # a pipe or a device may never end
        with path.open("rb") as file:
            blocks, size = [], 0
            while size <= max_bytes and (block := file.read(BLOCK_SIZE)):  # read(max_bytes) would reserve max_bytes
                blocks.append(block)
                size += len(block)
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        raise InputError(path, "", getattr(error, "strerror", None) or str(error)) from error
    if size > max_bytes:
        raise InputError(path, "", f"is larger than {max_bytes:,} bytes")
    return b"".join(blocks)


def read_text(path: str | Path, *, max_bytes: int) -> str:
    """Read a whole UTF-8 file of at most ``max_bytes`` bytes; a byte order mark is left out.

    Raises:
        InputError: The file cannot be read, is larger than ``max_bytes``, or is not UTF-8 text.
    """
    data = read_bytes(path, max_bytes=max_bytes)
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise InputError(path, "", "is not UTF-8 text but UTF-16; save it as UTF-8")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(path, f"byte {error.start}", "is not UTF-8 text") from error


def write_atomically(path: str | Path, data: str | bytes) -> None:
    """Replace a file's content in one step: a reader, also after a crash, finds either the old or the new content.

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


def remove_files(paths: Iterable[Path]) -> None:
    """Remove the files that exist.

    Raises:
        InputError: A file cannot be removed.
    """
    for path in paths:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise InputError(path, "", f"cannot be removed: {error.strerror}") from error


def ensure_writable_folder(folder: str | Path) -> None:
    """Create a folder and its parents where they are missing, and check that it is writable.

    Raises:
        InputError: The folder cannot be created or is not writable.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, "", f"cannot be created: {error.strerror or error}") from error
    probe = folder / ".probe"
    write_atomically(probe, "")
    probe.unlink()


def create_unused_folder(folder: str | Path) -> Path:
    """Create a folder; if there is one already, with the first number from 2 appended for which there is none.

    Two processes that do so at the same time get two folders.

    Raises:
        InputError: The folder cannot be created, or there are `MAX_NUMBERED_FOLDERS` of its name.
    """
    folder = Path(folder)
    numbered = (folder.with_name(f"{folder.name}-{number}") for number in range(2, MAX_NUMBERED_FOLDERS + 1))
    for candidate in chain([folder], numbered):
        try:
            candidate.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise InputError(candidate, "", f"cannot be created: {error.strerror or error}") from error
        return candidate
    raise InputError(folder, "", f"exists {MAX_NUMBERED_FOLDERS:,} times; --out chooses another folder")


@contextmanager
def partial_file(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path to write to, and rename it to ``path`` when the block ends, also by an exception.

    Until then ``film.mp4`` is called ``film.part.mp4``; a killed process leaves a file of that name.

    Raises:
        InputError: The folder does not exist or cannot be written to.
    """
    path = Path(path)
    partial = path.with_name(f"{path.stem}.part{path.suffix}")
    try:
        partial.touch()
    except OSError as error:
        raise InputError(path, "", f"cannot be written: {error.strerror}") from error
    try:
        yield partial
    finally:
        partial.replace(path)
