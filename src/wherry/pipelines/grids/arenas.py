"""Where learners compete: a world to act in, the truth about it, and probes to test a policy from.

The Taxi grids and their probes are the published ones (Diuk et al. 2008, section 5). Delivery, of one box, and
Gymnasium's own Taxi have been given six probes of the same kind, drawn once and for all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import permutations
from typing import cast

import gymnasium
import numpy as np
from gymnasium.envs.toy_text.taxi import TaxiEnv

from wherry.adapters.gymnasium_taxi import ACTIONS, GymnasiumTaxi
from wherry.baselines.compiled.rmax import Entries
from wherry.baselines.compiled.tables import Tables
from wherry.baselines.factored_rmax import Parents
from wherry.domains.delivery import BoxState, DeliveryHeuristic, DeliverySite, delivery_grid, delivery_transition
from wherry.domains.taxi import PROBES, SIZES, minimal_parents, published_parents, taxi_grid
from wherry.errors import InputError
from wherry.floorplan.world_files import find_world
from wherry.oomdp.conditional_models import PerStateModel
from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import DeterministicMdp, Environment, Transition
from wherry.oomdp.objects import State
from wherry.planning.state_space import StateSpace
from wherry.planning.value_iteration import ValueIteration

LONGEST_EPISODE = 100  # steps
PROBE_SEED = 2008
TAXI_NETWORKS: Mapping[str, Parents] = {"published": published_parents, "minimal": minimal_parents}


@dataclass(frozen=True)
class Arena:
    """A world for all repetitions of an experiment; tables that say nothing of what was learnt are shared by them.

    Attributes:
        title: What to call it.
        environment: What learners act in.
        truth: What is true of it; used for tests alone.
        probes: The states to test from, each with the fewest steps that solve it.
        starts: All states in which an episode may begin.
        networks: What depends on what, which Factored R-max is given: one way to say it or more, or none where nobody
            has written that down.
        acting: States as planners number them for acting.
        testing: The same for testing.
    """

    title: str
    environment: Environment
    truth: DeterministicMdp
    probes: tuple[tuple[State, int], ...]
    starts: tuple[State, ...]
    networks: Mapping[str, Parents] = field(default_factory=dict)
    acting: StateSpace = field(default_factory=StateSpace)
    testing: StateSpace = field(default_factory=StateSpace)

    @classmethod
    def of_size(cls, size: int) -> Arena:
        """A published Taxi grid.

        Raises:
            InputError: There is none of that size.
        """
        if size not in SIZES:
            raise InputError("--size", str(size), f"is none of {', '.join(map(str, SIZES))}")
        grid = taxi_grid(size)
        starts = tuple(
            grid.state_of((cell.x, cell.y), passenger, destination)
            for cell in grid.plan.cells()
            for passenger, destination in permutations(sorted(grid.plan.marks), 2)
        )
        probes = [grid.state_of(*probe) for probe in PROBES]
        return cls(f"Taxi {size}×{size}", grid, grid, _with_lengths(grid, probes), starts, TAXI_NETWORKS)

    @classmethod
    def of_world(cls, world: str) -> Arena:
        """The delivery of one box in a world; robot and box begin anywhere.

        Raises:
            InputError: There is no such world, or it has no robot, no warehouse or no room for a box.
        """
        plan = find_world(world)
        grid, site = delivery_grid(plan, 1), DeliverySite.of_plan(plan)
        possible, on_floor = DeliveryHeuristic(), [cell for cell in plan.cells() if cell not in plan.warehouse]
        states = (site.state(robot, [BoxState("box1", cell)]) for robot, cell in permutations(on_floor, 2))
        starts = [state for state in states if possible(state) > 0]
        truth = DeterministicMdp(grid.domain, delivery_transition, lambda rng: starts[rng.integers(len(starts))])
        return cls(f"Delivery in {plan.name}", truth, truth, _with_lengths(truth, _drawn(starts)), tuple(starts))

    @classmethod
    def of_gymnasium_taxi(cls) -> Arena:
        """Gymnasium's own Taxi, as it is; the truth is its table of transitions."""
        environment = GymnasiumTaxi(gymnasium.make("Taxi-v4"))
        taxi = cast("TaxiEnv", environment.environment.unwrapped)
        states = [environment.state(number) for number in range(len(taxi.P))]
        numbers = {state: number for number, state in enumerate(states)}

        def truth(state: State, action: Action) -> Transition:
            ((_, after, reward, terminated),) = taxi.P[numbers[state]][ACTIONS.index(action.name)]
            return Transition(state, action, states[after], float(reward), terminated)

        starts = [states[number] for number in np.flatnonzero(taxi.initial_state_distrib)]
        mdp = DeterministicMdp(environment.domain, truth, lambda rng: starts[rng.integers(len(starts))])
        probes = _with_lengths(mdp, _drawn(starts))
        return cls("Gymnasium's Taxi", environment, mdp, probes, tuple(starts))

    @cached_property
    def tables(self) -> Tables:
        """The states as numbers, for learners that need very many steps."""
        return Tables.of(self.truth, list(self.starts))

    @cached_property
    def entries(self) -> Mapping[str, Entries]:
        """What there is to learn for R-max, and for Factored R-max with every network."""
        domain = self.truth.domain
        factored = {name: Entries.of_network(self.tables, domain, parents) for name, parents in self.networks.items()}
        return {"rmax": Entries.of_steps(self.tables), **factored}

    def solved(self, policy: Callable[[State], Action]) -> int:
        """How many of the probes a policy solves in the fewest steps."""
        return sum(_steps_to_end(self.truth, policy, probe, fewest) == fewest for probe, fewest in self.probes)


ARENAS: Mapping[str, Callable[[int, str], Arena]] = {
    "taxi": lambda size, world: Arena.of_size(size),
    "delivery": lambda size, world: Arena.of_world(world),
    "gymnasium-taxi": lambda size, world: Arena.of_gymnasium_taxi(),
}
"""Each takes the size of the grid and the name of the world; what has no meaning for it, it leaves aside."""


def _drawn(starts: list[State]) -> list[State]:
    """Six different first states, always the same."""
    return [starts[at] for at in np.random.default_rng(PROBE_SEED).choice(len(starts), len(PROBES), replace=False)]


def _with_lengths(truth: DeterministicMdp, probes: list[State]) -> tuple[tuple[State, int], ...]:
    """Every probe with the fewest steps that solve it."""
    optimal = ValueIteration(PerStateModel(truth.domain, truth), optimistic=False)
    return tuple((probe, _steps_to_end(truth, optimal.policy, probe, LONGEST_EPISODE)) for probe in probes)


def _steps_to_end(truth: DeterministicMdp, policy: Callable[[State], Action], start: State, limit: int) -> int:
    """How many steps a policy takes to end the episode; more than the limit where it does not within that."""
    state = start
    for number in range(1, limit + 1):
        done = truth.transition(state, policy(state))
        if done.terminated:
            return number
        state = done.next_state
    return limit + 1
