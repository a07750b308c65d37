"""Registered environments pass Gymnasium's checks, and agree with their domains."""

from __future__ import annotations

import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import wherry.environments
from wherry.domains.taxi import taxi_grid
from wherry.environments.grids import DeliveryEnvironment, ObjectEnvironment, TaxiEnvironment
from wherry.environments.observations import ObservationEncoder
from wherry.errors import InputError
from wherry.oomdp.attributes import enumeration, integer, real
from wherry.oomdp.conditional_models import PerStateModel
from wherry.oomdp.domain import Action
from wherry.oomdp.objects import ObjectClass, State
from wherry.planning.value_iteration import ValueIteration

VARIANTS = [
    ("wherry/Taxi-v0", {}),
    ("wherry/Taxi-v0", {"size": 10}),
    ("wherry/Delivery-v0", {}),
    ("wherry/Delivery-v0", {"world": "rooms", "boxes": 3}),
]
IDS = ["taxi", "taxi10", "delivery", "rooms"]

gymnasium.register_envs(wherry.environments)


def unwrapped(name: str, **settings: object) -> ObjectEnvironment:
    environment = gymnasium.make(name, **settings).unwrapped
    assert isinstance(environment, ObjectEnvironment)
    return environment


@pytest.mark.parametrize(("name", "settings"), VARIANTS, ids=IDS)
def test_environment_passes_gymnasiums_checks_without_warnings(name: str, settings: dict) -> None:
    check_env(unwrapped(name, **settings))


def test_name_with_a_module_registers_the_environments() -> None:
    program = "import gymnasium; print(gymnasium.make('wherry.environments:wherry/Taxi-v0').spec.id)"
    completed = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert completed.stdout.strip() == "wherry/Taxi-v0"


@pytest.mark.parametrize(("name", "settings"), VARIANTS, ids=IDS)
def test_synchronous_vector_environment(name: str, settings: dict) -> None:
    environments = gymnasium.make_vec(name, num_envs=3, vectorization_mode="sync", **settings)
    observations, info = environments.reset(seed=4)
    assert observations in environments.observation_space
    assert info["action_mask"].shape == (3, 6)
    assert info["terms"].shape == (3, 7)
    environments.action_space.seed(4)
    for _ in range(20):
        observations, rewards, *_ = environments.step(environments.action_space.sample())
        assert observations in environments.observation_space
        assert rewards.shape == (3,)
    environments.close()


def test_vector_environment_in_processes() -> None:
    environments = gymnasium.make_vec("wherry.environments:wherry/Taxi-v0", num_envs=2, vectorization_mode="async")
    observations, _ = environments.reset(seed=4)
    assert observations in environments.observation_space
    environments.close()


@pytest.mark.parametrize(("name", "settings"), VARIANTS, ids=IDS)
def test_action_mask_and_terms_agree_with_the_domain(name: str, settings: dict) -> None:
    environment = unwrapped(name, **settings)
    environment.action_space.seed(1)
    _, info = environment.reset(seed=1)
    effective_actions = 0
    for _ in range(300):
        before, mask = environment.state, info["action_mask"]
        assert "".join(map(str, info["terms"])) == str(environment.domain.cond(before))
        action = environment.action_space.sample()
        _, _, terminated, _, info = environment.step(action)
        assert mask[action] == (environment.state != before)
        effective_actions += int(mask[action])
        if terminated:
            _, info = environment.reset()
    assert 20 < effective_actions < 280


def test_observation_has_the_objects_attributes() -> None:
    environment = unwrapped("wherry/Taxi-v0")
    observation, _ = environment.reset(seed=2)
    taxi, passenger = environment.state["taxi"], environment.state["passenger"]
    assert observation["taxi"] == {"x": taxi.x, "y": taxi.y}
    assert observation["passenger"] == {"x": passenger.x, "y": passenger.y, "in_taxi": 0}


def test_delivered_box_does_not_exist_in_the_observation() -> None:
    environment = unwrapped("wherry/Delivery-v0", boxes=2)
    observation, _ = environment.reset(seed=0)
    assert [observation[name]["exists"] for name in ("box1", "box2")] == [1, 1]
    encoded = environment._encoder.encode(environment.state.without("box1"))
    assert encoded["box1"] == {"x": 0, "y": 0, "in_bot": 0, "exists": 0}
    assert encoded in environment.observation_space


def test_enumerations_and_reals_are_encoded() -> None:
    lamp = ObjectClass("Lamp", (enumeration("colour", "red", "green"), real("height", 0, 2)))
    state = State((lamp("lamp", colour="green", height=1.5),))
    encoder = ObservationEncoder(state)
    observation = encoder.encode(state)
    assert observation in encoder.space
    assert (observation["lamp"]["colour"], observation["lamp"]["height"].tolist()) == (1, [1.5])


def test_attribute_without_bounds_is_refused() -> None:
    item = ObjectClass("Item", (integer("x"),))
    with pytest.raises(ValueError, match="x needs bounds"):
        ObservationEncoder(State((item("item", x=0),)))


