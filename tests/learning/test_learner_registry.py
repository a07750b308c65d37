"""The registry of learners: every entry's factory, codec and counter work together."""

from __future__ import annotations

import subprocess
import sys

import pytest

from wherry.learning.bounds import UnknownAnswers
from wherry.learning.registry import RULE_LEARNERS, Job, learners_for
from wherry.learning.rule_files.files import load_rules, save_rules
from wherry_testing.machine import machine_domain


@pytest.mark.parametrize("name", RULE_LEARNERS)
def test_a_registered_learner_can_be_made_and_its_rules_saved(name: str, tmp_path) -> None:
    entry = RULE_LEARNERS[name]
    learner = entry.factory(machine_domain(3), terminated=lambda state: False)
    assert entry.has_rules
    assert entry.summary
    save_rules(learner, tmp_path / "rules.json")
    assert type(load_rules(tmp_path / "rules.json", learner.domain)) is type(learner)


def test_unknown_answers_are_counted_only_where_there_is_a_bound() -> None:
    for entry in RULE_LEARNERS.values():
        counter = entry.count_unknown_answers(entry.factory(machine_domain(3)))
        assert isinstance(counter, UnknownAnswers) == (entry.counter is not None)
    assert RULE_LEARNERS["bayes"].counter is None
    assert RULE_LEARNERS["doormax"].counter is not None


def test_learners_are_listed_by_job_in_the_registrys_order() -> None:
    deliver, play = (list(learners_for(job, RULE_LEARNERS)) for job in (Job.DELIVERY, Job.PLAY))
    assert {"bayes", "doormax"} <= set(deliver)
    assert "doormax-near-miss" in set(play) - set(deliver)
    assert play == [name for name in RULE_LEARNERS if name in play]


def test_listing_the_learners_imports_none_of_them() -> None:
    listing = "import sys; from wherry.learning.registry import RULE_LEARNERS; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", listing], check=True, capture_output=True, text=True)
    assert not {"wherry.learning.doormax", "wherry.learning.bayes", "numpy", "pydantic"} & set(done.stdout.split())
