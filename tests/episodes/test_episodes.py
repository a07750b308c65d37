"""The agent loop and its agents: they learn, complete their task, tolerate slips, and always terminate."""

from __future__ import annotations

import runpy
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wherry.domains.delivery import (
    BoxState,
    DeliveryHeuristic,
    DeliverySite,
    all_delivered,
    boxes_left,
    delivery_grid,
    delivery_reward,
    delivery_transition,
)
from wherry.domains.taxi import taxi_grid
from wherry.episodes import GoalAgent, PolicyAgent, Step, run_episode
from wherry.floorplan.plan import Cell, FloorPlan
from wherry.floorplan.world_files import built_in_worlds, find_world
from wherry.learning.doormax import Doormax, FailureScope
from wherry.learning.registry import RULE_LEARNERS, Job, learners_for
from wherry.learning.rule_files.files import load_rules, save_rules
from wherry.learning.rules import RuleLearner
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import DeterministicMdp, Environment, Transition
from wherry.oomdp.objects import State
from wherry.planning.value_iteration import ValueIteration

BOXES = {"small": 2, "taxi": 2}


def new_learner(name: str, domain: Domain) -> RuleLearner:
    return RULE_LEARNERS[name].factory(domain, reward=delivery_reward, terminated=all_delivered)


def deliver(environment: Environment, learner: RuleLearner, seed: int, max_steps: int = 1000) -> list[Step]:
    agent = GoalAgent(learner, boxes_left, DeliveryHeuristic())
    return list(run_episode(environment, agent, np.random.default_rng(seed), max_steps=max_steps))


def grid(world: str) -> DeterministicMdp:
    return delivery_grid(find_world(world), BOXES.get(world, 4))


def boxes_after_learning(steps: list[Step]) -> int:
    """Number of boxes left after the last step that was exploration or a surprise."""
    last = max(step.number for step in steps if step.is_learning)
    return boxes_left(steps[last - 1].transition.next_state)


@pytest.mark.parametrize("seed", range(3))
def test_agent_without_knowledge_delivers_everything(seed: int) -> None:
    steps = deliver(grid("rooms"), new_learner("bayes", grid("rooms").domain), seed)
    assert steps[-1].transition.terminated
    assert boxes_left(steps[-1].transition.next_state) == 0
    assert boxes_after_learning(steps) == 3  # the first delivery completes the rules
    assert sum(step.is_learning for step in steps) <= 100
    assert not any(step.is_surprise for step in steps if not step.is_exploring)


def test_doormax_delivers_everything() -> None:
    steps = deliver(grid("small"), new_learner("doormax", grid("small").domain), seed=0)
    assert boxes_left(steps[-1].transition.next_state) == 0


def test_plan_after_learning_is_the_shortest() -> None:
    environment = grid("rooms")
    learner = new_learner("bayes", environment.domain)
    deliver(environment, learner, seed=0)
    steps = deliver(environment, learner, seed=7)
    assert len(steps) == DeliveryHeuristic()(steps[0].state)  # a lower bound
    assert not any(step.is_learning for step in steps)


@pytest.mark.parametrize(
    "world",
    [world if world in BOXES else pytest.param(world, marks=pytest.mark.slow) for world in built_in_worlds()],
)
def test_rules_of_any_world_suffice_in_every_other(world: str, tmp_path: Path) -> None:
    environment = grid(world)
    learner = new_learner("bayes", environment.domain)
    deliver(environment, learner, seed=1)
    save_rules(learner, tmp_path / "rules.json")
    for other in built_in_worlds():
        elsewhere = grid(other)
        loaded = load_rules(tmp_path / "rules.json", elsewhere.domain, reward=delivery_reward, terminated=all_delivered)
        steps = deliver(elsewhere, loaded, seed=2)
        assert boxes_left(steps[-1].transition.next_state) == 0
        assert sum(step.is_learning for step in steps) == 0, other


class Slippery:
    """A grid on which actions sometimes have no effect."""

    def __init__(self, environment: DeterministicMdp, chance: float, seed: int) -> None:
        self.environment = environment
        self.domain = environment.domain
        self.chance = chance
        self.rng = np.random.default_rng(seed)

    def reset(self, rng: np.random.Generator) -> State:
        return self.environment.reset(rng)

    def step(self, action: Action) -> Transition:
        state = self.environment.state
        assert state is not None
        if self.rng.random() < self.chance:
            return Transition(state, action, state, delivery_reward(state, action, state), False)
        return self.environment.step(action)


