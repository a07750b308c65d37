"""Rendered pictures of the simulated world."""

from __future__ import annotations

import os
import sys
from contextlib import closing

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.simulation.rendering import SceneRenderer
from wherry_testing.halls import hall, noise_free


def _renderer(width: int, height: int) -> SceneRenderer:
    try:
        return SceneRenderer(noise_free(hall()), width, height)
    except InputError as error:
        if os.environ.get("CI") == "true":
            raise
        pytest.skip(str(error))


def _is_bright(image: np.ndarray, *, colour: int) -> np.ndarray:
    """[H, W] True where one channel is much brighter than the others."""
    others = [channel for channel in range(3) if channel != colour]
    return image[..., colour] > 1.4 * image[..., others].max(axis=-1)


def test_the_overhead_view_shows_red_boxes_and_a_green_warehouse() -> None:
    with closing(_renderer(320, 200)) as renderer:
        image = renderer.overhead()
    assert image.shape == (200, 320, 3)
    rows, columns = np.nonzero(_is_bright(image, colour=0))
    assert 20 < len(rows) < 2000
    assert 100 < np.median(columns) < 260
    rows, columns = np.nonzero(_is_bright(image, colour=1))
    assert len(rows) > 500
    assert rows.min() > 120  # in the south
    assert columns.max() < 160  # in the west


def test_the_chase_view_shows_the_robot_in_the_middle() -> None:
    with closing(_renderer(160, 120)) as renderer:
        image = renderer.chase().astype(int)
    orange = (image[..., 0] > 150) & (image[..., 2] < 90) & (image[..., 1] > 60)
    rows, columns = np.nonzero(orange)
    assert len(rows) > 20
    assert abs(np.mean(columns) - 80) < 10
    assert abs(np.mean(rows) - 60) < 25


def test_a_too_large_picture_is_rejected() -> None:
    with pytest.raises(InputError, match="must be 1 × 1 to 1920 × 1080 pixels, not 5000 × 100"):
        SceneRenderer(noise_free(hall()), width=5000, height=100)


def test_missing_opengl_is_reported_with_advice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco.egl", None)
    with pytest.raises(InputError, match="apt-get install libegl1"):
        SceneRenderer(noise_free(hall()))
