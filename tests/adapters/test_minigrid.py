"""Learners solve unmodified MiniGrid environments; optimal lengths come from a search through MiniGrid itself."""

from __future__ import annotations

from collections import deque

import gymnasium
import minigrid  # noqa: F401 - registers the environments
import numpy as np
import pytest
from minigrid.core.world_object import Door
from minigrid.minigrid_env import MiniGridEnv

from wherry.adapters.minigrid import ACTIONS, MINIGRID_EFFECT_TYPES, MiniGrid, is_at_goal
from wherry.episodes import PolicyAgent, run_episode
from wherry.errors import InputError
from wherry.learning.bayes import BayesianLearner
from wherry.learning.registry import RULE_LEARNERS
from wherry.learning.rules import RuleLearner
from wherry.oomdp.attributes import enumeration
from wherry.oomdp.domain import Action
from wherry.oomdp.effects import Effect, effects_between
from wherry.planning.value_iteration import ValueIteration
from wherry_testing.environment_contract import EnvironmentContract

DOORMAX = {"failure_scope": "attribute", "max_effects": 4}  # the agent has four headings
SETTINGS = {"doormax": DOORMAX, "bayes": {}}


def adapted(name: str) -> MiniGrid:
    return MiniGrid(gymnasium.make(f"MiniGrid-{name}-v0"))


def learner_for(adapter: MiniGrid, name: str) -> RuleLearner:
    return RULE_LEARNERS[name].factory(adapter.domain, effect_types=MINIGRID_EFFECT_TYPES, **SETTINGS[name])


def train(adapter: MiniGrid, learner: RuleLearner, episodes: int) -> None:
    agent, rng = PolicyAgent(learner, ValueIteration(learner, r_max=1.0)), np.random.default_rng(0)
    for _ in range(episodes):
        steps = list(run_episode(adapter, agent, rng, max_steps=2000))
        assert steps[-1].transition.terminated


def steps_of_the_learnt_policy(adapter: MiniGrid, learner: RuleLearner, seed: int) -> int:
    planner = ValueIteration(learner, optimistic=False, r_max=1.0)
    state = adapter.reset(np.random.default_rng(seed))
    for steps in range(1, 200):
        transition = adapter.step(planner.policy(state))
        if transition.terminated:
            assert transition.reward == 1.0
            return steps
        state = transition.next_state
    raise AssertionError


def fewest_steps(adapter: MiniGrid, seed: int) -> int:
    """Breadth-first search through the environment, restored before every step, without the action ``drop``."""
    adapter.reset(np.random.default_rng(seed))
    environment = adapter.environment.unwrapped
    assert isinstance(environment, MiniGridEnv)
    doors = [item for item in environment.grid.grid if isinstance(item, Door)]

    def snapshot() -> tuple:
        locks = tuple((door.is_open, door.is_locked) for door in doors)
        items = tuple(environment.grid.grid)
        return tuple(environment.agent_pos), environment.agent_dir, environment.carrying, items, locks

    def restore(saved: tuple) -> None:
        environment.agent_pos, environment.agent_dir, environment.carrying, items, locks = saved
        environment.grid.grid = list(items)
        for door, lock in zip(doors, locks, strict=True):
            door.is_open, door.is_locked = lock

    steps, queue = {snapshot(): 0}, deque([snapshot()])
    while queue:
        before = queue.popleft()
        for action in ("left", "right", "forward", "pickup", "toggle"):
            restore(before)
            _, reward, terminated, _, _ = environment.step(ACTIONS.index(action))
            if terminated and reward != 0:
                return steps[before] + 1
            after = snapshot()
            if not terminated and after not in steps:
                steps[after] = steps[before] + 1
                queue.append(after)
    raise AssertionError


class TestTheContract(EnvironmentContract):
    @pytest.fixture(params=["Empty-5x5", "DoorKey-5x5", "Unlock", "FourRooms"])
    def environment(self, request: pytest.FixtureRequest) -> MiniGrid:
        return adapted(request.param)


def test_states_contain_the_objects_of_the_grid() -> None:
    adapter = adapted("DoorKey-5x5")
    state = adapter.reset(np.random.default_rng(0))
    grid = adapter.environment.unwrapped
    agent, (key,), (door,) = state["agent"], state.of_class("Key"), state.of_class("Door")
    assert (agent.x, 4 - agent.y) == tuple(grid.agent_pos)
    assert agent.facing == ("east", "south", "west", "north")[grid.agent_dir]
    assert grid.grid.get(key.x, 4 - key.y).type == "key"
    assert grid.grid.get(door.x, 4 - door.y).type == "door"
    assert (key.held, key.colour, door.colour, door.open, door.locked) == (False, "yellow", "yellow", False, True)
    (goal,) = state.scene.of_class("Goal")
    assert (goal.x, goal.y) == (3, 1)
    assert len(state.scene.of_class("Wall")) == 18  # 16 on the outer edge, and 3 inside less the door


