"""What was learnt, planned with by Fast Downward: the plan executes in the real world and is as short as can be."""

from __future__ import annotations

import re

import numpy as np
import pytest
from unified_planning.io import PDDLReader
from unified_planning.shortcuts import OneshotPlanner, get_environment

from wherry.domains.delivery import (
    BoxState,
    DeliveryHeuristic,
    DeliverySite,
    all_delivered,
    boxes_left,
    delivery_reward,
    delivery_transition,
)
from wherry.domains.taxi import PROBES, TaxiGrid, taxi_grid
from wherry.episodes import GoalAgent, PolicyAgent, run_episode
from wherry.floorplan.plan import Cell
from wherry.floorplan.world_files import find_world
from wherry.learning.bayes import BayesianLearner
from wherry.learning.doormax import Doormax
from wherry.learning.learners import LEARNERS, RuleLearner
from wherry.oomdp.attributes import integer
from wherry.oomdp.conditional_models import PerStateModel
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import UNKNOWN, DeterministicMdp, Outcome, Prediction, Transition
from wherry.oomdp.objects import ObjectClass, State
from wherry.oomdp.relations import Relation
from wherry.oomdp.terms import related
from wherry.planning.pddl import PddlTask, export_pddl
from wherry.planning.prediction_cache import PredictionCache
from wherry.planning.search import a_star
from wherry.planning.value_iteration import ValueIteration
from wherry_testing.small_worlds import DOMAIN, Tabular, at

get_environment().credits_stream = None


def plan(task: PddlTask) -> list[Action] | None:
    """The shortest plan, by A* with the landmark-cut heuristic."""
    problem = PDDLReader().parse_problem_string(task.domain, task.problem)
    with OneshotPlanner(name="fast-downward-opt") as planner:
        found = planner.solve(problem).plan
    return None if found is None else [task.actions[step.action.name] for step in found.actions]


def taught(name: str, environment: TaxiGrid) -> RuleLearner:
    learner, rng = LEARNERS[name](environment.domain), np.random.default_rng(0)
    agent = PolicyAgent(learner, ValueIteration(learner))
    for _ in range(40):
        list(run_episode(environment, agent, rng, max_steps=1000))
    return learner


@pytest.fixture(scope="module")
def taxi() -> TaxiGrid:
    return taxi_grid(5)


@pytest.fixture(scope="module")
def learner(taxi: TaxiGrid) -> RuleLearner:
    return taught("doormax", taxi)


@pytest.mark.parametrize(("probe", "length"), [(PROBES[0], 10), (PROBES[1], 14), (PROBES[5], 13)])
def test_taxi_takes_the_published_optimal_number_of_steps(
    taxi: TaxiGrid, learner: RuleLearner, probe: tuple, length: int
) -> None:
    state = taxi.state_of(*probe)
    actions = plan(export_pddl(learner, taxi.domain, state))
    assert len(actions) == length
    for action in actions:
        done = taxi.transition(state, action)
        assert not done.failed
        state = done.next_state
    assert done.terminated


def test_what_was_learnt_on_a_small_grid_is_planned_with_on_a_large_one(taxi: TaxiGrid) -> None:
    learner, large = taught("bayes", taxi), taxi_grid(10)
    assert len(plan(export_pddl(learner, large.domain, large.state_of(*PROBES[0])))) == 17


def test_operators_ask_for_what_matters_and_nothing_else(taxi: TaxiGrid, learner: RuleLearner) -> None:
    task = export_pddl(learner, taxi.domain, taxi.state_of(*PROBES[0]))
    conditions = dict(re.findall(r":action (\w+)\n.*?\n    :precondition \(and (.*)\)\n", task.domain))
    assert conditions["n_1"] == "(is_taxi ?taxi) (not (touch_n_taxi_wall ?taxi)) (taxi_y_plus_1 ?taxi ?taxi_after)"
    assert "(on_taxi_destination ?taxi) (passenger_in_taxi ?passenger)" in conditions["dropoff_1"]
    assert set(task.actions.values()) == set(taxi.domain.ground_actions(taxi.state_of(*PROBES[0])))
    assert len(task.actions) == 6
    assert task.problem.count("(touch_n_taxi_wall ") == 5  # the cells along the northern edge


