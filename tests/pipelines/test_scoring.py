"""The referee's arithmetic, on cases whose answers are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wherry.floorplan.plan import Cell
from wherry.floorplan.world_files import parse_world
from wherry.pipelines.delivery.score import align, position_errors, root_mean_square, shortest_delivery
from wherry.space.pose import Pose

poses = st.builds(Pose, st.floats(-20, 20), st.floats(-20, 20), st.floats(-math.pi, math.pi))


@given(st.lists(poses, min_size=1, max_size=8), poses)
def test_alignment_finds_the_motion_that_was_applied(estimated: list[Pose], motion: Pose) -> None:
    true = [motion @ pose for pose in estimated]
    errors = position_errors(estimated, true, align(estimated, true))
    assert np.max(errors) < 1e-6


def test_errors_remain_that_no_motion_explains() -> None:
    estimated = [Pose(0, 0), Pose(1, 0), Pose(2, 0)]
    true = [Pose(0, 0.1), Pose(1, -0.2), Pose(2, 0.1)]  # neither shifted nor turned
    errors = position_errors(estimated, true, align(estimated, true))
    assert root_mean_square(errors) == pytest.approx(math.sqrt((0.01 + 0.04 + 0.01) / 3))


CORRIDOR = """wherry-world: 1
name: corridor
cell: 0.6

+---+---+---+---+---+
| w   >   o       o |
+---+---+---+---+---+
"""


def test_shortest_delivery_in_a_corridor() -> None:
    plan = parse_world(CORRIDOR, "corridor")
    # To the near box and back, then to the far one and back: with a load the robot cannot pass a box.
    assert shortest_delivery(plan, Cell(1, 0), [Cell(2, 0), Cell(4, 0)], has_load=False) == 1 + 2 + 4 + 4
    assert shortest_delivery(plan, Cell(4, 0), [Cell(4, 0)], has_load=False) == 4
    assert shortest_delivery(plan, Cell(4, 0), [], has_load=True) == 4
    assert shortest_delivery(plan, Cell(0, 0), [], has_load=True) == 0


def test_a_robot_behind_a_box_with_a_full_fork_cannot_deliver() -> None:
    plan = parse_world(CORRIDOR, "corridor")
    assert shortest_delivery(plan, Cell(4, 0), [Cell(2, 0)], has_load=True) is None
