"""Rewards are learnt as conditions, for every action and the attributes that it changed."""

from __future__ import annotations

from wherry.learning.rewards import Rewards
from wherry.oomdp.effects_outcome import StepReward

MOVED, NOTHING = frozenset({("Robot", "x")}), frozenset[tuple[str, str]]()


def test_rewards_depend_on_what_a_step_changes() -> None:
    rewards = Rewards(3)
    rewards.add("N", 0b001, StepReward(MOVED, -1.0, False))
    rewards.add("N", 0b001, StepReward(NOTHING, -5.0, False))
    assert set(rewards.step_rewards("N", 0b001)) == {StepReward(MOVED, -1.0, False), StepReward(NOTHING, -5.0, False)}
    assert rewards.step_rewards("S", 0b001) == ()


def test_a_condition_never_met_is_unknown_unless_merged_conditions_cover_it() -> None:
    rewards = Rewards(3)
    rewards.add("N", 0b001, StepReward(MOVED, -1.0, False))
    assert rewards.step_rewards("N", 0b011) == ()
    rewards.add("N", 0b111, StepReward(MOVED, -1.0, False))
    assert rewards.step_rewards("N", 0b011) == (StepReward(MOVED, -1.0, False),)
    assert rewards.step_rewards("N", 0b010) == ()


def test_a_constant_reward_can_be_generalized() -> None:
    rewards = Rewards(3, generalize=True)
    rewards.add("N", 0b001, StepReward(MOVED, -1.0, False))
    assert rewards.step_rewards("N", 0b110) == (StepReward(MOVED, -1.0, False),)


def test_conditions_distinguish_two_rewards_of_one_change() -> None:
    rewards = Rewards(2, generalize=True)
    rewards.add("N", 0b01, StepReward(MOVED, -1.0, False))
    rewards.add("N", 0b10, StepReward(MOVED, 9.0, True))
    assert rewards.step_rewards("N", 0b01) == (StepReward(MOVED, -1.0, False),)
    assert rewards.step_rewards("N", 0b10) == (StepReward(MOVED, 9.0, True),)
    assert rewards.step_rewards("N", 0b00) == ()


def test_overlapping_conditions_are_memorised() -> None:
    rewards = Rewards(2)
    for terms, reward in [(0b00, 1.0), (0b11, 1.0), (0b01, 2.0)]:  # 00 ⊕ 11 = ** covers 01
        rewards.add("N", terms, StepReward(MOVED, reward, False))
    known = {terms: [case.reward for case in rewards.step_rewards("N", terms)] for terms in range(4)}
    assert known == {0b00: [1.0], 0b11: [1.0], 0b01: [2.0], 0b10: []}


def test_add_returns_whether_predictions_may_have_changed() -> None:
    rewards = Rewards(2)
    assert rewards.add("N", 0b01, StepReward(MOVED, -1.0, False))
    assert not rewards.add("N", 0b01, StepReward(MOVED, -1.0, False))
    assert rewards.add("N", 0b01, StepReward(MOVED, -2.0, False))
    assert rewards.step_rewards("N", 0b01) == (StepReward(MOVED, -2.0, False),)