def test_optimal_policy_obtains_the_optimal_return() -> None:
    environment = unwrapped("wherry/Taxi-v0")
    grid = taxi_grid(5)
    planner = ValueIteration(PerStateModel(grid.domain, grid), discount=0.99)
    environment.reset(seed=5)
    state, total = environment.state, 0.0
    for _ in range(40):
        action = planner.policy(environment.state)
        _, reward, terminated, _, _ = environment.step(np.int64(environment.actions.index(action)))
        total += reward
        if terminated:
            break
    assert terminated
    steps = 1
    while not (transition := grid.transition(state, planner.policy(state))).terminated:
        state, steps = transition.next_state, steps + 1
    assert total == 20 - (steps - 1)


def test_text_rendering() -> None:
    environment = TaxiEnvironment(render_mode="ansi")
    assert environment.render() is None
    environment.reset(seed=0)
    environment.state = taxi_grid(5).state_of((2, 2), "Y", "R")
    assert (
        environment.render()
        == """\
+---+---+---+---+---+
| dR    |         G |
+   +   +   +   +   +
|       |           |
+   +   +   +   +   +
|         T         |
+   +   +   +   +   +
|   |       |       |
+   +   +   +   +   +
| pY|       | B     |
+---+---+---+---+---+
"""
    )
    environment.state = environment.state.replace("passenger", in_taxi=True)
    assert " Tp" in environment.render()


def test_images_change_where_the_robot_moves() -> None:
    environment = DeliveryEnvironment("small", render_mode="rgb_array")
    environment.reset(seed=0)
    before = environment.render()
    east = environment.actions.index(Action("E"))
    environment.step(np.int64(east))
    after = environment.render()
    assert before.shape == after.shape == (6 * 48, 8 * 48, 3)
    assert before.dtype == np.uint8
    changed = np.argwhere((before != after).any(axis=2))
    assert changed.min(axis=0).tolist() >= [0, 0]
    assert changed.max(axis=0).tolist() <= [48, 96]  # the two cells in the north-west


@pytest.mark.parametrize(
    ("name", "settings", "field"),
    [
        ("wherry/Taxi-v0", {"size": 7}, "size"),
        ("wherry/Delivery-v0", {"world": "nowhere"}, "nowhere"),
        ("wherry/Delivery-v0", {"boxes": 10_000}, "boxes"),
    ],
)
def test_invalid_setting_is_refused_with_its_name(name: str, settings: dict, field: str) -> None:
    with pytest.raises(InputError, match=field):
        gymnasium.make(name, **settings)


def test_unknown_render_mode_is_refused() -> None:
    with pytest.raises(InputError, match="is not one of ansi, rgb_array"):
        TaxiEnvironment(render_mode="hologram")


@pytest.mark.parametrize(("name", "settings"), VARIANTS, ids=IDS)
def test_observations_flatten_to_one_hot_vectors(name: str, settings: dict) -> None:
    environment = gymnasium.wrappers.FlattenObservation(gymnasium.make(name, **settings))
    observation, _ = environment.reset(seed=0)
    attributes = sum(len(space) for space in environment.unwrapped.observation_space.values())
    assert observation in environment.observation_space
    assert set(observation) == {0, 1}
    assert observation.sum() == attributes


@pytest.mark.parametrize(("name", "settings"), VARIANTS, ids=IDS)
def test_linear_policy_trains_on_flattened_observations(name: str, settings: dict) -> None:
    """Finite vectors of one shape and type through many episodes, as Stable-Baselines3 needs them."""
    count, steps = 4, 300
    environments = gymnasium.make_vec(
        name, count, vectorization_mode="sync", wrappers=[gymnasium.wrappers.FlattenObservation], **settings
    )
    space, actions = environments.single_observation_space, environments.single_action_space
    assert isinstance(space, gymnasium.spaces.Box | gymnasium.spaces.MultiBinary | gymnasium.spaces.MultiDiscrete)
    assert isinstance(actions, gymnasium.spaces.Discrete)
    rng = np.random.default_rng(0)
    observations, _ = environments.reset(seed=0)
    assert observations.shape == (count, *space.shape)
    weights, total_reward = np.zeros((space.shape[0], int(actions.n))), 0.0
    for _ in range(steps):
        scores = observations @ weights + rng.gumbel(size=(count, int(actions.n)))
        chosen_actions = scores.argmax(axis=1)
        next_observations, rewards, terminated, truncated, _ = environments.step(chosen_actions)
        assert (next_observations.shape, next_observations.dtype) == (observations.shape, observations.dtype)
        assert np.isfinite(rewards).all()
        for row, action, reward in zip(observations, chosen_actions, rewards, strict=True):
            weights[:, action] += 0.01 * reward * row
        observations, total_reward = next_observations, total_reward + float(rewards.sum())
        assert not (terminated & truncated).any()
    assert np.isfinite(weights).all()
    assert -10 * count * steps <= total_reward < 0
    environments.close()
