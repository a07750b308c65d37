"""Arrays of cells that grow."""

from __future__ import annotations

import numpy as np

from wherry.space.tiles import enlarge


def test_an_enlarged_array_keeps_its_values_at_their_cells() -> None:
    array = np.arange(6).reshape(1, 2, 3)
    low, new_low, new_high = np.array([4, -1]), np.array([2, -2]), np.array([8, 3])
    enlarged = enlarge(array, low, new_low, new_high, -7)
    assert enlarged.shape == (1, 5, 6)
    np.testing.assert_array_equal(enlarged[:, 1:3, 2:5], array)
    assert (enlarged == -7).sum() == 30 - 6


def test_an_empty_array_can_be_enlarged() -> None:
    enlarged = enlarge(np.zeros((0, 0)), np.zeros(2, np.int64), np.array([5, 5]), np.array([7, 6]), 3)
    np.testing.assert_array_equal(enlarged, [[3.0, 3.0]])
