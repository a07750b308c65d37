"""A delivery as the robot sees it: the agent loop, and what is told of it. The same for simulator and ROS.

Nothing here knows a referee; `experiments.delivery` adds one.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wherry.domains.delivery import DROPOFF, PICKUP, DeliverySteps, all_delivered, boxes_left, delivery_domain, reward
from wherry.episodes import GoalAgent, Step, run
from wherry.errors import InputError
from wherry.learning.learners import LEARNERS, RuleLearner
from wherry.learning.rule_files.files import load_rules
from wherry.oomdp.domain import Domain
from wherry.oomdp.objects import State
from wherry.realization.mission import SurveyedWorld
from wherry.robot import Body
from wherry.space.frame import CellFrame
from wherry.trace.records import Began, CellsLaid, Learnt, LearntRule, Perceived, Said, Sink, Stepped, Thing

ANYWHERE = (-1_000_000, 1_000_000)  # bounds of a cell's column or row: the robot does not know how large its world is
MOST_STEPS = 5000  # actions after which a robot that has not delivered everything gives up


def delivery_learner(name: str, rules_file: Path | None = None) -> RuleLearner:
    """Return a learner of the delivery domain that knows nothing, or what a rules file says.

    Args:
        name: A key of `LEARNERS`; the learner in a rules file outranks it.
        rules_file: Learnt rules to begin with.

    Raises:
        InputError: There is no such learner, or the file cannot be used.
    """
    if name not in LEARNERS:
        raise InputError("--learner", name, f"is none of {', '.join(LEARNERS)}")
    domain = delivery_domain(ANYWHERE, ANYWHERE)
    if rules_file is not None:
        return load_rules(rules_file, domain, reward=reward, terminated=all_delivered)
    return LEARNERS[name](domain, reward=reward, terminated=all_delivered)


def beginning(world: str, learner: RuleLearner, body: Body) -> Began:
    """What a sink is told before a robot begins to deliver.

    Args:
        world: What people call the place.
        learner: What it learns with.
        body: The robot's shape.
    """
    domain = learner.domain
    learns_with = type(learner).__name__
    return Began("deliver", world, learns_with, domain.term_names, tuple(domain.actions), body.radius, body.box_radius)


class Delivery:
    """Delivers every box that can be found, learning on the way; iterating over it yields each step when it is done.

    A box may stand in the only way to others, or to the warehouse. So whenever the robot has taken one away, it looks
    at what has come within reach; and when it cannot go on, it picks up a box that stands in its way.

    Args:
        ready: A robot that knows where everything is.
        learner: What it learns with; goes on from what it knows.
        sink: Told what happens.
        rng: Where all randomness comes from.

    Attributes:
        ready: What it knows by now.
    """

    def __init__(self, ready: SurveyedWorld, learner: RuleLearner, sink: Sink, rng: np.random.Generator) -> None:
        self.ready = ready
        self._learner = learner
        self._sink = sink
        self._rng = rng
        self._told: dict[str, int] = {}
        self._steps = 0
        self._gave_up: str | None = None

    def __iter__(self) -> Iterator[Step]:
        """Deliver."""
        environment = self.ready.environment
        self._sink(_cells_laid(self.ready))
        self._tell_rules()
        goes_on = True
        while goes_on:
            agent = GoalAgent(self._learner, boxes_left, DeliverySteps())
            goes_on = bool(environment.remaining) and (yield from self._pursue(agent))
            self._gave_up = agent.gave_up
            goes_on = goes_on or self._looks_further() or (yield from self._clears_the_way())
        self._say("done", _last_words(environment.delivered, environment.remaining, self._gave_up))

    def _looks_further(self) -> bool:
        """See what has come within reach; whether that was anything."""
        further = self.ready.extend_survey()
        if further is None:
            return False
        self.ready = further
        self._sink(_cells_laid(further))
        return True

    def _clears_the_way(self) -> Generator[Step, None, bool]:
        """Pick up a box that has something behind it, and look at that; whether there was such a box."""
        if not self.ready.environment.remaining:
            return False
        for name in self.ready.blocking_boxes():
            self._say("deliver", f"I cannot deliver anything as things stand, but {name} is in my way: I pick it up.")
            if (yield from self._pursue(GoalAgent(self._learner, partial(_not_held, name), detour=0.0))):
                return True
        return False

    def _pursue(self, agent: GoalAgent) -> Generator[Step, None, bool]:
        """Do what an agent decides, until there is nothing more that it can do, or there is more to see.

        What lies behind a box that has just been picked up is looked at before the robot drives there: where the map
        shows nothing, it could not tell where it is.

        Returns:
            Whether it has seen more.
        """
        environment = self.ready.environment
        for step in run(environment, agent, self._rng, max_steps=MOST_STEPS - self._steps):
            self._steps += 1
            now = environment.pilot.time
            self._sink(
                Stepped(
                    time=now,
                    condition=str(step.condition),
                    action=str(step.action),
                    learning=step.learning,
                    moved=not step.transition.failed,
                    unknown=step.unknown,
                    delivered=environment.delivered,
                    remaining=environment.remaining,
                    plan=_centres(agent.plan, self.ready.frame),
                )
            )
            self._sink(perceived(self._learner.domain, step.transition.next_state, now))
            self._tell_rules()
            _comment(step, now, self._sink)
            yield step
            if step.action == PICKUP and not step.transition.failed and self._looks_further():
                return True
        return False

    def _tell_rules(self) -> None:
        """Tell what is believed, if that has changed."""
        if self._told != self._learner.revisions:
            self._sink(learnt(self._learner, self.ready.environment.pilot.time))
            self._told = dict(self._learner.revisions)

    def _say(self, phase: str, text: str) -> None:
        self._sink(Said(self.ready.environment.pilot.time, phase, text))


def _not_held(name: str, state: State) -> int:
    """0 once the robot holds a box, or has delivered it."""
    box = state.get(name)
    return int(box is not None and not box.in_bot)


def _last_words(delivered: int, left: int, why: str | None) -> str:
    """What is said at the end.

    Args:
        delivered: How many boxes were.
        left: How many boxes were not.
        why: Why the agent stopped; None where it was stopped after `MOST_STEPS`.
    """
    if left:
        return f"I give up: I cannot deliver {left} of the boxes ({why or f'not in {MOST_STEPS:,} actions'})."
    return "Everything is delivered." if delivered else "There is nothing to deliver that I could find."


def _cells_laid(ready: SurveyedWorld) -> CellsLaid:
    """Where the cells lie on the robot's map."""
    site = ready.environment.site
    warehouse = np.array([(cell.x, cell.y) for cell in sorted(site.warehouse)], np.int32).reshape(-1, 2)
    walls = [(wall.cell.x, wall.cell.y, wall.north) for wall in sorted(site.walls)]
    return CellsLaid(ready.environment.pilot.time, ready.frame, warehouse, np.array(walls, np.int32).reshape(-1, 3))


