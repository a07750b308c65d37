"""The worlds in which learners are compared: an environment, its true model, and probes.

A probe is a state from which a policy is tested. The Taxi grids and their six probes are the published ones (Diuk et
al. 2008, section 5). For deliveries of one box and for Gymnasium's Taxi, six start states are drawn with a fixed seed.
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
from wherry.baselines.compiled.model_entries import ModelEntries
from wherry.baselines.compiled.tabular import TabularMdp
from wherry.baselines.network import Parents
from wherry.domains.delivery import BoxState, DeliveryHeuristic, DeliverySite, delivery_grid, delivery_transition
from wherry.domains.taxi import PROBES, PUBLISHED_GRIDS, minimal_parents, published_parents, taxi_grid
from wherry.errors import InputError
from wherry.floorplan.world_files import find_world
from wherry.oomdp.conditional_models import PerStateModel
from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import DeterministicMdp, Environment, Transition
from wherry.oomdp.objects import State
from wherry.planning.state_space import StateSpace
from wherry.planning.value_iteration import ValueIteration

MAX_EPISODE_STEPS = 100  # steps after which an episode is truncated
PROBE_SEED = 2008  # seed of the probes that are not published
TAXI_NETWORKS: Mapping[str, Parents] = {"published": published_parents, "minimal": minimal_parents}


@dataclass(frozen=True)
class Arena:
    """A world in which all repetitions of an experiment are run.

    The repetitions also share numbered states and table entries, which contain nothing learnt.

    Attributes:
        title: Name of the world in messages and figures.
        environment: Environment in which agents act.
        truth: True model of the world, used for tests only.
        probes: States from which policies are tested, each with the fewest steps to the end of the episode.
        starts: All states in which an episode may begin.
        networks: Dynamic Bayesian networks for Factored R-max, by name; empty where none is known.
        acting: State space of the planners of acting agents.
        testing: State space of the planners whose policies are tested.
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
        """Return a published Taxi grid.

        Raises:
            InputError: No grid of that size was published.
        """
        if size not in PUBLISHED_GRIDS:
            raise InputError("--size", str(size), f"is none of {', '.join(map(str, PUBLISHED_GRIDS))}")
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
        """Return the delivery of one box in a world.

        Robot and box start in two different cells outside the warehouse, from which the box can be delivered.

        Raises:
            InputError: There is no such world, or it has no robot, no warehouse or no room for a box.
        """
        plan = find_world(world)
        grid, site = delivery_grid(plan, 1), DeliverySite.of_plan(plan)
        floor = [cell for cell in plan.cells() if cell not in plan.warehouse]
        states = (site.state(robot, [BoxState("box1", cell)]) for robot, cell in permutations(floor, 2))
        steps_left = DeliveryHeuristic()
        starts = [state for state in states if steps_left(state) > 0]  # 0 where walls separate robot, box or warehouse
        truth = DeterministicMdp(grid.domain, delivery_transition, lambda rng: starts[rng.integers(len(starts))])
        return cls(f"Delivery in {plan.name}", truth, truth, _with_lengths(truth, _draw_probes(starts)), tuple(starts))

    @classmethod
    def of_gymnasium_taxi(cls) -> Arena:
        """Return Gymnasium's Taxi unchanged; its table of transitions is the true model."""
        environment = GymnasiumTaxi(gymnasium.make("Taxi-v4"))
        taxi = cast("TaxiEnv", environment.environment.unwrapped)
        states = [environment.state(number) for number in range(len(taxi.P))]
        numbers = {state: number for number, state in enumerate(states)}

        def truth(state: State, action: Action) -> Transition:
            ((_, after, reward, terminated),) = taxi.P[numbers[state]][ACTIONS.index(action.name)]
            return Transition(state, action, states[after], float(reward), terminated)

        starts = [states[number] for number in np.flatnonzero(taxi.initial_state_distrib)]
        mdp = DeterministicMdp(environment.domain, truth, lambda rng: starts[rng.integers(len(starts))])
        probes = _with_lengths(mdp, _draw_probes(starts))
        return cls("Gymnasium's Taxi", environment, mdp, probes, tuple(starts))

    @cached_property
    def tables(self) -> TabularMdp:
        """The world on numbered states, for the compiled baselines."""
        return TabularMdp.of(self.truth, list(self.starts))

    @cached_property
    def step_entries(self) -> ModelEntries:
        """The table entries of R-max."""
        return ModelEntries.of_steps(self.tables)

    @cached_property
    def network_entries(self) -> Mapping[str, ModelEntries]:
        """The table entries of Factored R-max, by the name of the network."""
        domain = self.truth.domain
        return {name: ModelEntries.of_network(self.tables, domain, parents) for name, parents in self.networks.items()}

    def solved(self, policy: Callable[[State], Action]) -> int:
        """Return how many of the probes a policy solves in the fewest steps."""
        return sum(_steps_to_end(self.truth, policy, probe, fewest) == fewest for probe, fewest in self.probes)


ARENAS: Mapping[str, Callable[[int, str], Arena]] = {
    "taxi": lambda size, world: Arena.of_size(size),
    "delivery": lambda size, world: Arena.of_world(world),
    "gymnasium-taxi": lambda size, world: Arena.of_gymnasium_taxi(),
}
"""Factories of the arenas by domain; arguments are the Taxi grid's side, in cells, and the name of the world."""


def _draw_probes(starts: list[State]) -> list[State]:
    """Return six different start states, drawn with a fixed seed."""
    numbers = np.random.default_rng(PROBE_SEED).choice(len(starts), len(PROBES), replace=False)
    return [starts[number] for number in numbers]


def _with_lengths(truth: DeterministicMdp, probes: list[State]) -> tuple[tuple[State, int], ...]:
    """Return every probe with the fewest steps to the end of the episode."""
    optimal = ValueIteration(PerStateModel(truth.domain, truth), optimistic=False)
    return tuple((probe, _steps_to_end(truth, optimal.policy, probe, MAX_EPISODE_STEPS)) for probe in probes)


def _steps_to_end(truth: DeterministicMdp, policy: Callable[[State], Action], start: State, limit: int) -> int:
    """Return the steps that a policy takes to end the episode; limit + 1 where it needs more than the limit."""
    state = start
    for number in range(1, limit + 1):
        transition = truth.transition(state, policy(state))
        if transition.terminated:
            return number
        state = transition.next_state
    return limit + 1
