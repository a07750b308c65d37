"""Map pictures, checked pixel by pixel."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image

from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.views.map_picture import MIN_WIDTH, MapPicture

RED = (255, 0, 0)
GRID = OccupancyGrid(np.array([[0.0, 0.5, 1.0], [0.0, 0.0, 0.0]], np.float32), 0.5, Pose(10.0, 20.0))


def pixels(picture: MapPicture) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(picture.png())))


def test_probabilities_are_grey_with_the_largest_y_on_top() -> None:
    np.testing.assert_array_equal(pixels(MapPicture(GRID))[:, :, 0], [[255, 255, 255], [255, 128, 0]])


def test_points_are_drawn_at_their_cells() -> None:
    picture = MapPicture(GRID)
    picture.points(np.array([[10.75, 20.75]]), RED)
    assert [tuple(index) for index in np.argwhere((pixels(picture) == RED).all(axis=2)).tolist()] == [(0, 1)]


def test_a_small_map_is_enlarged_to_the_width_of_its_legend() -> None:
    picture = MapPicture(GRID, is_enlarged=True)
    height = pixels(picture).shape[0]
    picture.add_legend([("trajectory", RED)])
    drawn = pixels(picture)
    assert drawn.shape[1] == MIN_WIDTH
    assert drawn.shape[0] > height
    assert (drawn[height:] == RED).all(axis=2).any()
