"""Compiled R-max takes the same steps as the reference implementation with value iteration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from wherry.baselines.compiled.model_entries import ModelEntries
from wherry.baselines.compiled.rmax import TabularRmax
from wherry.baselines.compiled.tabular import LearningCurve
from wherry.baselines.factored_rmax import FactoredRmax
from wherry.baselines.network import REWARD_AND_END
from wherry.baselines.rmax import Rmax
from wherry.domains.taxi import minimal_parents, published_parents
from wherry.episodes import PolicyAgent, run_episode
from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import DeterministicMdp, Transition
from wherry.oomdp.objects import State
from wherry.pipelines.grids.arenas import Arena
from wherry.planning.value_iteration import ValueIteration
from wherry_testing.small_worlds import DOMAIN, state_at

MAX_EPISODE_STEPS = 100


def compiled_curve(arena: Arena, entries: ModelEntries, seed: int, max_steps: int) -> LearningCurve:
    rng = np.random.default_rng(seed)
    learner = TabularRmax(entries)
    curve, _ = learner.learn(arena.tables, arena.probes, rng, max_episode_steps=MAX_EPISODE_STEPS, max_steps=max_steps)
    return curve


def plain_curve(arena: Arena, learner: Rmax | FactoredRmax, seed: int, max_steps: int) -> LearningCurve:
    world = DeterministicMdp(
        arena.truth.domain, arena.truth.transition, lambda rng: arena.starts[rng.integers(len(arena.starts))]
    )
    planner, rng = ValueIteration(learner), np.random.default_rng(seed)
    agent, steps, solved, curve = PolicyAgent(learner, planner), 0, 0, list[tuple[int, int]]()
    while solved < len(arena.probes) and steps < max_steps:
        steps += sum(1 for _ in run_episode(world, agent, rng, max_steps=MAX_EPISODE_STEPS))
        solved = arena.solved(planner.policy)
        curve.append((steps, solved))
    return tuple(curve)


@pytest.mark.parametrize(
    ("name", "make", "max_steps"),
    [
        ("rmax", Rmax, 1_500),
        ("published", lambda domain: FactoredRmax(domain, published_parents), 20_000),
        ("minimal", lambda domain: FactoredRmax(domain, minimal_parents), 20_000),
    ],
)
def test_compiled_and_plain_rmax_take_the_same_steps_on_taxi(
    name: str, make: Callable[..., Rmax | FactoredRmax], max_steps: int
) -> None:
    arena = Arena.of_size(5)
    entries = arena.step_entries if name == "rmax" else arena.network_entries[name]
    curve = compiled_curve(arena, entries, 3, max_steps)
    assert curve == plain_curve(arena, make(arena.environment.domain), 3, max_steps)
    assert len(curve) > 10
    assert curve[-1][1] == 6 or curve[-1][0] >= max_steps


def random_arena(seed: int) -> Arena:
    """Return a world of twenty states with random successors, different rewards, and a tenth of terminal steps."""
    rng = np.random.default_rng(seed)
    successor, reward, ends = rng.integers(20, size=(20, 2)), rng.uniform(-9, 20, (20, 2)), rng.random((20, 2)) < 0.1

    def transition(state: State, action: Action) -> Transition:
        step = state["walker"].x, int(action.name == "right")
        return Transition(state, action, state_at(int(successor[step])), float(reward[step]), bool(ends[step]))

    starts = tuple(state_at(number) for number in range(20))
    truth = DeterministicMdp(DOMAIN, transition, lambda rng: starts[rng.integers(len(starts))])
    return Arena("random", truth, truth, ((starts[0], MAX_EPISODE_STEPS + 1),), starts)  # a probe that is never solved


@pytest.mark.parametrize("seed", range(20))
def test_compiled_and_plain_rmax_take_the_same_steps_in_random_worlds(seed: int) -> None:
    arena = random_arena(seed)
    curve = compiled_curve(arena, ModelEntries.of_steps(arena.tables), seed, 2_000)
    assert curve == plain_curve(arena, Rmax(DOMAIN), seed, 2_000)


def test_steps_share_the_entries_of_the_same_parents() -> None:
    arena = Arena.of_size(5)
    networks = arena.network_entries
    assert np.unique(arena.step_entries.required).size == 600 * 6
    reward_entries = {
        name: [np.unique(network.required[:, action, 0]).size for action in range(6)]
        for name, network in networks.items()
    }
    # PICKUP depends on the cell and 5 passenger locations; DROPOFF on the cell, 4 destinations, and the passenger at
    # one of the 3 other marks or in the taxi.
    assert reward_entries["published"] == [1, 1, 1, 1, 25 * 5, 25 * 4 * 4]
    assert reward_entries["minimal"] == [1, 1, 1, 1, 25 * 4 * 2, 25 * 2 * 4]


def test_a_network_that_is_too_small_is_refused() -> None:
    arena = Arena.of_size(5)
    with pytest.raises(ValueError, match=r"E, taxi\.x: depends on more than its parents in the network"):
        ModelEntries.of_network(
            arena.tables,
            arena.environment.domain,
            lambda _, variable: () if variable == REWARD_AND_END else (variable,),
        )


@pytest.mark.slow
def test_factored_rmax_takes_as_many_steps_as_published() -> None:
    arena = Arena.of_size(10)
    steps = [compiled_curve(arena, arena.network_entries["published"], seed, 10**6)[-1][0] for seed in range(8)]
    assert np.mean(steps) == pytest.approx(19_866, rel=0.1)


def test_rewards_above_r_max_are_refused() -> None:
    arena = Arena.of_size(5)
    with pytest.raises(ValueError, match="R_max is 10, but a step has the reward 20"):
        replace(TabularRmax(ModelEntries.of_steps(arena.tables)), r_max=10.0).learn(
            arena.tables, arena.probes, np.random.default_rng(0), max_episode_steps=5, max_steps=5
        )