@pytest.mark.parametrize("name", ["Empty-5x5", "DoorKey-6x6", "Unlock", "FourRooms"])
def test_states_determine_transitions(name: str) -> None:
    """An action in a state always has the same result, and every change is an effect of some type."""
    adapter, rng = adapted(name), np.random.default_rng(2)
    results = {}
    state = adapter.reset(rng)
    for _ in range(1500):
        transition = adapter.step(Action(ACTIONS[rng.integers(len(ACTIONS))]))
        result = transition.next_state, transition.reward, transition.terminated
        assert results.setdefault((transition.state, transition.action), result) == result
        for item in state.objects:
            after = transition.next_state[item.name]
            for attribute, old, new in zip(item.object_class.attributes, item.values, after.values, strict=True):
                effects = effects_between(attribute, old, new, MINIGRID_EFFECT_TYPES)
                assert effects
                assert all(MINIGRID_EFFECT_TYPES[effect.type].apply(old, effect.argument) == new for effect in effects)
        state = adapter.reset(rng) if transition.terminated else transition.next_state


def test_carried_key_moves_with_the_agent() -> None:
    adapter, rng = adapted("DoorKey-5x5"), np.random.default_rng(0)
    state = adapter.reset(rng)
    while not state.of_class("Key")[0].held:
        state = adapter.step(Action(ACTIONS[rng.integers(4)])).next_state
    agent, (key,) = state["agent"], state.of_class("Key")
    assert (key.x, key.y) == (agent.x, agent.y)


def test_turn_is_an_effect_type() -> None:
    facing = enumeration("facing", "east", "north", "west", "south")
    assert Effect("turn", 1) in effects_between(facing, "south", "east", MINIGRID_EFFECT_TYPES)
    assert MINIGRID_EFFECT_TYPES["turn"].apply("south", 1) == "east"
    assert MINIGRID_EFFECT_TYPES["turn"].describe("agent.facing", 3) == "agent.facing turns right"
    colour = enumeration("colour", "red", "green")
    assert effects_between(colour, "red", "green", MINIGRID_EFFECT_TYPES) == (Effect("assignment", "green"),)


@pytest.mark.parametrize("learner_name", ["doormax", "bayes"])
@pytest.mark.parametrize(
    ("name", "episodes", "seeds"),
    [
        ("Empty-5x5", 5, 4),
        ("DoorKey-5x5", 10, 2),
        ("FourRooms", 6, 2),
        pytest.param("Unlock", 4, 1, marks=pytest.mark.slow),  # slow: the key can be dropped in any cell
    ],
)
def test_learners_become_optimal(name: str, episodes: int, seeds: int, learner_name: str) -> None:
    adapter = adapted(name)
    learner = learner_for(adapter, learner_name)
    train(adapter, learner, episodes)
    assert learner.violations == ()
    for seed in range(100, 100 + seeds):
        assert steps_of_the_learnt_policy(adapter, learner, seed) == fewest_steps(adapter, seed)


def test_rules_of_an_empty_room_solve_four_rooms() -> None:
    small, large = adapted("Empty-Random-5x5"), adapted("FourRooms")
    learner = BayesianLearner(
        small.domain,
        effect_types=MINIGRID_EFFECT_TYPES,
        reward=lambda state, action, next_state: float(is_at_goal(next_state)),
        terminated=is_at_goal,
    )
    rng = np.random.default_rng(0)
    small.reset(rng)
    for _ in range(200):  # random actions
        transition = small.step(Action(ACTIONS[rng.integers(len(ACTIONS))]))
        learner.add_experience(transition)
        if transition.terminated:
            small.reset(rng)
    assert set(learner.sentences()) == {
        "left: if always: agent.facing turns left",
        "right: if always: agent.facing turns right",
        "forward: if agent.facing = north and not ahead(agent, wall): agent.y += 1",
        "forward: if agent.facing = south and not ahead(agent, wall): agent.y -= 1",
        "forward: if agent.facing = east and not ahead(agent, wall): agent.x += 1",
        "forward: if agent.facing = west and not ahead(agent, wall): agent.x -= 1",
    }
    for seed in range(5):
        assert steps_of_the_learnt_policy(large, learner, seed) == fewest_steps(large, seed)


def test_objects_without_a_class_are_refused() -> None:
    with pytest.raises(InputError, match="box: has no class"):
        adapted("UnlockPickup").reset(np.random.default_rng(0))


def test_other_environment_is_refused() -> None:
    with pytest.raises(InputError, match="not one of MiniGrid"):
        MiniGrid(gymnasium.make("Taxi-v4"))


def test_step_before_the_first_reset_is_refused() -> None:
    with pytest.raises(RuntimeError, match="reset"):
        adapted("Empty-5x5").step(Action("left"))
