"""The narration of a delivery episode on a grid world in place of a robot."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from wherry.domains.delivery import PICKUP, BoxState, DeliverySite, boxes_left, delivery_transition
from wherry.floorplan.plan import Cell
from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import DeterministicMdp, Transition
from wherry.oomdp.objects import State
from wherry.pipelines.delivery import agent
from wherry.pipelines.delivery.agent import DeliveryEpisode, delivery_learner
from wherry.realization.mission import SurveyedWorld
from wherry.space.frame import CellFrame
from wherry.space.pose import IDENTITY
from wherry.trace.records import Narration, Phase, Record


class CorridorEnvironment(DeterministicMdp):
    """A corridor of three cells with a box at its end; the latch may be is_broken."""

    def __init__(self, *, is_broken: bool) -> None:
        self.site = DeliverySite.of_cells([Cell(x, 0) for x in range(3)], [], [Cell(0, 0)])
        self.pilot = SimpleNamespace(time=0.0)

        def outcome(state: State, action: Action) -> Transition:
            if is_broken and action == PICKUP:
                return Transition(state, action, state, -10.0, terminated=False)
            return delivery_transition(state, action)

        super().__init__(
            self.site.domain, outcome, lambda rng: self.site.state(Cell(1, 0), [BoxState("box", Cell(2, 0))])
        )
        self.reset(np.random.default_rng(0))

    @property
    def remaining(self) -> int:
        return boxes_left(self.state)

    @property
    def delivered(self) -> int:
        return 1 - self.remaining


def narration(*, is_broken: bool, blocking: tuple[str, ...] = ()) -> list[Narration]:
    world = SurveyedWorld(
        CorridorEnvironment(is_broken=is_broken),
        grid=None,
        frame=CellFrame(IDENTITY, 0.6),
        plan=None,
        extend_survey=lambda: None,
        blocking_boxes=lambda: blocking,
    )
    records: list[Record] = []
    for _ in DeliveryEpisode(world, delivery_learner("bayes"), records.append, np.random.default_rng(0)):
        pass
    return [record for record in records if isinstance(record, Narration)]


def final_narration(*, is_broken: bool) -> str:
    last = narration(is_broken=is_broken)[-1]
    assert last.phase is Phase.DONE
    return last.text


def test_a_complete_delivery_is_announced() -> None:
    assert final_narration(is_broken=False) == "All boxes are delivered."


def test_giving_up_states_the_reason() -> None:
    assert final_narration(is_broken=True) == (
        "I give up: I cannot deliver 1 box (1 left to do, and no plan for it is known or can be learnt)."
    )


def test_giving_up_after_too_many_actions_is_stated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(agent, "MAX_ACTIONS", 2)
    assert final_narration(is_broken=True) == "I give up: I cannot deliver 1 box (not within 2 actions)."


def test_a_blocking_box_is_picked_up_before_giving_up() -> None:
    narrated = [record.text for record in narration(is_broken=True, blocking=("box",))]
    assert narrated[-2] == "I cannot deliver any box now, but box blocks my way: I pick it up."
    assert narrated[-1].startswith("I give up")
    assert not any("blocks my way" in record.text for record in narration(is_broken=False, blocking=("box",)))
