"""One scan finds the robot on the whole map, or all the places where it may be, and says which of the two it is."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.localization.relocalization import Relocalizer, _bordered, _branch_and_bound, _score, _window_maxima
from wherry.robot import Scan
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose, wrap
from wherry_testing.rooms import LIDAR, WALL_THICKNESS, Building, drive

RELOCALIZER = Relocalizer(Building().grid(), LIDAR)


def test_window_maxima_are_maxima_of_windows() -> None:
    values = np.random.default_rng(0).integers(0, 255, (13, 9)).astype(np.uint8)
    levels = _window_maxima(values, 3)
    padded = np.zeros((13 + 4 + 4, 9 + 4 + 4), np.uint8)
    padded[4:17, 4:13] = values
    for level in range(3):
        size = 1 << level
        for row in range(17):
            for column in range(13):
                assert levels[level, row, column] == padded[row : row + size, column : column + size].max()


def test_a_window_bounds_all_that_it_holds() -> None:
    rng = np.random.default_rng(1)
    offsets = rng.integers(-20, 20, (1, 30, 2)).astype(np.int32)
    levels, flat = _bordered(_window_maxima(rng.integers(0, 255, (40, 40)).astype(np.uint8), 4), offsets)
    border, width = (levels.shape[1] - 40) // 2, levels.shape[2]
    for row in range(0, 40, 8):
        for column in range(0, 40, 8):
            place = (border + row) * width + border + column
            bound = _score(levels[3].ravel(), flat[0], place)
            inside = [_score(levels[0].ravel(), flat[0], place + y * width + x) for y in range(8) for x in range(8)]
            assert bound >= max(inside)


@pytest.mark.parametrize("farthest", [5, 20, 100])
def test_beams_that_leave_the_map_score_nothing(farthest: int) -> None:
    rng = np.random.default_rng(2)
    values = rng.integers(1, 255, (30, 17)).astype(np.uint8)
    offsets = rng.integers(-farthest, farthest + 1, (4, 25, 2)).astype(np.int32)
    levels, flat = _bordered(_window_maxima(values, 3), offsets)
    border, width = (levels.shape[1] - 30) // 2, levels.shape[2]
    for row, column in ((0, 0), (29, 16), (0, 16), (29, 0), (14, 8)):
        for heading in range(4):
            ends = offsets[heading] + (row, column)
            on_map = ends[((ends >= 0) & (ends < values.shape)).all(axis=1)]
            expected = values[on_map[:, 0], on_map[:, 1]].sum(dtype=np.int64)
            assert _score(levels[0].ravel(), flat[heading], (border + row) * width + border + column) == expected


def test_the_search_finds_the_best_pose_that_there_is() -> None:
    rng = np.random.default_rng(3)
    for _ in range(5):
        values = (rng.random((40, 50)) < 0.05).astype(np.uint8) * 255
        free = rng.random((40, 50)) < 0.7
        offsets = rng.integers(-15, 16, (6, 20, 2)).astype(np.int32)
        levels, flat = _bordered(_window_maxima(values, 4), offsets)
        border, width = (levels.shape[1] - 40) // 2, levels.shape[2]
        every = {
            (heading, row, column): _score(levels[0].ravel(), flat[heading], (border + row) * width + border + column)
            for heading in range(6)
            for row, column in np.argwhere(free).tolist()
        }
        open_windows = np.ascontiguousarray(_window_maxima(free.astype(np.uint8), 4)[:, 8:, 8:])
        found, complete = _branch_and_bound(levels, open_windows, flat, np.array([0.8, 3.0, 0.0]))
        best = max(every.values())
        assert complete
        assert every[tuple(found[0].tolist())] == best
        for (heading, row, column), score in every.items():
            near = [h == heading and math.hypot(r - row, c - column) <= 3.0 for h, r, c in found.tolist()]
            assert score < 0.8 * best or any(near)


def test_finds_the_robot_wherever_it_stands() -> None:
    rng = np.random.default_rng(0)
    building = Building(circles=((4.5, 2.7, 0.1), (5.1, 6.3, 0.1), (2.1, 6.3, 0.1)))
    poses = list(drive())[::60]
    found = [RELOCALIZER.search(building.scan(0.0, pose, rng)) for pose in poses]
    errors = [best.hypotheses[0].pose.distance_to(pose) for best, pose in zip(found, poses, strict=True)]
    sure = [not best.ambiguous for best in found]
    assert sum(sure) > 0.9 * len(poses)
    assert all(error < 0.05 for error, certain in zip(errors, sure, strict=True) if certain)


def test_finds_it_on_a_turned_map() -> None:
    origin = Pose(-1.0, 2.0, -0.6)
    truth = Pose(4.5, 2.0, 2.5)
    found = Relocalizer(Building().grid(origin=origin), LIDAR).search(Building().scan(0.0, truth))
    assert found.hypotheses[0].pose.distance_to(truth) < 0.05
    assert abs(wrap(found.hypotheses[0].pose.theta - truth.theta)) < 0.02


def test_two_equal_rooms_are_two_hypotheses() -> None:
    half = WALL_THICKNESS / 2
    walls = [(x - half, 0.0, x + half, 4.0) for x in (0.0, 4.0, 4.8, 8.8)]
    walls += [(x, y - half, x + 4.0, y + half) for x in (0.0, 4.8) for y in (0.0, 4.0)]
    walls += [(x, 1.0, x + 0.5, 1.3) for x in (0.6, 5.4)]  # something that tells the directions apart
    building = Building(rectangles=np.array(walls))
    truth = Pose(2.5, 2.5, 0.8)
    found = Relocalizer(building.grid(), LIDAR).search(building.scan(0.0, truth))
    assert found.ambiguous
    assert found.ambiguity == pytest.approx(0.5, abs=0.2)
    assert sum(hypothesis.probability for hypothesis in found.hypotheses[:2]) > 0.95
    assert sorted(round(hypothesis.pose.x, 1) for hypothesis in found.hypotheses[:2]) == [2.5, 7.3]


def test_hypotheses_are_sorted_and_distinct_and_share_one() -> None:
    found = RELOCALIZER.search(Building().scan(0.0, Pose(0.9, 3.6, 1.0)))
    probabilities = [hypothesis.probability for hypothesis in found.hypotheses]
    assert probabilities == sorted(probabilities, reverse=True)
    assert sum(probabilities) == pytest.approx(1.0)


def test_a_scan_without_readings_could_be_anywhere() -> None:
    scan = Scan(0.0, np.full(360, math.nan), -math.pi, math.tau / 360, 0.05, 12.0)
    found = RELOCALIZER.search(scan)
    assert found.hypotheses == ()
    assert found.ambiguous


def test_a_map_without_free_space_has_no_place() -> None:
    nowhere = OccupancyGrid(np.full((50, 50), 0.5, np.float32), 0.05)
    assert Relocalizer(nowhere, LIDAR).search(Building().scan(0.0, Pose(1.0, 1.0))).hypotheses == ()


def test_an_earlier_scan_confirms_a_place_although_the_wheels_are_wrong_by_a_tenth_of_the_way() -> None:
    earlier, now = Pose(2.7, 0.9, 0.5), Pose(4.5, 2.1, 0.8)
    building = Building()
    (found,) = RELOCALIZER.search(building.scan(1.0, now)).hypotheses[:1]
    assert found.pose.distance_to(now) < 0.05
    true = earlier.relative_to(now)
    reported = Pose(1.1 * true.x, 1.1 * true.y, true.theta + 0.15)
    ends = LIDAR.transform(building.scan(0.0, earlier).points())
    (confirmed,) = RELOCALIZER.confirm([found], [(reported, ends)])
    assert confirmed.agreement.inlier_fraction > 0.95