def perceived(domain: Domain, state: State, now: float) -> Perceived:
    """A state's condition and the objects that change, as a record."""
    things = (
        Thing(item.object_class.name, item.name, tuple(zip(item.object_class.positions, item.values, strict=True)))
        for item in state.objects
    )
    return Perceived(now, str(domain.cond(state)), tuple(things))


def learnt(learner: RuleLearner, now: float) -> Learnt:
    """What is believed, as a record."""
    rules = tuple(LearntRule(rule.action, str(rule.condition), rule.effect) for rule in learner.rules())
    failures = learner.failure_conditions().items()
    return Learnt(now, rules, tuple((action, tuple(map(str, conditions))) for action, conditions in failures))


def _centres(states: Sequence[State], frame: CellFrame) -> NDArray[np.float32]:
    """[M, 2] m, map frame: the cells that the robot is in in a row of states."""
    robots = [state["robot"] for state in states]
    return np.array([frame.centre(robot.x, robot.y) for robot in robots], np.float32).reshape(-1, 2)


def _comment(step: Step, now: float, sink: Sink) -> None:
    """Say what is worth saying of a step."""
    phase = "learn" if step.learning else "deliver"
    if step.surprise:
        sink(Said(now, phase, f"{step.action} did not do what I expected in {step.condition}: I learn from it."))
    if step.transition.failed or step.action not in (PICKUP, DROPOFF):
        return
    before = {box.name for box in step.state.of_class("Box")}
    after = step.transition.next_state.of_class("Box")
    if step.action == PICKUP:
        held = next(box.name for box in after if box.in_bot)
        sink(Said(now, phase, f"My latch holds {held}."))
    else:
        gone = ", ".join(sorted(before - {box.name for box in after}))
        sink(Said(now, phase, f"The warehouse has taken in {gone}; {len(after)} left."))
