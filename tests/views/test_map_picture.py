"""Map pictures, checked pixel by pixel."""

from __future__ import annotations

import io
from itertools import groupby

import numpy as np
import pytest
from PIL import Image

from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.views.map_picture import MIN_LINE_WIDTH, MIN_WIDTH, STROKE_SHARE, LegendEntry, MapPicture, Symbol

RED = (255, 0, 0)
GRID = OccupancyGrid(np.array([[0.0, 0.5, 1.0], [0.0, 0.0, 0.0]], np.float32), 0.5, Pose(10.0, 20.0))


def pixels(picture: MapPicture) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(picture.png())))


def test_probabilities_are_grey_with_the_largest_y_on_top() -> None:
    np.testing.assert_array_equal(pixels(MapPicture(GRID))[:, :, 0], [[255, 255, 255], [255, 128, 0]])


def test_points_are_drawn_at_their_cells() -> None:
    grid = OccupancyGrid(np.zeros((100, 200), np.float32), 0.5, Pose(10.0, 20.0))
    picture = MapPicture(grid)
    picture.points(np.array([[60.25, 45.25]]), RED)  # column 100, row 50 from below
    rows, columns = np.nonzero((pixels(picture) == RED).all(axis=2))
    assert abs(columns.mean() - 100) < 1.0
    assert abs(rows.mean() - 49) < 1.0
    assert len(rows) == MIN_LINE_WIDTH**2


def test_points_can_be_seen_on_a_huge_map() -> None:
    picture = MapPicture(OccupancyGrid(np.zeros((100, 4000), np.float32), 0.05, Pose()))
    picture.points(np.array([[100.0, 2.5]]), RED)
    assert (pixels(picture) == RED).all(axis=2).sum() == 100  # 10 × 10, a four-hundredth of the width


def test_a_small_map_is_enlarged_to_the_width_of_its_legend() -> None:
    picture = MapPicture(GRID, is_enlarged=True)
    height = pixels(picture).shape[0]
    picture.add_legend([LegendEntry("trajectory", RED)])
    drawn = pixels(picture)
    assert drawn.shape[1] == MIN_WIDTH
    assert drawn.shape[0] > height
    assert (drawn[height:] == RED).all(axis=2).any()


def test_a_legend_that_is_too_long_is_broken_into_rows_below_the_map() -> None:
    one, many = (MapPicture(GRID, is_enlarged=True) for _ in range(2))
    one.add_legend([LegendEntry("trajectory", RED)])
    before = pixels(many)
    many.add_legend(
        [LegendEntry(f"a trajectory, number {number}", RED, symbol) for number in range(3) for symbol in Symbol]
    )
    drawn, height = pixels(many), len(before)
    assert len(drawn) - height > 2 * (len(pixels(one)) - height)
    np.testing.assert_array_equal(drawn[:height], before)  # no text on the map
    assert (drawn[height:, [0, -1]] == 255).all()  # nothing is cut off at the sides
    assert (drawn[-1] == 255).all()


@pytest.mark.parametrize(("resolution", "columns", "metres"), [(0.05, 40, 0.2), (0.05, 800, 5), (0.05, 8000, 50)])
def test_the_scale_bar_has_the_length_that_it_states(resolution: float, columns: int, metres: float) -> None:
    grid = OccupancyGrid(np.zeros((40, columns), np.float32), resolution, Pose())
    picture = MapPicture(grid, is_enlarged=True)
    height, width = pixels(picture).shape[:2]
    picture.add_legend([])
    is_black = (pixels(picture)[height:] < 40).all(axis=2)
    longest = max(len(list(run)) for row in is_black for black, run in groupby(row.tolist()) if black)
    text_stroke = width * STROKE_SHARE / 60 + 3
    assert longest == pytest.approx(metres / resolution * width / columns, abs=text_stroke)


def test_rings_and_discs_mark_points() -> None:
    grid = OccupancyGrid(np.full((480, 480), 0.5, np.float32), 0.05, Pose())
    for symbol, centre in ((Symbol.RING, (255, 255, 255)), (Symbol.DISC, RED)):
        picture = MapPicture(grid)
        picture.marker(np.array([12.0, 6.0]), RED, symbol)
        drawn = pixels(picture)
        assert tuple(drawn[480 - 120, 240]) == centre
        assert (drawn == RED).all(axis=2).any()
