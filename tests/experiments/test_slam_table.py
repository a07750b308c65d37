"""The table of maps beside the published ones."""

from __future__ import annotations

from dataclasses import replace

from wherry.experiments.slam import Result
from wherry.experiments.slam_table import PUBLISHED, table

RESULT = Result(0.05, 0.07, 1.5, 2.9, 2984, 0.05, 0.9, 60.0, 6.0, 180, 214, 910, 0, "graph", "some.log")


def test_every_row_is_in_the_table() -> None:
    lines = table([RESULT, replace(RESULT, backend="particles", translational_error_m=None)]).splitlines()
    assert len(lines) == 1 + len(PUBLISHED) + 1
    assert lines[-1].split() == ["wherry,", "graph", "0.050", "0.070", "0.90"]
    assert any(line.startswith("RBPF") and line.split()[-2:] == ["0.070", "0.083"] for line in lines)
