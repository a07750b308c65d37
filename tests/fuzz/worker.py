"""One process that loads mutated files under limits of memory, and reports what each loader did."""

from __future__ import annotations

import contextlib
import ctypes
import logging
import resource
import signal
import tempfile
import time
import traceback
import warnings
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from fuzz.faulty_loaders import FAULTY_LOADERS
from fuzz.loader import Files, Loader
from fuzz.loaders import LOADERS
from fuzz.mutations import mutate
from wherry.errors import InputError

MAX_SECONDS = 5.0  # of processor time to load one file
MAX_MEGABYTES = 1000.0  # of memory, of the whole process
MAX_MESSAGE = 450  # characters of an error, including its path
PARENT_DIED = 1  # PR_SET_PDEATHSIG of Linux


class Verdict(StrEnum):
    """What became of a file."""

    REFUSED = "refused"
    ACCEPTED = "accepted"
    FAILED = "failed"


@dataclass(frozen=True)
class Outcome:
    """What a loader did with a file.

    Attributes:
        verdict: What became of the file.
        reason: Why it was refused, or what failed.
        seconds: Processor time.
        megabytes: Peak of the process's memory.
    """

    verdict: Verdict
    reason: str
    seconds: float = 0.0
    megabytes: float = 0.0


@dataclass(frozen=True)
class Case:
    """A mutated file, reproducible from its numbers.

    Attributes:
        loader: Name of the loader.
        seed: Seed of the whole run.
        number: Number of the case among those of the loader.
    """

    loader: str
    seed: int
    number: int

    def files(self, valid: Files) -> Files:
        """The mutated files."""
        loader = loader_named(self.loader)
        rng = np.random.default_rng([self.seed, zlib.crc32(self.loader.encode()), self.number])
        return mutate(valid, loader.mutations, rng)


@dataclass(frozen=True)
class ValidFiles:
    """Valid files of a loader.

    Attributes:
        files: Contents by path.
        entry: Path that is loaded.
    """

    files: Files
    entry: str


def loader_named(name: str) -> Loader:
    """The loader of a name."""
    return next(loader for loader in (*LOADERS, *FAULTY_LOADERS) if loader.name == name)


def valid_files(loader: Loader, folder: Path) -> ValidFiles:
    """Let a loader write its valid files into an empty folder."""
    entry = loader.write(folder)
    files = {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}
    return ValidFiles(files, str(entry.relative_to(folder)))


def write_files(files: Mapping[str, bytes], folder: Path) -> None:
    """Write files into a folder."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def try_loading(loader: Loader, path: Path) -> Outcome:
    """Load a file and check what comes out."""
    _reset_peak_memory()
    started = time.process_time()
    verdict, reason = _verdict(loader, path)
    seconds, megabytes = time.process_time() - started, peak_memory()
    if seconds > MAX_SECONDS:
        verdict, reason = Verdict.FAILED, f"took {seconds:.1f} s"
    if megabytes > MAX_MEGABYTES:
        verdict, reason = Verdict.FAILED, f"needed {megabytes:.0f} MB"
    return Outcome(verdict, reason, seconds, megabytes)


def _verdict(loader: Loader, path: Path) -> tuple[Verdict, str]:
    """What a loader does with a file, and why."""
    try:
        loaded = loader.load(path)
    except InputError as error:
        text = str(error)
        if not text.isprintable() or len(text) - len(error.source) > MAX_MESSAGE:
            return Verdict.FAILED, f"the message is not one short line: {text[:300]!r}"
        return Verdict.REFUSED, f"{error.field}: {error.reason}"
    except MemoryError:
        return Verdict.FAILED, "MemoryError: " + _place()
    except Exception:
        return Verdict.FAILED, _place()
    try:
        loader.check(loaded)
    except AssertionError as error:
        return Verdict.FAILED, f"nonsense accepted, violated: {error}"
    except Exception:
        return Verdict.FAILED, f"nonsense accepted: {_place()}"
    return Verdict.ACCEPTED, ""


def _place() -> str:
    """The current exception and the last lines of wherry that it passed."""
    lines = traceback.format_exc(limit=-6).strip().splitlines()
    frames = [line.strip().replace("\n", " ") for line in lines if line.strip().startswith("File")]
    short = [frame.rpartition("/")[2].replace('", line ', ":").replace(", in ", " ") for frame in frames]
    return f"{lines[-1][:200]} ({' < '.join(reversed(short))})"


def _reset_peak_memory() -> None:
    """Begin a new peak of this process's memory."""
    with contextlib.suppress(OSError):  # the peak since the process's start counts where that is not possible
        Path("/proc/self/clear_refs").write_text("5")


def peak_memory() -> float:
    """Peak of this process's memory, MB."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return float(line.split()[1]) / 1000.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000.0


def run(connection: Connection, cases: Sequence[Case], valid: Mapping[str, ValidFiles], scratch: str) -> None:
    """Try cases one after the other and send each outcome; the body of a worker process.

    Args:
        connection: End of a pipe, to which a pair of index and outcome is sent for each case.
        cases: The cases.
        valid: Valid files by the loader's name.
        scratch: Folder for the files, which the parent removes.
    """
    ctypes.CDLL(None).prctl(PARENT_DIED, signal.SIGKILL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends its workers
    warnings.simplefilter("ignore")
    logging.disable()
    np.seterr(all="ignore")
    limit = int(2.0 * MAX_MEGABYTES * 1e6)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
    for index, case in enumerate(cases):
        with tempfile.TemporaryDirectory(dir=scratch) as name:
            folder, seed = Path(name), valid[case.loader]
            write_files(case.files(seed.files), folder)
            connection.send((index, None))  # begun
            outcome = try_loading(loader_named(case.loader), folder / seed.entry)
        connection.send((index, outcome))
    connection.close()
