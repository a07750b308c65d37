"""Stable-Baselines3 trains on the flattened observation of every registered environment."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
import torch
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.env_util import make_vec_env

import wherry.environments

gymnasium.register_envs(wherry.environments)
torch.set_num_threads(1)  # more threads are slower on networks of this size
NAMES = ["wherry/Taxi-v0", "wherry/Delivery-v0"]


class Rewards(BaseCallback):
    """Records the reward of every step."""

    def __init__(self) -> None:
        super().__init__()
        self.values: list[float] = []

    def _on_step(self) -> bool:
        self.values.extend(self.locals["rewards"])
        return True


@pytest.mark.parametrize("name", NAMES)
def test_environment_passes_stable_baselines_checks(name: str) -> None:
    check_env(gymnasium.wrappers.FlattenObservation(gymnasium.make(name)), skip_render_check=False)


def test_ppo_learns_to_avoid_illegal_actions() -> None:
    """Illegal PICKUP and DROPOFF cost 10 in Taxi: a third of all actions at first, and few after training."""
    environments = make_vec_env("wherry/Taxi-v0", n_envs=4, seed=0, wrapper_class=gymnasium.wrappers.FlattenObservation)
    rewards = Rewards()
    trainer = PPO(
        "MlpPolicy", environments, n_steps=64, batch_size=128, n_epochs=4, learning_rate=3e-3, seed=0, device="cpu"
    )
    trainer.learn(3072, callback=rewards)
    assert np.mean(rewards.values[:512]) < -3
    assert np.mean(rewards.values[-512:]) > -2
    environments.close()


@pytest.mark.parametrize("name", NAMES)
def test_dqn_trains_and_acts(name: str) -> None:
    environment = gymnasium.wrappers.FlattenObservation(gymnasium.make(name))
    trainer = DQN("MlpPolicy", environment, learning_starts=50, buffer_size=500, seed=0, device="cpu")
    initial_weights = [weights.clone() for weights in trainer.q_net.parameters()]
    trainer.learn(300)
    assert any(not old.equal(new) for old, new in zip(initial_weights, trainer.q_net.parameters(), strict=True))
    observation, _ = environment.reset(seed=1)
    action, _ = trainer.predict(observation, deterministic=True)
    assert environment.action_space.contains(int(action))
    environment.close()
