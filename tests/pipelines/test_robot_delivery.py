"""What is told of a delivery by whoever delivers, robot or grid."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from wherry.domains.delivery import PICKUP, Box, Site, boxes_left, transition
from wherry.floorplan.plan import Cell
from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import DeterministicMdp, Transition
from wherry.oomdp.objects import State
from wherry.pipelines.delivery import agent as robot_delivery
from wherry.pipelines.delivery.agent import Delivery, delivery_learner
from wherry.realization.mission import SurveyedWorld
from wherry.space.frame import CellFrame
from wherry.space.pose import IDENTITY
from wherry.trace.records import Record, Said


class Grid(DeterministicMdp):
    """A corridor of three cells with a box at its end, instead of a robot; its latch may be broken."""

    def __init__(self, *, broken: bool) -> None:
        self.site = Site.of_cells([Cell(x, 0) for x in range(3)], [], [Cell(0, 0)])
        self.pilot = SimpleNamespace(time=0.0)

        def outcome(state: State, action: Action) -> Transition:
            if broken and action == PICKUP:
                return Transition(state, action, state, -10.0, terminated=False)
            return transition(state, action)

        super().__init__(self.site.domain, outcome, lambda rng: self.site.state(Cell(1, 0), [Box("box", Cell(2, 0))]))
        self.reset(np.random.default_rng(0))

    @property
    def remaining(self) -> int:
        return boxes_left(self.state)

    @property
    def delivered(self) -> int:
        return 1 - self.remaining


def words(*, broken: bool, in_the_way: tuple[str, ...] = ()) -> list[Said]:
    ready = SurveyedWorld(
        Grid(broken=broken),
        grid=None,
        frame=CellFrame(IDENTITY, 0.6),
        plan=None,
        look_further=lambda: None,
        in_the_way=lambda: in_the_way,
    )
    told: list[Record] = []
    for _ in Delivery(ready, delivery_learner("bayes"), told.append, np.random.default_rng(0)):
        pass
    return [record for record in told if isinstance(record, Said)]


def last_words(*, broken: bool) -> str:
    last = words(broken=broken)[-1]
    assert last.phase == "done"
    return last.text


def test_the_end_is_told() -> None:
    assert last_words(broken=False) == "Everything is delivered."


def test_who_gives_up_says_why() -> None:
    assert last_words(broken=True) == (
        "I give up: I cannot deliver 1 of the boxes (1 left to do, and no way to do it is known or can be found out)."
    )


def test_who_needs_too_many_actions_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_delivery, "MOST_STEPS", 2)
    assert last_words(broken=True) == "I give up: I cannot deliver 1 of the boxes (not in 2 actions)."


def test_what_is_in_the_way_is_picked_up_before_anyone_gives_up() -> None:
    said = [record.text for record in words(broken=True, in_the_way=("box",))]
    assert said[-2] == "I cannot deliver anything as things stand, but box is in my way: I pick it up."
    assert said[-1].startswith("I give up")
    assert not any("in my way" in record.text for record in words(broken=False, in_the_way=("box",)))
