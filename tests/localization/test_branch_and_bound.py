"""Branch and bound on a map agrees with an exhaustive search."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.localization.branch_and_bound import beam_score, branch_and_bound, window_maxima, with_border


def test_levels_are_the_maxima_of_their_windows() -> None:
    values = np.random.default_rng(0).integers(0, 255, (13, 9)).astype(np.uint8)
    levels = window_maxima(values, 3)
    padded = np.zeros((13 + 4 + 4, 9 + 4 + 4), np.uint8)
    padded[4:17, 4:13] = values
    for level in range(3):
        size = 1 << level
        for row in range(17):
            for column in range(13):
                assert levels[level, row, column] == padded[row : row + size, column : column + size].max()


def test_a_window_bounds_the_scores_of_its_cells() -> None:
    rng = np.random.default_rng(1)
    offsets = rng.integers(-20, 20, (1, 30, 2)).astype(np.int32)
    levels, flat = with_border(window_maxima(rng.integers(0, 255, (40, 40)).astype(np.uint8), 4), offsets)
    border, width = (levels.shape[1] - 40) // 2, levels.shape[2]
    for row in range(0, 40, 8):
        for column in range(0, 40, 8):
            origin = (border + row) * width + border + column
            bound = beam_score(levels[3].ravel(), flat[0], origin)
            inside = [
                beam_score(levels[0].ravel(), flat[0], origin + y * width + x) for y in range(8) for x in range(8)
            ]
            assert bound >= max(inside)


@pytest.mark.parametrize("farthest", [5, 20, 100])
def test_beams_that_leave_the_map_score_zero(farthest: int) -> None:
    rng = np.random.default_rng(2)
    values = rng.integers(1, 255, (30, 17)).astype(np.uint8)
    offsets = rng.integers(-farthest, farthest + 1, (4, 25, 2)).astype(np.int32)
    levels, flat = with_border(window_maxima(values, 3), offsets)
    border, width = (levels.shape[1] - 30) // 2, levels.shape[2]
    for row, column in ((0, 0), (29, 16), (0, 16), (29, 0), (14, 8)):
        for heading in range(4):
            ends = offsets[heading] + (row, column)
            on_map = ends[((ends >= 0) & (ends < values.shape)).all(axis=1)]
            expected = values[on_map[:, 0], on_map[:, 1]].sum(dtype=np.int64)
            assert beam_score(levels[0].ravel(), flat[heading], (border + row) * width + border + column) == expected


def test_the_search_finds_all_modes_of_an_exhaustive_search() -> None:
    rng = np.random.default_rng(3)
    for _ in range(5):
        values = (rng.random((40, 50)) < 0.05).astype(np.uint8) * 255
        free = rng.random((40, 50)) < 0.7
        offsets = rng.integers(-15, 16, (6, 20, 2)).astype(np.int32)
        levels, flat = with_border(window_maxima(values, 4), offsets)
        border, width = (levels.shape[1] - 40) // 2, levels.shape[2]
        scores = {
            (heading, row, column): beam_score(
                levels[0].ravel(), flat[heading], (border + row) * width + border + column
            )
            for heading in range(6)
            for row, column in np.argwhere(free).tolist()
        }
        open_windows = np.ascontiguousarray(window_maxima(free.astype(np.uint8), 4)[:, 8:, 8:])
        found, is_complete = branch_and_bound(levels, open_windows, flat, 0.8, 3.0, 0.0)
        best = max(scores.values())
        assert is_complete
        assert scores[tuple(found[0].tolist())] == best
        for (heading, row, column), score in scores.items():
            near = [h == heading and math.hypot(r - row, c - column) <= 3.0 for h, r, c in found.tolist()]
            assert score < 0.8 * best or any(near)
