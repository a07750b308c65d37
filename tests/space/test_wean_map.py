"""Maps in Wean Hall's format."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.space.wean_map import load_wean_map

HEADER = "robot_specifications->resolution   10\n\nglobal_map[0]: 3 2\n"


def test_lines_are_map_columns_of_probabilities_that_cells_are_free(tmp_path: Path) -> None:
    path = tmp_path / "map.dat.gz"
    path.write_bytes(gzip.compress(HEADER.encode() + b"1.0 0.0\n-1.0 0.25\n0.5 1.0\n"))
    grid = load_wean_map(path)
    np.testing.assert_allclose(grid.probability, [[0.0, 0.5, 0.5], [1.0, 0.75, 0.0]])
    assert grid.resolution == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", "is missing"),
        ("global_map[0]: 3 2\n", "line 1: does not give"),
        (HEADER + "1 1\n1 1\n", "line 6: has 0 values, not 2"),
        (HEADER + "1 1\n1 x\n1 1\n", "line 5: has a word"),
        (HEADER + "1 1\n1 7\n1 1\n", "neither probabilities"),
        (HEADER + "1 1\n1 nan\n1 1\n", "neither probabilities"),
        (HEADER.replace("3 2", "0 2"), "impossible size"),
        (HEADER.replace("3 2", "-3 2"), "impossible size"),
        (HEADER.replace("10", "nan"), "impossible size"),
        (HEADER.replace("10", "1e300"), "impossible size"),
        (HEADER.replace("3 2", "1000000000 1000000000"), "line 3: gives a map of more than 25,000,000 cells"),
        (HEADER.replace("3 2", f"{'9' * 400} 2"), "line 3: gives a map of more than 25,000,000 cells"),
        (HEADER.replace("3 2", "3 2 1"), "does not give"),
        (HEADER.replace("10", "10000").replace("3 2", "300 2"), "20,000 m"),
        (HEADER.replace("10", "x"), "does not give"),
    ],
)
def test_malformed_maps_are_rejected(tmp_path: Path, text: str, named: str) -> None:
    path = tmp_path / "map.dat"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_wean_map(path)
    assert named in str(caught.value)


def test_a_file_with_byte_order_mark_and_windows_line_ends_is_read(tmp_path: Path) -> None:
    text = "\ufeff" + HEADER + "1.0 0.0\n-1.0 0.25\n0.5 1.0\n"
    (tmp_path / "map.dat").write_bytes(text.replace("\n", "\r\n").encode())
    assert load_wean_map(tmp_path / "map.dat").shape == (2, 3)


def test_a_truncated_gzip_file_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "map.dat.gz"
    path.write_bytes(gzip.compress(HEADER.encode() * 50)[:-20])
    with pytest.raises(InputError, match="whole gzip"):
        load_wean_map(path)
