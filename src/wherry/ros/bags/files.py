"""The files of a recording: a bag's file, the folder of a ROS 2 bag with or without metadata, or a split recording."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path, PurePath

from wherry.documents import read_yaml
from wherry.errors import InputError

UNFINISHED = ".active"  # suffix that rosbag gives to a bag until its recording ends
COMPRESSED = ".zstd"  # suffix of files that rosbag2 compressed as a whole
ROS1_SUFFIX = ".bag"
ROS2_SUFFIXES = (".mcap", ".db3")
SUFFIXES = (ROS1_SUFFIX, *ROS2_SUFFIXES, UNFINISHED)
METADATA = "metadata.yaml"
MCAP_MAGIC = b"\x89MCAP0\r\n"  # at the beginning and at the end of an MCAP file
URI_CHARACTERS = frozenset("#?%")  # with a meaning of their own in the path of an SQLite file that rosbags opens
MAX_METADATA_SIZE = 500_000  # bytes
MAX_FILES = 1000  # of a recording
MAX_FILES_NAMED = 4  # files that a message lists
DATE = re.compile(r"\d{4}[-_]\d\d[-_]\d\d[-_T]\d\d[-_]\d\d[-_]\d\d")
PART_NUMBER = re.compile(r"_(\d+)$")


@dataclass(frozen=True, slots=True)
class RecordingFiles:
    """Files of a recording.

    Attributes:
        files: Files to read, in the order of the recording.
        other_parts: Other files of a split recording of which one was named; its transforms may be in the first one.
        notes: What was decided, as sentences.
    """

    files: tuple[Path, ...]
    other_parts: tuple[Path, ...] = ()
    notes: tuple[str, ...] = ()


def is_bag(path: str | Path) -> bool:
    """Whether a path looks like a bag: a .bag, .mcap or .db3 file, or a folder with metadata.yaml or such files.

    The path of a metadata.yaml stands for its folder.
    """
    path = Path(path)
    if path.name == METADATA and path.is_file():
        return True
    if path.is_dir():
        return path.suffix == UNFINISHED or (path / METADATA).is_file() or bool(_bag_files(path))
    return storage_suffix(path) in SUFFIXES


def storage_suffix(path: Path) -> str:
    """Suffix of a file's format, without that of a compression."""
    return Path(path.stem).suffix if path.suffix == COMPRESSED else path.suffix


def find_files(path: Path) -> RecordingFiles:
    """Find the files of a recording.

    A file is read alone, whatever a metadata.yaml beside it says. Of a folder, the files are read that its
    metadata.yaml lists, otherwise all, if they are the parts of one recording.

    Args:
        path: Path that the user gave.

    Raises:
        InputError: There is none, the recording was cut off, or the folder holds several recordings.
    """
    if not path.exists():
        raise InputError(path, "", "No such file or directory")
    if path.name == METADATA and path.is_file():
        path = path.parent
    if path.suffix == UNFINISHED:
        raise InputError(path, "", f"is a recording that was cut off; {_recovery_hint(path)}")
    if not path.is_dir():
        notes = _unfinished([path])
        parts = [file for file in _bag_files(path.parent) if _recording(file) == _recording(path)]
        return RecordingFiles((path,), tuple(file for file in parts if file.name != path.name), notes)
    found = _bag_files(path)
    if not found:
        raise InputError(path, "", "holds no .bag, .mcap or .db3 file")
    listed, note = _listed_files(path)
    files = sorted((file for file in found if file.name in listed), key=lambda file: listed.index(file.name))
    if files:
        return RecordingFiles(tuple(files), (), (*_missing(files, listed), *_unfinished(files)))
    if len({_recording(file) for file in found}) > 1:
        raise InputError(path, "", f"holds several recordings; name one of {_named(found)}")
    return RecordingFiles(tuple(found), (), (*([note] if note else []), *_unfinished(found)))


