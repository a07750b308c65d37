"""Q-learning, R-max and Factored R-max on a corridor whose values are known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from wherry.baselines.factored_rmax import FactoredRmax
from wherry.baselines.q_learning import QLearning
from wherry.baselines.rmax import Rmax
from wherry.domains.taxi import minimal_parents, taxi_grid
from wherry.episodes import PolicyAgent, run_episode
from wherry.oomdp.attributes import integer
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import DeterministicMdp, Transition
from wherry.oomdp.objects import ObjectClass, State
from wherry.planning.value_iteration import ValueIteration

LENGTH = 5
WALKER = ObjectClass("Walker", (integer("x", 0, LENGTH - 1),))
DOMAIN = Domain("corridor", (WALKER,), (), {"LEFT": (), "RIGHT": ()})


def at(x: int) -> State:
    return State((WALKER("walker", x=x),))


def walk(state: State, action: Action) -> Transition:
    x = int(np.clip(state["walker"].x + (1 if action.name == "RIGHT" else -1), 0, LENGTH - 1))
    arrived = x == LENGTH - 1
    return Transition(state, action, at(x), 10.0 if arrived else -1.0, arrived)


def corridor() -> DeterministicMdp:
    return DeterministicMdp(DOMAIN, walk, lambda rng: at(int(rng.integers(LENGTH - 1))))


def q_learning(rng: np.random.Generator) -> PolicyAgent:
    learner = QLearning(DOMAIN, rng)
    return PolicyAgent(learner, learner)


def optimistic(rng: np.random.Generator) -> PolicyAgent:
    learner = QLearning(DOMAIN, rng, exploration=0.0, first_value=10.0)
    return PolicyAgent(learner, learner)


def rmax(rng: np.random.Generator) -> PolicyAgent:
    learner = Rmax(DOMAIN)
    return PolicyAgent(learner, ValueIteration(learner))


def factored(rng: np.random.Generator) -> PolicyAgent:
    learner = FactoredRmax(DOMAIN, lambda action, variable: (("walker", "x"),))
    return PolicyAgent(learner, ValueIteration(learner))


@pytest.mark.parametrize("make", [q_learning, optimistic, rmax, factored])
def test_they_learn_to_walk_to_the_end(make: Callable[[np.random.Generator], PolicyAgent]) -> None:
    environment, rng = corridor(), np.random.default_rng(0)
    agent = make(rng)
    for _ in range(60):
        for _ in run_episode(environment, agent, rng, max_steps=20):
            pass
    best = agent.learner.best if isinstance(agent.learner, QLearning) else agent.planner.policy
    assert [best(at(x)).name for x in range(LENGTH - 1)] == ["RIGHT"] * (LENGTH - 1)


def test_q_values_are_the_discounted_sums() -> None:
    learner = QLearning(DOMAIN, np.random.default_rng(0), discount=0.5)
    for _ in range(10):
        for x in range(LENGTH - 1):
            for action in DOMAIN.ground_actions(at(x)):
                learner.add_experience(walk(at(x), action))
    values = [learner.value(at(x)) for x in range(LENGTH - 1)]
    assert values == [0.5 * (0.5 * (0.5 * 10 - 1) - 1) - 1, 0.5 * (0.5 * 10 - 1) - 1, 0.5 * 10 - 1, 10.0]


def test_rmax_knows_what_it_saw_and_nothing_else() -> None:
    learner = Rmax(DOMAIN)
    learner.add_experience(walk(at(1), Action("RIGHT")))
    assert learner.predict(at(1), Action("RIGHT")).most_likely.next_state == at(2)
    assert learner.predict(at(1), Action("LEFT")).most_likely.next_state is None
    assert learner.predict(at(2), Action("RIGHT")).most_likely.next_state is None
    assert learner.revisions == {"LEFT": 0, "RIGHT": 1}


def test_factored_rmax_knows_a_step_when_it_knows_all_its_parts() -> None:
    environment = taxi_grid(5)
    learner = FactoredRmax(environment.domain, minimal_parents)
    first = environment.state_of((2, 2), "Y", "R")
    learner.add_experience(environment.transition(first, Action("N")))
    other = environment.state_of((2, 2), "Y", "G")  # the same cell; only the destination is new
    assert learner.predict(first, Action("N")).most_likely.is_known
    assert not learner.predict(other, Action("N")).most_likely.is_known
    learner.add_experience(environment.transition(environment.state_of((1, 2), "Y", "G"), Action("N")))
    assert (
        learner.predict(other, Action("N")).most_likely.next_state
        == environment.transition(other, Action("N")).next_state
    )
    assert not learner.predict(other, Action("S")).most_likely.is_known


def test_factored_rmax_learns_that_an_object_leaves() -> None:
    walker, apple = ObjectClass("Walker", (integer("x", 0, 3),)), ObjectClass("Apple", (integer("x"),), removable=True)
    domain = Domain("orchard", (walker, apple), (), {"EAT": ()})
    together = (("walker", "x"), ("apple", "x"))
    learner = FactoredRmax(domain, lambda action, variable: (variable,) if variable[0] == "walker" else together)
    here, there = (State((walker("walker", x=1), apple("apple", x=x))) for x in (1, 2))
    learner.add_experience(Transition(here, Action("EAT"), here.without("apple"), 1.0, terminated=False))
    assert learner.predict(here, Action("EAT")).most_likely.next_state == here.without("apple")
    assert not learner.predict(there, Action("EAT")).most_likely.is_known
    after = here.without("apple")
    assert not learner.predict(after, Action("EAT")).most_likely.is_known
    learner.add_experience(Transition(after, Action("EAT"), after, 0.0, terminated=False))
    assert learner.predict(after, Action("EAT")).most_likely.next_state == after
