"""Folders of the results of commands, and the file of their metrics."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path

import typer

from wherry.commands.common import json_line
from wherry.errors import InputError

RESULT_FILE = "result.json"


@contextlib.contextmanager
def run_folder(out: Path | None, log: Path, task: str) -> Iterator[Path]:
    """The folder of a run's results; it is removed again if the run is refused, or stopped before it wrote anything.

    Args:
        out: The folder that was asked for, whose files are replaced; None for runs/LOG-TASK, or for the first of
            runs/LOG-TASK-2, -3, … that there is none of, so that no results are replaced.
        log: The recording.
        task: The command's name.

    Raises:
        InputError: The folder cannot be created or is not writable.
        typer.Abort: Ctrl-C was pressed; the text says what the folder has.
    """
    from wherry.files import create_unused_folder, ensure_writable_folder
    from wherry.pipelines.logs.reading import recording_name

    if out is not None:
        ensure_writable_folder(out)
        try:
            yield out
        except KeyboardInterrupt:
            raise typer.Abort(_stopped(out)) from None
        return
    folder = create_unused_folder(Path("runs") / f"{recording_name(log)}-{task}")
    try:
        yield folder
    except InputError:
        shutil.rmtree(folder, ignore_errors=True)  # nobody else writes to it, since it was new
        raise
    except KeyboardInterrupt:
        with contextlib.suppress(OSError):
            folder.rmdir()  # fails if it has files
        raise typer.Abort(_stopped(folder)) from None


def _stopped(folder: Path) -> str:
    """What a run that was stopped has left in its folder."""
    if (folder / RESULT_FILE).exists():
        return f"stopped; the results in {folder} are those of an earlier run, without its trace"
    names = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
    return f"stopped; {folder} has only {', '.join(names)}" if names else "stopped"


def write_result(folder: Path, metrics: Mapping[str, object]) -> None:
    """Write the metrics to result.json, as ``--json`` prints them.

    Raises:
        InputError: The folder cannot be written to.
    """
    from wherry.files import write_atomically

    write_atomically(folder / RESULT_FILE, json_line(metrics) + "\n")
