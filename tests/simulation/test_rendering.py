"""Pictures of the simulated world."""

from __future__ import annotations

import os
import sys

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.simulation.rendering import SceneRenderer
from wherry_testing.halls import exact, hall


def _photographer(width: int, height: int) -> SceneRenderer:
    try:
        return SceneRenderer(exact(hall()), width, height)
    except InputError as error:
        if os.environ.get("CI") == "true":
            raise
        pytest.skip(str(error))


def _share(image: np.ndarray, *, colour: int) -> np.ndarray:
    """[H, W] where one channel is much brighter than both others."""
    others = [channel for channel in range(3) if channel != colour]
    return image[..., colour] > 1.4 * image[..., others].max(axis=-1)


def test_from_above_boxes_are_red_and_the_warehouse_green() -> None:
    with _photographer(320, 200) as photographer:
        image = photographer.overhead()
    assert image.shape == (200, 320, 3)
    rows, columns = np.nonzero(_share(image, colour=0))
    assert 20 < len(rows) < 2000
    assert 100 < np.median(columns) < 260
    rows, columns = np.nonzero(_share(image, colour=1))
    assert len(rows) > 500
    assert rows.min() > 120  # in the south
    assert columns.max() < 160  # in the west


def test_the_chasing_camera_sees_the_robot_in_the_middle() -> None:
    with _photographer(160, 120) as photographer:
        image = photographer.chase().astype(int)
    orange = (image[..., 0] > 150) & (image[..., 2] < 90) & (image[..., 1] > 60)
    rows, columns = np.nonzero(orange)
    assert len(rows) > 20
    assert abs(np.mean(columns) - 80) < 10
    assert abs(np.mean(rows) - 60) < 25


def test_too_large_a_picture_is_refused() -> None:
    with pytest.raises(InputError, match="must be 1 × 1 to 1920 × 1080 pixels, not 5000 × 100"):
        SceneRenderer(exact(hall()), width=5000, height=100)


def test_without_opengl_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco.egl", None)
    with pytest.raises(InputError, match="apt-get install libegl1"):
        SceneRenderer(exact(hall()))