@pytest.mark.parametrize("seed", range(2))
def test_agent_tolerates_slips(seed: int) -> None:
    environment = Slippery(grid("rooms"), 0.05, seed)
    learner = new_learner("bayes", environment.domain)
    steps = list(
        run_episode(
            environment, GoalAgent(learner, boxes_left, DeliveryHeuristic()), np.random.default_rng(seed), max_steps=800
        )
    )
    assert boxes_left(steps[-1].transition.next_state) == 0
    assert any(step.is_surprise for step in steps)


@pytest.mark.parametrize("name", learners_for(Job.DELIVERY, RULE_LEARNERS))
def test_unreachable_box_is_left_and_all_others_are_delivered(name: str) -> None:
    obstacles = frozenset({Cell(5, 0), Cell(5, 1), Cell(5, 2)})
    plan = FloorPlan("plan", 7, 3, obstacles=obstacles, warehouse=frozenset({Cell(0, 0)}), start=Cell(1, 1))
    environment = delivery_grid(plan.with_boxes([Cell(3, 1), Cell(6, 1), Cell(4, 2)]))
    steps = deliver(environment, new_learner(name, environment.domain), seed=0, max_steps=1000)
    final = steps[-1].transition.next_state
    assert [(box.x, box.y) for box in final.of_class("Box")] == [(6, 1)]
    assert len(steps) < 1000  # the agent stopped before the limit


class HiddenObstacle(DeterministicMdp):
    """A grid with an invisible obstacle between the second and the third cell."""

    def __init__(self, environment: DeterministicMdp) -> None:
        super().__init__(environment.domain, self._blocked, environment.draw_initial_state)

    def _blocked(self, state: State, action: Action) -> Transition:
        transition = delivery_transition(state, action)
        robots = state["robot"], transition.next_state["robot"]
        if {(robot.x, robot.y) for robot in robots} == {(1, 0), (2, 0)}:
            return Transition(state, action, state, -1.0, False)
        return transition


@pytest.mark.parametrize("name", learners_for(Job.DELIVERY, RULE_LEARNERS))
def test_action_that_fails_repeatedly_is_not_tried_again(name: str) -> None:
    plan = FloorPlan("plan", 6, 2, warehouse=frozenset({Cell(5, 0)}), start=Cell(5, 1)).with_boxes([Cell(0, 0)])
    environment = delivery_grid(plan)
    learner = new_learner(name, environment.domain)
    for seed in range(3):
        deliver(delivery_grid(plan), learner, seed)
    steps = list(
        run_episode(
            HiddenObstacle(environment),
            GoalAgent(learner, boxes_left, DeliveryHeuristic()),
            np.random.default_rng(0),
            max_steps=400,
        )
    )
    assert len(steps) < 400
    if name == "bayes":  # DOORMAX generalizes the obstacle to a failure condition
        assert boxes_left(steps[-1].transition.next_state) == 0


def test_completed_task_requires_no_step() -> None:
    site = DeliverySite.of_plan(find_world("small"))
    environment = DeterministicMdp(site.domain, delivery_transition, lambda rng: site.state(Cell(0, 0), []))
    agent = GoalAgent(new_learner("bayes", site.domain), boxes_left)
    assert list(run_episode(environment, agent, np.random.default_rng(0))) == []


def test_steps_record_the_episode() -> None:
    plan = FloorPlan("plan", 3, 1, warehouse=frozenset({Cell(0, 0)}), start=Cell(1, 0)).with_boxes([Cell(2, 0)])
    environment = delivery_grid(plan)
    agent = GoalAgent(new_learner("bayes", environment.domain), boxes_left, DeliveryHeuristic())
    steps = list(run_episode(environment, agent, np.random.default_rng(0), max_steps=200))
    assert [step.number for step in steps] == list(range(1, len(steps) + 1))
    assert str(steps[0].condition) == "1100000"
    assert steps[0].is_exploring
    assert steps[0].is_learning
    assert steps[0].unknown_pairs > 0
    assert steps[-1].unknown_pairs == 0
    for earlier, later in pairwise(steps):
        assert earlier.transition.next_state == later.state


def test_plan_is_the_sequence_of_expected_states() -> None:
    plan = FloorPlan("plan", 3, 1, warehouse=frozenset({Cell(0, 0)}), start=Cell(1, 0)).with_boxes([Cell(2, 0)])
    environment = delivery_grid(plan)
    learner = new_learner("bayes", environment.domain)
    deliver(environment, learner, seed=0, max_steps=200)
    agent = GoalAgent(learner, boxes_left, DeliveryHeuristic(), max_detour_cost=0.0)
    decision = agent.decide(environment.reset(np.random.default_rng(0)))
    assert decision is not None
    assert decision.action == Action("E")
    assert [state["robot"].x for state in agent.plan] == [1, 2, 2, 1, 0, 0]


