"""Learners solve Gymnasium's unmodified Taxi; its transition table gives the optimal number of steps."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.toy_text.taxi import TaxiEnv

from wherry.adapters.gymnasium_taxi import ACTIONS, GymnasiumTaxi, gymnasium_taxi_reward, is_delivered
from wherry.episodes import PolicyAgent, run_episode
from wherry.errors import InputError
from wherry.learning.registry import RULE_LEARNERS
from wherry.oomdp.domain import Action
from wherry.planning.value_iteration import ValueIteration
from wherry_testing.environment_contract import EnvironmentContract

TASK = {"reward": gymnasium_taxi_reward, "terminated": is_delivered}


def optimal_steps(taxi: TaxiEnv) -> np.ndarray:
    """[500] smallest number of steps to the end from every observation, by Gymnasium's transition table."""
    after = np.array([[taxi.P[state][action][0][1] for action in range(6)] for state in range(500)])
    end = np.array([[taxi.P[state][action][0][3] for action in range(6)] for state in range(500)])
    steps = np.full(500, np.inf)
    for _ in range(60):
        steps = 1 + np.where(end, 0, steps[after]).min(axis=1)
    return steps


class TestTheContract(EnvironmentContract):
    @pytest.fixture
    def environment(self) -> GymnasiumTaxi:
        return GymnasiumTaxi(gymnasium.make("Taxi-v4"))


def test_states_agree_with_encoded_observations() -> None:
    adapter = GymnasiumTaxi(gymnasium.make("Taxi-v4"))
    taxi = adapter.environment.unwrapped
    state = adapter.state(taxi.encode(0, 3, 1, 2))  # row 0 from the top, column 3; passenger at G, destination Y
    assert (state["taxi"].x, state["taxi"].y) == (3, 4)
    assert (state["passenger"].x, state["passenger"].y, state["passenger"].in_taxi) == (4, 4, False)
    assert (state["destination"].x, state["destination"].y) == (0, 0)
    riding = adapter.state(taxi.encode(2, 1, 4, 2))
    assert (riding["passenger"].x, riding["passenger"].y, riding["passenger"].in_taxi) == (1, 2, True)
    assert len({adapter.state(number) for number in range(500)}) == 500


def test_touch_holds_at_gymnasiums_walls() -> None:
    """touch_D holds exactly where Gymnasium's action mask excludes the move."""
    adapter = GymnasiumTaxi(gymnasium.make("Taxi-v4"))
    for number in range(500):
        mask = adapter.environment.unwrapped.action_mask(number)
        bits = adapter.domain.cond(adapter.state(number)).value
        for bit, direction in enumerate("NSEW"):
            assert (bits >> bit & 1) == 1 - mask[ACTIONS.index(direction)]


@pytest.mark.parametrize(
    ("name", "task"),
    [("doormax", {}), ("doormax", TASK), ("bayes", {}), ("bayes", TASK)],
    ids=["doormax", "doormax given rewards", "bayes", "bayes given rewards"],
)
def test_learners_become_optimal(name: str, task: dict) -> None:
    """After 20 episodes the greedy policy is optimal from every initial state, with rewards learnt or given."""
    adapter = GymnasiumTaxi(gymnasium.make("Taxi-v4"))
    taxi = adapter.environment.unwrapped
    learner, rng = RULE_LEARNERS[name].factory(adapter.domain, **task), np.random.default_rng(0)
    agent = PolicyAgent(learner, ValueIteration(learner))
    for _ in range(20):
        steps = list(run_episode(adapter, agent, rng, max_steps=2000))
        assert steps[-1].transition.terminated
    assert learner.violations == ()
    planner = ValueIteration(learner, optimistic=False)
    optimal = optimal_steps(taxi)
    for start in np.flatnonzero(taxi.initial_state_distrib):
        number, taken, end = int(start), 0, False
        while not end and taken <= optimal[start]:
            action = planner.policy(adapter.state(number))
            _, number, _, end = taxi.P[number][ACTIONS.index(action.name)][0]
            taken += 1
        assert end
        assert taken == optimal[start]


def test_given_rewards_and_terminations_are_gymnasiums() -> None:
    """For every observation and action, reward and termination equal those of Gymnasium's transition table."""
    adapter = GymnasiumTaxi(gymnasium.make("Taxi-v4"))
    taxi = adapter.environment.unwrapped
    for number in range(500):
        state = adapter.state(number)
        if is_delivered(state):
            continue  # a terminal state
        for index, name in enumerate(ACTIONS):
            _, after, reward, end = taxi.P[number][index][0]
            next_state = adapter.state(after)
            assert gymnasium_taxi_reward(state, Action(name), next_state) == reward
            assert is_delivered(next_state) == end


def test_same_seed_gives_the_same_episode() -> None:
    first, second = (GymnasiumTaxi(gymnasium.make("Taxi-v4")) for _ in range(2))
    assert first.reset(np.random.default_rng(3)) == second.reset(np.random.default_rng(3))
    assert first.step(Action("N")) == second.step(Action("N"))


def test_a_step_before_the_first_reset_is_refused() -> None:
    with pytest.raises(RuntimeError, match="reset"):
        GymnasiumTaxi(gymnasium.make("Taxi-v4")).step(Action("N"))


@pytest.mark.parametrize(
    ("name", "settings", "reason"),
    [
        ("CartPole-v1", {}, "not Gymnasium's Taxi"),
        ("Taxi-v4", {"is_rainy": True}, "not deterministic"),
        ("Taxi-v4", {"fickle_passenger": True}, "not deterministic"),
    ],
)
def test_other_environment_is_refused(name: str, settings: dict, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        GymnasiumTaxi(gymnasium.make(name, **settings))