def test_deliveries_of_two_boxes() -> None:
    site = DeliverySite.of_plan(find_world("small"))
    start = site.state(Cell(0, 5), [BoxState("box1", Cell(1, 0)), BoxState("box2", Cell(4, 2))])
    world = DeterministicMdp(site.domain, delivery_transition, lambda rng: start)
    learner = BayesianLearner(site.domain, reward=delivery_reward, terminated=all_delivered)
    agent = GoalAgent(learner, boxes_left, DeliveryHeuristic())
    steps = list(run_episode(world, agent, np.random.default_rng(0), max_steps=3000))
    assert steps[-1].transition.terminated
    best, left = a_star(PredictionCache(PerStateModel(site.domain, world)), start, boxes_left, DeliveryHeuristic())
    assert left == 0
    actions = plan(export_pddl(learner, site.domain, start))
    assert len(actions) == len(best.actions)
    state = start
    for action in actions:
        state = delivery_transition(state, action).next_state
    assert all_delivered(state)


def test_what_is_not_known_is_not_planned_with(taxi: TaxiGrid) -> None:
    ignorant = Doormax(taxi.domain)
    task = export_pddl(ignorant, taxi.domain, taxi.state_of(*PROBES[0]))
    assert task.actions == {}
    assert plan(task) is None


def test_a_model_that_sees_more_than_the_terms_is_refused() -> None:
    """Two places that no term tells apart, but the model does."""
    left = {(0, "left"): ((1.0, 1, 0.0, False),), (1, "left"): ((1.0, 3, 0.0, False),)}
    with pytest.raises(ValueError, match="left: what is predicted depends on more than the domain's terms"):
        export_pddl(Tabular(left), DOMAIN, at(0))


PUSHER, CRATE = (ObjectClass(name, (integer("x", 0, 6),), removable=name == "Crate") for name in ("Agent", "Crate"))
BESIDE = Relation("left_of", lambda agent, crate: agent.x + 1 == crate.x)
PUSHING = Domain("pushing", (PUSHER, CRATE), (related(BESIDE, "Agent", "Crate"),), {"E": (), "EAT": ("Crate",)})


def push(state: State, action: Action) -> Transition:
    """East, pushing the crate that stands there; or eat the crate in front, which is gone then."""
    x, after = state["agent"].x, state
    ahead = next((crate for crate in state.of_class("Crate") if crate.x == x + 1), None)
    if action.name == "EAT" and ahead is not None and ahead.name == action.arguments[0]:
        after = state.without(ahead.name)
    elif action.name == "E" and x < 5:
        after = state.replace("agent", x=x + 1)
        after = after if ahead is None else after.replace(ahead.name, x=ahead.x + 1)
    return Transition(state, action, after, -1.0, terminated=False)


def test_a_goal_that_no_term_tells_is_told_by_values() -> None:
    """A crate is to be at 4, and no term says that it is at 3; no step out of bounds can be predicted by terms."""
    start = State((PUSHER("agent", x=0), CRATE("crate", x=2)))
    world = DeterministicMdp(PUSHING, push, lambda rng: start)

    def there(outcome: Outcome) -> bool:
        crate = None if outcome.next_state is None else outcome.next_state.get("crate")
        return crate is not None and crate.x == 4

    class Within(PerStateModel):
        """The truth, as long as the crate is not at the end: there the same terms would do something else."""

        def predict(self, state: State, action: Action) -> Prediction:
            return UNKNOWN if state["agent"].x == 5 else super().predict(state, action)

    task = export_pddl(Within(PUSHING, world), PUSHING, start, there)
    assert [str(action) for action in plan(task)] == ["E", "E", "E"]
    assert "(goal_values ?crate_after)" in task.domain
    assert task.problem.count("(goal_values ") == 1
    gone = export_pddl(
        Within(PUSHING, world),
        PUSHING,
        start,
        lambda outcome: outcome.next_state is not None and outcome.next_state.get("crate") is None,
    )
    assert [str(action) for action in plan(gone)] == ["E", "EAT(crate)"]
