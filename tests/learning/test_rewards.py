"""Rewards are learnt as conditions, for every action and what it changed."""

from __future__ import annotations

from wherry.learning.rewards import Rewards
from wherry.oomdp.effects_outcome import StepReward

MOVED, NOTHING = frozenset({("Robot", "x")}), frozenset[tuple[str, str]]()


def test_every_change_has_its_worth() -> None:
    rewards = Rewards(3)
    rewards.add("N", 0b001, StepReward(MOVED, -1.0, False))
    rewards.add("N", 0b001, StepReward(NOTHING, -5.0, False))
    assert set(rewards.step_rewards("N", 0b001)) == {StepReward(MOVED, -1.0, False), StepReward(NOTHING, -5.0, False)}
    assert rewards.step_rewards("S", 0b001) == ()


def test_a_condition_never_met_is_unknown_unless_it_lies_between() -> None:
    rewards = Rewards(3)
    rewards.add("N", 0b001, StepReward(MOVED, -1.0, False))
    assert rewards.step_rewards("N", 0b011) == ()
    rewards.add("N", 0b111, StepReward(MOVED, -1.0, False))
    assert rewards.step_rewards("N", 0b011) == (StepReward(MOVED, -1.0, False),)
    assert rewards.step_rewards("N", 0b010) == ()


def test_one_worth_for_all_conditions_can_be_assumed() -> None:
    rewards = Rewards(3, generalize=True)
    rewards.add("N", 0b001, StepReward(MOVED, -1.0, False))
    assert rewards.step_rewards("N", 0b110) == (StepReward(MOVED, -1.0, False),)


def test_conditions_tell_two_worths_of_one_change_apart() -> None:
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


def test_only_news_are_news() -> None:
    rewards = Rewards(2)
    assert rewards.add("N", 0b01, StepReward(MOVED, -1.0, False))
    assert not rewards.add("N", 0b01, StepReward(MOVED, -1.0, False))
    assert rewards.add("N", 0b01, StepReward(MOVED, -2.0, False))
    assert rewards.step_rewards("N", 0b01) == (StepReward(MOVED, -2.0, False),)
