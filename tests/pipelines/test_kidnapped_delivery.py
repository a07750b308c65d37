"""A robot that is carried off while it delivers stops, finds out where it is, and delivers everything all the same."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.floorplan.generation import place_boxes
from wherry.floorplan.world_files import find_world
from wherry.pipelines.delivery.agent import Delivery, delivery_learner
from wherry.realization.mission import Mission, order_from_plan
from wherry.simulation import build
from wherry.simulation.faults import kidnap, random_pose
from wherry.trace.records import Record, Said


@pytest.mark.slow
@pytest.mark.parametrize("loaded", [False, True], ids=["empty", "with a box in its fork"])
def test_carried_off_in_mid_delivery(*, loaded: bool) -> None:
    plan = place_boxes(find_world("small"), 2, np.random.default_rng(0))
    simulation, records = build(plan, np.random.default_rng(1)), list[Record]()
    mission = Mission(simulation.robot, order_from_plan(plan), records.append, np.random.default_rng(2))
    ready = mission.explore()
    carried_off = False
    for step in Delivery(ready, delivery_learner("doormax"), records.append, np.random.default_rng(3)):
        held = any(box.in_bot for box in step.transition.next_state.of_class("Box"))
        if not carried_off and held == loaded:
            true = simulation.referee.pose
            rng = np.random.default_rng(4)
            while (elsewhere := random_pose(simulation, rng)).distance_to(true) < 1.0:
                pass  # not far enough away to be lost
            kidnap(simulation, elsewhere)
            carried_off = True
    said = [record.text for record in records if isinstance(record, Said) and record.phase == "localize"]
    assert carried_off
    assert ready.environment.pilot.times_lost >= 1
    assert "Now I know where I am." in said
    assert simulation.referee.delivered == 2
    assert ready.environment.remaining == 0
