"""Loads files with random damage with every loader, in processes under limits of time and memory.

A loader must refuse a damaged file with an `InputError`, or return something that satisfies its invariants. Anything
else is a failure: another exception, more than 5 s or 1 GB, or nonsense that was accepted. Failing files are saved.
"""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from fuzz.faulty_loaders import FAULTY_LOADERS
from fuzz.loader import Loader
from fuzz.loaders import LOADERS
from fuzz.runner import Row, fuzz, write_valid_files
from fuzz.worker import Case, Outcome, ValidFiles, Verdict, loader_named, try_loading, write_files

SAVED_PER_LOADER = 20  # failing files that are saved
OUT = Path("runs/fuzz")  # folder of the failing files


def main() -> int:
    """Run the command; the exit status is 1 if anything failed."""
    parser = argparse.ArgumentParser(prog="./wherry fuzz", description=(__doc__ or "").replace("`", ""))
    parser.add_argument("--files", type=int, default=10_000, help="number of damaged files, %(default)s by default")
    parser.add_argument("--loader", action="append", help="name of a loader, may be repeated; all by default")
    parser.add_argument("--seed", type=int, default=0, help="seed of the damage")
    parser.add_argument("--workers", type=int, help="number of processes; one per processor by default")
    parser.add_argument(
        "--seconds", type=float, default=float("inf"), help="time limit, after which the table is printed"
    )
    parser.add_argument("--out", type=Path, default=OUT, help="folder for failing files, %(default)s by default")
    parser.add_argument("--reasons", action="store_true", help="list for what reasons files were refused")
    parser.add_argument("--repeat", type=Path, metavar="FOLDER", help="load a saved failing file again")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))  # workers and scratch files are removed
    if arguments.repeat:
        return _repeat(arguments.repeat)
    names = arguments.loader or [loader.name for loader in LOADERS]
    if unknown := set(names) - {loader.name for loader in (*LOADERS, *FAULTY_LOADERS)}:
        parser.error(f"no loader is called {', '.join(sorted(unknown))}; {', '.join(each.name for each in LOADERS)}")
    return _run([loader for name in names if (loader := loader_named(name)).is_available], arguments)


def _run(chosen: Sequence[Loader], arguments: argparse.Namespace) -> int:
    """Fuzz loaders, print the table and save what failed."""
    started, finished = time.monotonic(), 0
    valid = write_valid_files(chosen)
    saved = dict.fromkeys(valid, 0)

    def show(case: Case, outcome: Outcome) -> None:
        nonlocal finished
        finished += 1
        if outcome.verdict is Verdict.FAILED:
            print(f"{case.loader} {case.number}: {outcome.reason}", flush=True)
            saved[case.loader] += 1
            if saved[case.loader] <= SAVED_PER_LOADER:
                _save(case, valid[case.loader], arguments.out)
        elif finished % 1000 == 0 and sys.stderr.isatty():
            print(f"{finished:,} files", file=sys.stderr, end="\r")

    seed, workers, limit = arguments.seed, arguments.workers, arguments.seconds
    rows = fuzz(valid, arguments.files, seed=seed, workers=workers, max_seconds=limit, on_outcome=show)
    _print_table(rows, time.monotonic() - started)
    if arguments.reasons:
        for name, row in rows.items():
            for reason, count in sorted(row.reasons.items(), key=lambda item: -item[1])[:40]:
                print(f"{name}: {count} × {reason[:150]}")
    return 1 if any(row.failures for row in rows.values()) else 0


def _print_table(rows: Mapping[str, Row], seconds: float) -> None:
    """Print a line for each loader and one for all."""
    print(f"{'loader':18} {'files':>8} {'refused':>8} {'accepted':>8} {'failures':>8} {'slowest s':>9} {'peak MB':>8}")
    for name, row in rows.items():
        counts = f"{row.files:8,} {row.refused:8,} {row.accepted:8,} {len(row.failures):8,}"
        print(f"{name:18} {counts} {row.slowest:9.2f} {row.peak:8.0f}")
    total, failures = sum(row.files for row in rows.values()), sum(len(row.failures) for row in rows.values())
    print(f"{total:,} files in {seconds:.0f} s, {failures} failures")


def _save(case: Case, valid: ValidFiles, out: Path) -> None:
    """Save a failing file, and print the command that loads it again."""
    folder = out / f"{case.loader}-{case.seed}-{case.number}"
    write_files(case.files(valid.files), folder)
    (folder / ".case").write_text(f"{case.loader}\n{valid.entry}\n")
    print(f"    ./wherry fuzz --repeat {folder}", flush=True)


def _repeat(folder: Path) -> int:
    """Load a saved file again, with the traceback of whatever is raised."""
    name, entry = (folder / ".case").read_text().splitlines()
    loader = loader_named(name)
    outcome = try_loading(loader, folder / entry)
    print(f"{outcome.verdict}: {outcome.reason} ({outcome.seconds:.2f} s, {outcome.megabytes:.0f} MB)")
    if outcome.verdict is Verdict.FAILED:
        loader.check(loader.load(folder / entry))
    return 0 if outcome.verdict is not Verdict.FAILED else 1


if __name__ == "__main__":
    sys.exit(main())
