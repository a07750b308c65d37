"""The folder of recorded logs that experiments read; they are public, but not part of the package."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from wherry.errors import InputError


def check_logs(data: Path, names: Iterable[Path | str]) -> None:
    """Check that recorded logs exist, before anything is computed.

    Args:
        data: Folder of recorded logs.
        names: Paths of the files below it.

    Raises:
        InputError: A file is missing.
    """
    missing = [str(name) for name in names if not (data / name).is_file()]
    if missing:
        others = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
        raise InputError(
            data / missing[0],
            "",
            f"is missing{others}; set WHERRY_DATA or --data to the folder of recorded logs, and see "
            "docs/how-to/logs.md for where public logs come from",
        )
