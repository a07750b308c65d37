"""A delivery on the map of another world ends early with one line that says so, and without a collision."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.floorplan.world_files import find_world
from wherry.localization.agreement import ScanAgreement
from wherry.localization.fit import MapFit
from wherry.realization import surveyor
from wherry.realization.mission import Mission, order_from_plan
from wherry.realization.pose_estimators import FIT_MIN_SCANS, check_fit
from wherry.simulation import build
from wherry.simulation.ground_truth import true_map
from wherry.space.occupancy import OccupancyGrid
from wherry_testing.perfect_worlds import perfect_map

MAX_SECONDS = 600.0  # s, robot's clock


@pytest.mark.parametrize(
    ("world", "map_world"), [("rooms", "small"), pytest.param("small", "offices", marks=pytest.mark.slow)]
)
def test_a_robot_gives_up_on_the_map_of_another_world(world: str, map_world: str) -> None:
    simulation = build(find_world(world), np.random.default_rng(1))
    times: list[float] = []
    order = order_from_plan(find_world(world))
    mission = Mission(
        simulation.robot, order, lambda record: times.append(getattr(record, "time", 0.0)), np.random.default_rng(2)
    )
    with pytest.raises(InputError, match="map: does not fit what the lidar sees"):
        mission.localize(true_map(find_world(map_world)))
    assert max(times) < MAX_SECONDS
    assert not simulation.referee.collisions


def test_a_map_is_judged_only_after_enough_scans() -> None:
    fit = MapFit()
    for _ in range(FIT_MIN_SCANS - 1):
        fit = fit.with_scan(ScanAgreement(0.3, 0.3, 0.4, 0.0, -2.0, 100))
    check_fit(fit)
    with pytest.raises(InputError, match="does not fit"):
        check_fit(fit.with_scan(ScanAgreement(0.3, 0.3, 0.4, 0.0, -2.0, 100)))


def test_a_map_with_a_room_that_is_not_there_is_given_up_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    timeout = 5.0
    monkeypatch.setattr(surveyor, "SEARCH_TIMEOUT", timeout)
    plan = find_world("small")
    simulation = build(plan, np.random.default_rng(1))
    times: list[float] = []
    mission = Mission(
        simulation.robot,
        order_from_plan(plan),
        lambda record: times.append(getattr(record, "time", 0.0)),
        np.random.default_rng(2),
    )
    with pytest.raises(InputError, match="it shows free space that was not reached in 15 s"):
        mission.localize(with_annex(perfect_map(plan)))
    assert max(times) < 120.0
    assert not simulation.referee.collisions


def with_annex(grid: OccupancyGrid) -> OccupancyGrid:
    """A map with a free room behind its right wall, and an opening to it."""
    rows, columns = np.nonzero(grid.occupied)
    bottom, top, right = rows.min(), rows.max(), columns.max()
    probability = np.pad(grid.probability, ((0, 0), (0, 48)), constant_values=0.5)
    probability[bottom : top + 1, right + 1 : right + 46] = 0.0
    probability[bottom : top + 1, right + 46] = 1.0
    probability[[bottom, top], right : right + 46] = 1.0
    probability[bottom + 25 : bottom + 49, right - 1 : right + 1] = 0.0
    return OccupancyGrid(probability, grid.resolution, grid.origin)