class CorrectedPerception(DeterministicMdp):
    """An environment in which a wall of the initial state is found not to exist just before the first action."""

    def __init__(self) -> None:
        self.truth = DeliverySite.of_cells([Cell(x, 0) for x in range(3)], [], [Cell(0, 0)])
        walled_in = DeliverySite.of_cells([Cell(1, 0)], [], []).walls
        perceived = DeliverySite(
            self.truth.walls | walled_in, self.truth.warehouse, self.truth.x_range, self.truth.y_range
        )
        boxes = [BoxState("box", Cell(2, 0))]
        super().__init__(self.truth.domain, delivery_transition, lambda rng: perceived.state(Cell(1, 0), boxes))

    def step(self, action: Action) -> Transition:
        assert self.state is not None
        if self.state.scene != self.truth.scene:
            robot, boxes = self.state["robot"], self.state.of_class("Box")
            self.state = self.truth.state(
                Cell(robot.x, robot.y), [BoxState(box.name, Cell(box.x, box.y), box.in_bot) for box in boxes]
            )
        return super().step(action)


def test_step_records_the_state_perceived_just_before_the_action() -> None:
    environment = CorrectedPerception()
    agent = GoalAgent(new_learner("bayes", environment.domain), boxes_left)
    first = next(run_episode(environment, agent, np.random.default_rng(0)))
    assert first.state.scene == environment.truth.scene
    assert str(first.condition) == "1100000"


def test_policy_agent_learns_taxi() -> None:
    environment, rng = taxi_grid(5), np.random.default_rng(0)
    learner = Doormax(environment.domain)
    agent = PolicyAgent(learner, ValueIteration(learner))
    lengths = [sum(1 for _ in run_episode(environment, agent, rng, max_steps=100)) for _ in range(40)]
    assert max(lengths[:10]) == 100
    assert max(lengths[-10:]) <= 40


def lights() -> Any:
    """The example of the documentation: an action whose argument is one of three lamps."""
    return runpy.run_path(str(Path(__file__).parents[2] / "docs" / "examples" / "lights.py"))


@pytest.mark.parametrize("scope", ["action", "attribute"])
@pytest.mark.parametrize("seed", range(4))
def test_doormax_reports_the_assumption_that_several_objects_violate(seed: int, scope: FailureScope) -> None:
    """A lamp is unchanged if it is not the argument or is already off; no single failure condition covers both."""
    example = lights()
    learner = Doormax(example["DOMAIN"], failure_scope=scope)
    agent = GoalAgent(learner, example["lit_lamps"])
    environment = DeterministicMdp(example["DOMAIN"], example["transition"], example["initial_state"])
    steps = list(run_episode(environment, agent, np.random.default_rng(seed), max_steps=100))
    assert example["lit_lamps"](steps[-1].transition.next_state) == 0
    assert agent.failure_reason is None
    reported = [violation for violation in learner.violations if violation.startswith("SWITCH_OFF, lamp.lit")]
    assert len(reported) == (scope == "action")


@pytest.mark.parametrize("scope", ["action", "attribute"])
def test_doormax_delivers_two_boxes_with_learnt_rewards(scope: FailureScope) -> None:
    """No term distinguishes the last box, so equal conditions end the episode only sometimes, which is reported."""
    environment = grid("small")
    learner = Doormax(environment.domain, failure_scope=scope)
    agent, rng = PolicyAgent(learner, ValueIteration(learner)), np.random.default_rng(0)
    for _ in range(5):
        steps = list(run_episode(environment, agent, rng, max_steps=2000))
        assert steps[-1].transition.terminated
    assert any(violation.startswith("DROPOFF: the reward, or whether") for violation in learner.violations)


def test_agent_that_stops_early_states_the_reason() -> None:
    """The switch has no effect, and the agent stops when it has been tried under every condition."""
    example = lights()

    def broken(state: State, action: Action) -> Transition:
        transition = example["transition"](state, action)
        return transition if action.name != "SWITCH_OFF" else Transition(state, action, state, -1.0, terminated=False)

    agent = GoalAgent(Doormax(example["DOMAIN"]), example["lit_lamps"])
    environment = DeterministicMdp(example["DOMAIN"], broken, example["initial_state"])
    steps = list(run_episode(environment, agent, np.random.default_rng(0), max_steps=500))
    assert len(steps) < 500
    assert agent.failure_reason == "3 left to do, and no plan for it is known or can be learnt"