def _bag_files(folder: Path) -> list[Path]:
    """Files of a folder that look like bags, in the order of their numbers; at most `MAX_FILES`."""
    try:
        files = [file for file in folder.iterdir() if storage_suffix(file) in SUFFIXES[:-1] and file.is_file()]
    except OSError:
        return []
    return sorted(files, key=lambda file: (_part_number(file), file.name))[:MAX_FILES]


def _part_number(file: Path) -> int:
    """Number of a part of a split recording; −1 if it has none."""
    match = PART_NUMBER.search(file.name.removesuffix(COMPRESSED).rpartition(".")[0])
    return int(match.group(1)[:9]) if match else -1


def _recording(file: Path) -> tuple[str, str]:
    """What the parts of a split recording have in common: their suffix, and their name but for number and date.

    A file without a number is a recording of its own.
    """
    stem, _, suffix = file.name.removesuffix(COMPRESSED).rpartition(".")
    match = PART_NUMBER.search(stem)
    return suffix, DATE.sub("", stem[: match.start()]) + "_*" if match else stem


def _listed_files(folder: Path) -> tuple[list[str], str]:
    """Names of the files that metadata.yaml lists, and a note if it cannot be used."""
    path = folder / METADATA
    if not path.is_file():
        return [], ""
    try:
        if path.stat().st_size > MAX_METADATA_SIZE:
            return [], f"{METADATA} is too large and was not used"
        document = read_yaml(path, max_bytes=MAX_METADATA_SIZE)
        listed = document["rosbag2_bagfile_information"]["relative_file_paths"]
        names = [PurePath(name).name for name in listed if isinstance(name, str)]
    except (InputError, OSError, TypeError, KeyError):
        return [], f"{METADATA} cannot be read and was not used"
    return names, f"{METADATA} lists {_named([Path(name) for name in names])}, which the folder does not hold"


def _missing(files: list[Path], listed: list[str]) -> tuple[str, ...]:
    """A note of the listed files that are missing."""
    missing = sorted({*listed} - {file.name for file in files})
    return (f"{_named([Path(name) for name in missing])} of the recording is missing",) if missing else ()


def write_ahead_log(file: Path) -> Path | None:
    """The file with the last messages of an SQLite file whose recorder did not close it; None if there is none."""
    log = file.with_name(f"{file.name}-wal")
    return log if file.suffix == ".db3" and log.is_file() and log.stat().st_size > 0 else None


def is_cut_off(file: Path) -> bool:
    """Whether a file is an MCAP file whose recorder did not close it."""
    if file.suffix != ".mcap":
        return False
    with file.open("rb") as source:
        begin = source.read(len(MCAP_MAGIC))
        source.seek(max(0, file.stat().st_size - len(MCAP_MAGIC)))
        return begin == MCAP_MAGIC and source.read() != MCAP_MAGIC


def _unfinished(files: list[Path]) -> tuple[str, ...]:
    """Notes of the files that the recorder did not close."""
    try:
        cut_off = [file for file in files if is_cut_off(file)]
    except OSError:
        return ()  # opening the files gives the error
    logs = [log for log in map(write_ahead_log, files) if log is not None]
    reason = "was not closed by its recorder, so its end may be missing"
    return tuple(f"{_named(left)} {reason}" for left in (cut_off, logs) if left)


def _named(files: list[Path]) -> str:
    """Names of files for a message."""
    names = ", ".join(file.name for file in files[:MAX_FILES_NAMED])
    return f"{names}, … ({len(files)} files)" if len(files) > MAX_FILES_NAMED else names or "no file"


def _recovery_hint(path: Path) -> str:
    """How to recover a recording that was cut off, as part of an error message."""
    files = sorted(path.glob("*/*")) if path.is_dir() else [path]
    for file in files:
        if file.suffix == ".db3":
            return f"{file} can be read, and ros2 bag reindex makes a bag of its folder"
        if file.suffix == ".mcap":
            return f"{file} can be read, and mcap recover makes a bag of it"
    return "rosbag reindex makes a bag of it"
