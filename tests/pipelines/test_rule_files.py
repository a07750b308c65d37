"""Rules files: a loaded learner predicts and learns like the saved one; invalid files are refused."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wherry.baselines.q_learning import QLearning
from wherry.domains.delivery import DeliverySite, all_delivered, delivery_grid, delivery_reward
from wherry.domains.taxi import taxi_grid
from wherry.errors import InputError
from wherry.floorplan.world_files import find_world
from wherry.learning.bayes import BayesianLearner
from wherry.learning.doormax import Doormax
from wherry.learning.effect_rules import Subject
from wherry.learning.registry import RULE_LEARNERS
from wherry.learning.rule_files.files import load_rules, save_rules
from wherry.learning.rules import RuleLearner
from wherry.oomdp.effects import EFFECT_TYPES
from wherry.oomdp.mdp import DeterministicMdp, Prediction
from wherry.oomdp.objects import State
from wherry_testing.machine import ask, machine_domain, teach


def learn_from_random_steps(
    environment: DeterministicMdp, learner: RuleLearner, steps: int, seed: int = 0
) -> list[State]:
    """Let a learner learn from random actions, and return the visited states."""
    rng = np.random.default_rng(seed)
    states = [environment.reset(rng)]
    for _ in range(steps):
        actions = environment.domain.ground_actions(states[-1])
        transition = environment.step(actions[rng.integers(len(actions))])
        learner.add_experience(transition)
        states.append(environment.reset(rng) if transition.terminated else transition.next_state)
    return states


def answers(learner: RuleLearner, states: list[State]) -> list[Prediction]:
    return [learner.predict(state, action) for state in states for action in learner.domain.ground_actions(state)]


MAKERS: dict[str, Callable[..., RuleLearner]] = {
    **{name: entry.factory for name, entry in RULE_LEARNERS.items()},
    "by attribute": partial(Doormax, failure_scope="attribute"),
}


@pytest.mark.parametrize("name", MAKERS)
def test_a_loaded_learner_makes_the_same_predictions(name: str, tmp_path: Path) -> None:
    environment = taxi_grid(5)
    learner = MAKERS[name](environment.domain)
    states = learn_from_random_steps(environment, learner, 600)
    save_rules(learner, tmp_path / "rules.json")
    loaded = load_rules(tmp_path / "rules.json", environment.domain)
    assert answers(loaded, states) == answers(learner, states)
    assert sorted(loaded.sentences()) == sorted(learner.sentences())
    assert any(prediction.most_likely.is_known for prediction in answers(loaded, states))


@pytest.mark.parametrize("name", MAKERS)
def test_a_loaded_learner_goes_on_learning_the_same_way(name: str, tmp_path: Path) -> None:
    environment = delivery_grid(find_world("small"))
    given = {"reward": delivery_reward, "terminated": all_delivered}
    learner = MAKERS[name](environment.domain, **given)
    learn_from_random_steps(environment, learner, 200)
    save_rules(learner, tmp_path / "rules.json")
    loaded = load_rules(tmp_path / "rules.json", environment.domain, **given)
    states = learn_from_random_steps(environment, learner, 200, seed=1)
    learn_from_random_steps(environment, loaded, 200, seed=1)
    assert answers(loaded, states) == answers(learner, states)


def test_revoked_inferences_stay_revoked(tmp_path: Path) -> None:
    learner = Doormax(machine_domain(3), inference="near-miss")
    for switches, after in [("000", 0), ("100", 1), ("010", 1)]:
        teach(learner, switches, (0, after))
    assert learner.near_misses is not None
    assert learner.near_misses.revoked
    save_rules(learner, tmp_path / "rules.json")
    loaded = load_rules(tmp_path / "rules.json", learner.domain)
    assert isinstance(loaded, Doormax)
    assert loaded.near_misses is not None
    assert loaded.near_misses.violations == learner.near_misses.violations
    assert loaded.near_misses.successes == learner.near_misses.successes


def test_an_attribute_learnt_from_its_changes_alone_stays_so(tmp_path: Path) -> None:
    learner = Doormax(machine_domain(3), max_effects=1)
    for switches, after in [("100", 5), ("010", 9)]:
        teach(learner, switches, (0, after))
    subject = next(subject for subject in learner.failures.conditions if isinstance(subject, Subject))
    save_rules(learner, tmp_path / "rules.json")
    loaded = load_rules(tmp_path / "rules.json", learner.domain)
    assert isinstance(loaded, Doormax)
    assert loaded.learns_from_changes_alone(subject)
    assert ask(loaded, "010") == ask(learner, "010")


def test_near_misses_of_single_attributes_are_refused(tmp_path: Path) -> None:
    save_rules(Doormax(machine_domain(3), inference="near-miss"), tmp_path / "rules.json")
    document = json.loads((tmp_path / "rules.json").read_text())
    document["knowledge"]["failure_scope"] = "attribute"
    (tmp_path / "rules.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match="whole actions"):
        load_rules(tmp_path / "rules.json", machine_domain(3))


def test_rules_learnt_in_one_world_hold_in_another(tmp_path: Path) -> None:
    learner = BayesianLearner(taxi_grid(5).domain)
    learn_from_random_steps(taxi_grid(5), learner, 1500)
    save_rules(learner, tmp_path / "rules.json")
    large = taxi_grid(10)
    loaded = load_rules(tmp_path / "rules.json", large.domain)
    for state in learn_from_random_steps(large, BayesianLearner(large.domain), 100):
        for action in large.domain.ground_actions(state):
            assert (
                loaded.predict(state, action).most_likely.next_state
                == large.predict(state, action).most_likely.next_state
            )


def test_fractions_and_removed_types_are_saved(tmp_path: Path) -> None:
    doormax = Doormax(machine_domain(2), effect_types=EFFECT_TYPES)
    teach(doormax, "10", (6, 2))
    teach(doormax, "11", (9, 3))
    save_rules(doormax, tmp_path / "rules.json")
    loaded = load_rules(tmp_path / "rules.json", doormax.domain)
    assert isinstance(loaded, Doormax)
    assert loaded.effect_rules.models == doormax.effect_rules.models
    assert loaded.effect_rules.removed == doormax.effect_rules.removed
    prediction = ask(loaded, "10", counter=6)
    assert prediction.most_likely.next_state is not None
    assert prediction.most_likely.next_state["machine"].counter == 2


def test_a_file_begins_with_sentences(tmp_path: Path) -> None:
    learner = BayesianLearner(taxi_grid(5).domain)
    learn_from_random_steps(taxi_grid(5), learner, 300)
    save_rules(learner, tmp_path / "rules.json")
    document = json.loads((tmp_path / "rules.json").read_text("utf-8"))
    assert list(document)[:3] == ["format", "version", "sentences"]
    assert "N: if not touch_N(taxi, wall): taxi.y += 1" in document["sentences"]


def test_a_learner_without_rules_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="QLearning"):
        save_rules(QLearning(taxi_grid(5).domain, np.random.default_rng(0)), tmp_path / "q.json")  # type: ignore[arg-type]


@pytest.fixture(scope="module", params=list(RULE_LEARNERS))
def document(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    path = tmp_path_factory.mktemp("rules") / "rules.json"
    learner = RULE_LEARNERS[request.param].factory(taxi_grid(5).domain)
    learn_from_random_steps(taxi_grid(5), learner, 300)
    save_rules(learner, path)
    content: dict[str, Any] = json.loads(path.read_text("utf-8"))
    return content


def refusal(document: object, path: Path) -> InputError:
    path.write_text(document if isinstance(document, str) else json.dumps(document), "utf-8")
    with pytest.raises(InputError) as caught:
        load_rules(path, taxi_grid(5).domain)
    assert caught.value.source == str(path)
    return caught.value


@pytest.mark.parametrize("text", ["", "{", "[]", "null", "12", "{" * 100_000, '{"format": "wherry-rules"}', "\x00"])
def test_a_file_without_rules_is_refused(text: str, tmp_path: Path) -> None:
    assert refusal(text, tmp_path / "rules.json").reason


def test_a_missing_an_oversized_and_a_binary_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        load_rules(tmp_path / "none.json", taxi_grid(5).domain)
    (tmp_path / "large.json").write_bytes(b" " * 20_000_001)
    with pytest.raises(InputError, match="larger than"):
        load_rules(tmp_path / "large.json", taxi_grid(5).domain)
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="UTF-8"):
        load_rules(tmp_path / "binary.json", taxi_grid(5).domain)


@pytest.mark.parametrize(
    ("path", "value", "field"),
    [
        (["format"], "rules", "format"),
        (["version"], 2, "version"),
        (["domain", "name"], "chess", "domain.name"),
        (["domain", "terms", 0], "touch_X(taxi, wall)", "domain.terms"),
        (["domain", "actions"], {}, "domain.actions"),
        (["domain", "classes", "Taxi", "x"], "real", "domain.classes"),
        (["knowledge", "learner"], "oracle", "knowledge"),
        (["knowledge", "effect_types"], ["magic"], "knowledge.effect_types"),
        (["knowledge", "rewards", 0, "action"], "JUMP", "knowledge.rewards.0"),
        (["knowledge", "rewards", 0, "changed"], ["Taxi.z"], "knowledge.rewards.0"),
        (["knowledge", "rewards", 0, "worth"], {"01": [1.0, False]}, "knowledge.rewards.0"),
        (["knowledge", "rewards", 0, "worth"], {"0110201": [1.0, False]}, "knowledge."),
        (["extra"], 1, "extra"),
    ],
)
def test_the_error_names_the_broken_field(
    document: dict[str, Any], path: list[str | int], value: object, field: str, tmp_path: Path
) -> None:
    broken = json.loads(json.dumps(document))
    part = broken
    for key in path[:-1]:
        part = part[key]
    part[path[-1]] = value
    assert refusal(broken, tmp_path / "rules.json").field.startswith(field)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"type": "increment", "rules": [{"if": "*******", "then": "far"}]}, "knowledge.predictions.0.rules.0.then"),
        ({"rules": [{"if": "*******", "then": 1}], "removed": "too many effects"}, "knowledge.predictions.0.rules"),
    ],
)
def test_predictions_that_contradict_themselves_are_refused(change: dict[str, Any], field: str, tmp_path: Path) -> None:
    learner = Doormax(taxi_grid(5).domain)
    learn_from_random_steps(taxi_grid(5), learner, 300)
    save_rules(learner, tmp_path / "rules.json")
    broken = json.loads((tmp_path / "rules.json").read_text())
    first = next(entry for entry in broken["knowledge"]["predictions"] if entry["type"] == "increment")
    broken["knowledge"]["predictions"] = [{**first, **change}]
    assert refusal(broken, tmp_path / "rules.json").field == field


@pytest.mark.parametrize("value", ["NaN", "1e999", '"1"', "null"])
def test_rewards_that_are_no_finite_numbers_are_refused(document: dict[str, Any], value: str, tmp_path: Path) -> None:
    broken = json.loads(json.dumps(document))
    broken["knowledge"]["rewards"][0]["worth"] = {"0000000": ["HERE", False]}
    text = json.dumps(broken).replace('"HERE"', value)
    assert "worth" in refusal(text, tmp_path / "rules.json").field or value == "NaN"


SAVING = """
import sys
from wherry.domains.taxi import taxi_grid
from wherry.learning.bayes import BayesianLearner
from wherry.learning.rule_files.files import save_rules
learner = BayesianLearner(taxi_grid(5).domain)
print("ready", flush=True)
while True:
    save_rules(learner, sys.argv[1])
"""


def test_a_killed_save_leaves_a_complete_file(tmp_path: Path) -> None:
    path = tmp_path / "rules.json"
    save_rules(BayesianLearner(taxi_grid(5).domain), path)
    for delay in (0.0, 0.013, 0.029):
        with subprocess.Popen([sys.executable, "-c", SAVING, str(path)], stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(delay)
            os.kill(process.pid, signal.SIGKILL)
        assert isinstance(load_rules(path, taxi_grid(5).domain), BayesianLearner)


def test_saving_into_a_missing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        save_rules(BayesianLearner(DeliverySite.of_plan(find_world("small")).domain), tmp_path / "none" / "rules.json")
