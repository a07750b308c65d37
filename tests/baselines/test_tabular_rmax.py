"""R-max on tables does, step by step, what R-max on objects does that plans by value iteration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from wherry.baselines.compiled.rmax import Entries, TabularRmax
from wherry.baselines.compiled.tables import Curve
from wherry.baselines.factored_rmax import WORTH, FactoredRmax
from wherry.baselines.rmax import Rmax
from wherry.domains.taxi import minimal_parents, published_parents
from wherry.episodes import PolicyAgent, run_episode
from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import DeterministicMdp, Transition
from wherry.oomdp.objects import State
from wherry.pipelines.grids.arenas import Arena
from wherry.planning.value_iteration import ValueIteration
from wherry_testing.small_worlds import DOMAIN, at

LONGEST_EPISODE = 100


def on_tables(arena: Arena, entries: Entries, seed: int, patience: int) -> Curve:
    rng = np.random.default_rng(seed)
    curve, _ = TabularRmax(entries).learn(arena.tables, arena.probes, rng, longest=LONGEST_EPISODE, patience=patience)
    return curve


def on_objects(arena: Arena, learner: Rmax | FactoredRmax, seed: int, patience: int) -> Curve:
    world = DeterministicMdp(
        arena.truth.domain, arena.truth.transition, lambda rng: arena.starts[rng.integers(len(arena.starts))]
    )
    planner, rng = ValueIteration(learner), np.random.default_rng(seed)
    agent, steps, solved, curve = PolicyAgent(learner, planner), 0, 0, list[tuple[int, int]]()
    while solved < len(arena.probes) and steps < patience:
        steps += sum(1 for _ in run_episode(world, agent, rng, max_steps=LONGEST_EPISODE))
        solved = arena.solved(planner.policy)
        curve.append((steps, solved))
    return tuple(curve)


@pytest.mark.parametrize(
    ("name", "make", "patience"),
    [
        ("rmax", Rmax, 1_500),
        ("published", lambda domain: FactoredRmax(domain, published_parents), 20_000),
        ("minimal", lambda domain: FactoredRmax(domain, minimal_parents), 20_000),
    ],
)
def test_tables_and_objects_learn_the_same(name: str, make: Callable[..., Rmax | FactoredRmax], patience: int) -> None:
    arena = Arena.of_size(5)
    curve = on_tables(arena, arena.entries[name], 3, patience)
    assert curve == on_objects(arena, make(arena.environment.domain), 3, patience)
    assert len(curve) > 10
    assert curve[-1][1] == 6 or curve[-1][0] >= patience


def random_arena(seed: int) -> Arena:
    """Twenty places, steps between any two of them, few ends; rewards of which no two are the same."""
    rng = np.random.default_rng(seed)
    after, reward, ends = rng.integers(20, size=(20, 2)), rng.uniform(-9, 20, (20, 2)), rng.random((20, 2)) < 0.1

    def transition(state: State, action: Action) -> Transition:
        here = state["walker"].at, int(action.name == "right")
        return Transition(state, action, at(int(after[here])), float(reward[here]), bool(ends[here]))

    starts = tuple(at(number) for number in range(20))
    truth = DeterministicMdp(DOMAIN, transition, lambda rng: starts[rng.integers(len(starts))])
    return Arena("random", truth, truth, ((starts[0], LONGEST_EPISODE + 1),), starts)  # which is never solved


@pytest.mark.parametrize("seed", range(20))
def test_they_do_so_in_any_world(seed: int) -> None:
    arena = random_arena(seed)
    curve = on_tables(arena, Entries.of_steps(arena.tables), seed, 2_000)
    assert curve == on_objects(arena, Rmax(DOMAIN), seed, 2_000)


def test_steps_share_the_entries_that_the_network_says() -> None:
    entries = Arena.of_size(5).entries
    assert np.unique(entries["rmax"].needed).size == 600 * 6
    worths = [np.unique(entries["published"].needed[:, action, 0]).size for action in range(6)]
    assert worths == [1, 1, 1, 1, 25 * 5, 25 * 4 * 4]  # 5 locations; 4 destinations, each with 3 other marks, or taxi
    least = [np.unique(entries["minimal"].needed[:, action, 0]).size for action in range(6)]
    assert least == [1, 1, 1, 1, 25 * 4 * 2, 25 * 2 * 4]


def test_a_network_that_is_too_small_is_refused() -> None:
    arena = Arena.of_size(5)
    with pytest.raises(ValueError, match=r"E, taxi\.x: depends on more than the network says"):
        Entries.of_network(
            arena.tables, arena.environment.domain, lambda _, variable: () if variable == WORTH else (variable,)
        )


@pytest.mark.slow
def test_factored_rmax_takes_as_many_steps_as_was_published() -> None:
    arena = Arena.of_size(10)
    steps = [on_tables(arena, arena.entries["published"], seed, 10**6)[-1][0] for seed in range(8)]
    assert np.mean(steps) == pytest.approx(19_866, rel=0.1)


def test_rewards_above_r_max_are_refused() -> None:
    arena = Arena.of_size(5)
    with pytest.raises(ValueError, match="R_max is 10, and a step is worth 20"):
        replace(TabularRmax(Entries.of_steps(arena.tables)), r_max=10.0).learn(
            arena.tables, arena.probes, np.random.default_rng(0), longest=5, patience=5
        )
