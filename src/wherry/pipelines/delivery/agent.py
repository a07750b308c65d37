"""A delivery episode as the robot experiences it, on the simulator and on ROS alike; nothing here knows a referee."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wherry.domains.delivery import (
    DROPOFF,
    PICKUP,
    DeliveryHeuristic,
    all_delivered,
    boxes_left,
    delivery_domain,
    delivery_reward,
)
from wherry.episodes import GoalAgent, Step, run_episode
from wherry.errors import InputError
from wherry.learning.registry import RULE_LEARNERS, Job, learners_for
from wherry.learning.rule_files.files import load_rules
from wherry.learning.rules import RuleLearner
from wherry.oomdp.conditions import Condition
from wherry.oomdp.objects import State
from wherry.pipelines.records import learnt_model, perceived_state
from wherry.realization.mission import SurveyedWorld
from wherry.robot import Body
from wherry.space.frame import CellFrame
from wherry.trace.records import CellLayout, Narration, Phase, RunStarted, Sink, StepTaken

UNBOUNDED = (-1_000_000, 1_000_000)  # smallest and largest column or row while the size of the world is unknown
MAX_ACTIONS = 5000  # actions after which a robot gives up


def delivery_learner(name: str, rules_file: Path | None = None) -> RuleLearner:
    """Make a learner of the delivery domain, without knowledge or with that of a rules file.

    Args:
        name: Name of a registered learner that can deliver; the learner in a rules file takes precedence.
        rules_file: Learnt rules to start with.

    Raises:
        InputError: There is no such learner, or the file cannot be used.
    """
    learners = learners_for(Job.DELIVERY, RULE_LEARNERS)
    if name not in learners:
        raise InputError("--learner", name, f"is none of {', '.join(learners)}")
    domain = delivery_domain(UNBOUNDED, UNBOUNDED)
    if rules_file is not None:
        return load_rules(rules_file, domain, reward=delivery_reward, terminated=all_delivered)
    return learners[name].factory(domain, reward=delivery_reward, terminated=all_delivered)


def run_started(world: str, learner: RuleLearner, body: Body) -> RunStarted:
    """The first record of a delivery.

    Args:
        world: Name of the world.
        learner: The robot's learner.
        body: The robot's shape.
    """
    domain, name = learner.domain, type(learner).__name__
    return RunStarted("deliver", world, name, domain.term_names, tuple(domain.actions), body.radius, body.box_radius)


class DeliveryEpisode:
    """Delivers every box that can be found, and learns from each action; iterating yields each step once it is done.

    A box may block the way to other boxes or to the warehouse. The robot therefore extends its survey whenever it has
    picked up a box, and picks up a box that blocks its way when nothing else can be delivered.

    Args:
        world: What the robot knows after its survey.
        learner: The robot's learner, whose knowledge is extended.
        sink: Called with records of each step.
        rng: Source of all randomness.

    Attributes:
        world: What the robot knows after its last survey.
    """

    def __init__(self, world: SurveyedWorld, learner: RuleLearner, sink: Sink, rng: np.random.Generator) -> None:
        self.world = world
        self._learner = learner
        self._sink = sink
        self._rng = rng
        self._recorded_revisions: dict[str, int] = {}
        self._actions = 0
        self._gave_up: str | None = None

    def __iter__(self) -> Iterator[Step]:
        """Deliver until nothing more can be delivered, observed or moved out of the way."""
        environment = self.world.environment
        self._sink(_cell_layout(self.world))
        self._record_learnt_model()
        can_continue = True
        while can_continue:
            agent = GoalAgent(self._learner, boxes_left, DeliveryHeuristic())
            has_more = bool(environment.remaining) and (yield from self._pursue_goal(agent))
            self._gave_up = agent.failure_reason
            can_continue = has_more or self._extend_survey() or (yield from self._pick_up_blocking_box())
        self._say(Phase.DONE, _final_words(environment.delivered, environment.remaining, self._gave_up))

    def _extend_survey(self) -> bool:
        """Survey what has become reachable; return whether anything has."""
        extended = self.world.extend_survey()
        if extended is None:
            return False
        self.world = extended
        self._sink(_cell_layout(extended))
        return True

    def _pick_up_blocking_box(self) -> Generator[Step, None, bool]:
        """Pick up a box that blocks the way, and survey what lies behind it; return whether there was such a box."""
        if not self.world.environment.remaining:
            return False
        for name in self.world.blocking_boxes():
            self._say(Phase.DELIVER, f"I cannot deliver any box now, but {name} blocks my way: I pick it up.")
            if (yield from self._pursue_goal(GoalAgent(self._learner, partial(_not_held, name), max_detour_cost=0.0))):
                return True
        return False

    def _pursue_goal(self, agent: GoalAgent) -> Generator[Step, None, bool]:
        """Execute an agent's decisions until it has no more, or until the survey was extended.

        What lies behind a box that was picked up is surveyed before the robot drives there, since it cannot be
        localized where the map is unknown.

        Returns:
            Whether the survey was extended.
        """
        environment = self.world.environment
        for step in run_episode(environment, agent, self._rng, max_steps=MAX_ACTIONS - self._actions):
            self._actions += 1
            self._record_step(step, agent.plan)
            yield step
            if step.action == PICKUP and not step.transition.failed and self._extend_survey():
                return True
        return False

    def _record_step(self, step: Step, plan: Sequence[State]) -> None:
        """Hand the records of a step to the sink."""
        environment = self.world.environment
        time = environment.pilot.time
        self._sink(
            StepTaken(
                time=time,
                condition=str(step.condition),
                action=str(step.action),
                is_learning=step.is_learning,
                has_effect=not step.transition.failed,
                unknown_pairs=step.unknown_pairs,
                delivered=environment.delivered,
                remaining=environment.remaining,
                plan=_cell_centres(plan, self.world.frame),
            )
        )
        self._sink(perceived_state(self._learner.domain, step.transition.next_state, time))
        self._record_learnt_model()
        self._narrate(step)

    def _record_learnt_model(self) -> None:
        """Hand the learnt model to the sink if it has changed since the last time."""
        if self._recorded_revisions != self._learner.revisions:
            self._sink(learnt_model(self._learner, self.world.environment.pilot.time))
            self._recorded_revisions = dict(self._learner.revisions)

    def _narrate(self, step: Step) -> None:
        """Narrate a surprise, a pick-up or a delivery."""
        phase = Phase.LEARN if step.is_learning else Phase.DELIVER
        if step.is_surprise:
            terms = _true_terms(step.condition, self._learner.domain.term_names)
            self._say(phase, f"{step.action} had an unexpected outcome while {terms}: I learn from it.")
        if step.transition.failed or step.action not in (PICKUP, DROPOFF):
            return
        before = {box.name for box in step.state.of_class("Box")}
        after = step.transition.next_state.of_class("Box")
        if step.action == PICKUP:
            held = next(box.name for box in after if box.in_bot)
            self._say(phase, f"I picked up {held}.")
        else:
            delivered = ", ".join(sorted(before - {box.name for box in after}))
            self._say(phase, f"I delivered {delivered}; {len(after)} left.")

    def _say(self, phase: Phase, text: str) -> None:
        self._sink(Narration(self.world.environment.pilot.time, phase, text))


def _true_terms(condition: Condition, names: Sequence[str]) -> str:
    """The terms that are true under a condition cond(s), in words: "touch_N(robot, wall) was true"."""
    true = [name for name, bit in zip(names, str(condition), strict=True) if bit == "1"]
    return f"{' and '.join(true) or 'no term'} {'were' if len(true) > 1 else 'was'} true"


def _not_held(name: str, state: State) -> int:
    """0 once the robot holds a box or has delivered it, else 1."""
    box = state.get(name)
    return int(box is not None and not box.in_bot)


def _final_words(delivered: int, remaining: int, reason: str | None) -> str:
    """The last narration of an episode.

    Args:
        delivered: Number of boxes delivered.
        remaining: Number of boxes found but not delivered.
        reason: Why the agent gave up; None if it was stopped after `MAX_ACTIONS`.
    """
    if remaining:
        boxes = "1 box" if remaining == 1 else f"{remaining} boxes"
        return f"I give up: I cannot deliver {boxes} ({reason or f'not within {MAX_ACTIONS:,} actions'})."
    return "All boxes are delivered." if delivered else "I found no boxes to deliver."


def _cell_layout(world: SurveyedWorld) -> CellLayout:
    """The record of the cells on the robot's map."""
    site = world.environment.site
    warehouse = np.array([(cell.x, cell.y) for cell in sorted(site.warehouse)], np.int32).reshape(-1, 2)
    walls = [(wall.cell.x, wall.cell.y, wall.north) for wall in sorted(site.walls)]
    return CellLayout(world.environment.pilot.time, world.frame, warehouse, np.array(walls, np.int32).reshape(-1, 3))


def _cell_centres(states: Sequence[State], frame: CellFrame) -> NDArray[np.float32]:
    """[M, 2] centres of the robot's cells in a sequence of states, m, map frame."""
    robots = [state["robot"] for state in states]
    return np.array([frame.centre(robot.x, robot.y) for robot in robots], np.float32).reshape(-1, 2)
