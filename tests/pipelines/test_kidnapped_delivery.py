"""A robot that is kidnapped during a delivery recovers and delivers all boxes."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.floorplan.generation import place_boxes
from wherry.floorplan.world_files import find_world
from wherry.pipelines.delivery.agent import DeliveryEpisode, delivery_learner
from wherry.realization.mission import Mission, order_from_plan
from wherry.simulation import build
from wherry.simulation.faults import kidnap, random_pose
from wherry.trace.records import Narration, Phase, Record


@pytest.mark.slow
@pytest.mark.parametrize("has_load", [False, True], ids=["empty", "with a box in its fork"])
def test_a_kidnapped_robot_is_localized_again_and_delivers_all_boxes(*, has_load: bool) -> None:
    plan = place_boxes(find_world("small"), 2, np.random.default_rng(0))
    simulation, records = build(plan, np.random.default_rng(1)), list[Record]()
    mission = Mission(simulation.robot, order_from_plan(plan), records.append, np.random.default_rng(2))
    world = mission.explore()
    is_kidnapped = False
    for step in DeliveryEpisode(world, delivery_learner("doormax"), records.append, np.random.default_rng(3)):
        held = any(box.in_bot for box in step.transition.next_state.of_class("Box"))
        if not is_kidnapped and held == has_load:
            true = simulation.referee.pose
            rng = np.random.default_rng(4)
            while (pose := random_pose(simulation, rng)).distance_to(true) < 1.0:
                pass  # too near to make the robot lost
            kidnap(simulation, pose)
            is_kidnapped = True
    narrated = [record.text for record in records if isinstance(record, Narration) and record.phase is Phase.LOCALIZE]
    assert is_kidnapped
    assert world.environment.pilot.times_lost >= 1
    assert "I am localized again." in narrated
    assert simulation.referee.delivered == 2
    assert world.environment.remaining == 0
