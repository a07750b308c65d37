"""Runs cases in worker processes that are replaced when they hang or die, and collects the outcomes."""

from __future__ import annotations

import multiprocessing
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

from fuzz.loader import Loader
from fuzz.worker import Case, Outcome, ValidFiles, Verdict, run, valid_files

MAX_WAIT = 120.0  # s on the clock for one file, after which its process is ended; the worker's limit is processor time
MAX_START = 120.0  # s on the clock until a process begins its first file
BATCH = 50  # cases of one loader that a process gets at once
CASES_PER_PROCESS = 2000  # after which a process is replaced, so that leaks do not add up


@dataclass
class Row:
    """The outcomes of one loader.

    Attributes:
        files: Number of files.
        refused: Number of files that were refused.
        accepted: Number of files that were accepted.
        slowest: Longest processor time, s.
        peak: Largest memory of the process, MB.
        failures: Cases that failed, with their outcomes.
        reasons: Number of files by the reason of their refusal.
    """

    files: int = 0
    refused: int = 0
    accepted: int = 0
    slowest: float = 0.0
    peak: float = 0.0
    failures: list[tuple[Case, Outcome]] = field(default_factory=list)
    reasons: dict[str, int] = field(default_factory=dict)

    def add(self, case: Case, outcome: Outcome) -> None:
        """Count one outcome."""
        self.files += 1
        self.refused += outcome.verdict is Verdict.REFUSED
        self.accepted += outcome.verdict is Verdict.ACCEPTED
        self.slowest = max(self.slowest, outcome.seconds)
        self.peak = max(self.peak, outcome.megabytes)
        if outcome.verdict is Verdict.FAILED:
            self.failures.append((case, outcome))
        elif outcome.verdict is Verdict.REFUSED:
            self.reasons[outcome.reason] = self.reasons.get(outcome.reason, 0) + 1


class _Worker:
    """A process with the cases that it was given."""

    def __init__(self, cases: Sequence[Case], valid: Mapping[str, ValidFiles], folder: Path) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection: Connection
        self.connection, theirs = context.Pipe(duplex=False)
        self.cases = cases
        self.done = 0
        needed = {case.loader: valid[case.loader] for case in cases}
        self.process: BaseProcess = context.Process(target=run, args=(theirs, cases, needed, str(folder)), daemon=True)
        self.process.start()
        theirs.close()
        self.last_sign = time.monotonic()
        self.has_begun = False

    @property
    def silence(self) -> float:
        """Time since the process's last sign, s."""
        return time.monotonic() - self.last_sign

    def receive(self) -> Iterator[tuple[Case, Outcome]]:
        """The outcomes that have arrived; raise `EOFError` if the process has ended."""
        while self.connection.poll():
            index, outcome = self.connection.recv()
            self.last_sign, self.has_begun = time.monotonic(), True
            if outcome is not None:
                self.done = index + 1
                yield self.cases[index], outcome

    def end(self) -> None:
        """End the process and wait for it."""
        self.process.join(0.1)  # one that ended by itself keeps its exit status
        self.process.kill()
        self.process.join(MAX_WAIT)
        self.connection.close()


def write_valid_files(loaders: Sequence[Loader]) -> dict[str, ValidFiles]:
    """The valid files of loaders by their names."""
    valid = {}
    for loader in loaders:
        with tempfile.TemporaryDirectory() as folder:
            valid[loader.name] = valid_files(loader, Path(folder))
    return valid


def fuzz(
    valid: Mapping[str, ValidFiles],
    files: int,
    *,
    seed: int = 0,
    workers: int | None = None,
    first: int = 0,
    max_seconds: float = float("inf"),
    max_wait: float = MAX_WAIT,
    on_outcome: Callable[[Case, Outcome], None] = lambda case, outcome: None,
) -> dict[str, Row]:
    """Load mutated files, the same number with each loader.

    Args:
        valid: Valid files by the name of their loader, as from `write_valid_files`.
        files: Number of files for all loaders together.
        seed: Seed of the mutations.
        workers: Number of processes; None for one per processor.
        first: Number of each loader's first case.
        max_seconds: Time on the clock after which no further outcomes are awaited.
        max_wait: Time on the clock for one file, s, after which its process is ended.
        on_outcome: Called with each case and its outcome.

    Returns:
        The outcomes by the loader's name.
    """
    each = max(1, files // len(valid))
    # Loaders take turns, so that a run that is ended early has tried all of them
    cases = [
        Case(name, seed, first + number)
        for start in range(0, each, BATCH)
        for name in valid
        for number in range(start, min(start + BATCH, each))
    ]
    rows = {name: Row() for name in valid}
    deadline = time.monotonic() + max_seconds
    for case, outcome in _outcomes(cases, valid, workers or os.cpu_count() or 1, deadline, max_wait):
        rows[case.loader].add(case, outcome)
        on_outcome(case, outcome)
    return rows


def _outcomes(
    cases: list[Case], valid: Mapping[str, ValidFiles], count: int, deadline: float, max_wait: float
) -> Iterator[tuple[Case, Outcome]]:
    """Outcomes of the cases as they arrive."""
    share = max(1, min(CASES_PER_PROCESS, -(-len(cases) // count)))
    queue = [cases[start : start + share] for start in range(0, len(cases), share)][::-1]
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder, _ended_workers() as running:
        while queue or running:
            while queue and len(running) < count:
                running.append(_Worker(queue.pop(), valid, Path(folder)))
            wait([worker.connection for worker in running], timeout=1.0)
            for worker in list(running):
                try:
                    yield from worker.receive()
                    hung = ended = worker.silence > (max_wait if worker.has_begun else MAX_START)
                except EOFError:
                    hung, ended = False, True
                if time.monotonic() > deadline:
                    return
                if not ended:
                    continue
                worker.end()
                running.remove(worker)
                if worker.done < len(worker.cases):
                    reason = (
                        f"hung for {max_wait:.0f} s" if hung else f"its process ended with {worker.process.exitcode}"
                    )
                    yield worker.cases[worker.done], Outcome(Verdict.FAILED, reason)
                    if rest := worker.cases[worker.done + 1 :]:
                        queue.append(list(rest))


@contextmanager
def _ended_workers() -> Iterator[list[_Worker]]:
    """A list of workers that are ended with the block."""
    workers: list[_Worker] = []
    try:
        yield workers
    finally:
        for worker in workers:
            worker.end()
