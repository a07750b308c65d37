"""What is needed to fuzz a loader of users' files."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fuzz.mutations import BYTES, Mutation

Files = dict[str, bytes]


@dataclass(frozen=True)
class Loader:
    """A loader of users' files, with what is needed to fuzz it.

    Attributes:
        name: Name in the table and on the command line.
        load: Loads the file or folder at a path.
        check: Raises an `AssertionError` if what was loaded is nonsense.
        write: Writes valid files into an empty folder and returns the path to load.
        mutations: Mutations by suffix of the files' names; ``""`` for all others.
        needs: Package that must be installed.
    """

    name: str
    load: Callable[[Path], Any]
    check: Callable[[Any], None]
    write: Callable[[Path], Path]
    mutations: Mapping[str, Sequence[Mutation]] = field(default_factory=lambda: {"": BYTES})
    needs: str = "wherry"

    @property
    def is_available(self) -> bool:
        """Whether the package that it needs is installed."""
        return importlib.util.find_spec(self.needs) is not None
