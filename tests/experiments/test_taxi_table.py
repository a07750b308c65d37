"""The Taxi tables: published results beside measured ones, and pictures beside the results file."""

from __future__ import annotations

import re
from pathlib import Path

from wherry.experiments.learning.taxi_table import PUBLISHED, TaxiRepetitions, markdown, reproduce
from wherry.experiments.results import write_picture, write_section
from wherry.pipelines.grids.learners import LEARNERS
from wherry.pipelines.grids.learning import LearningExperiment, LearningSettings

FEW = {("bayes", 5): 2, ("bayes", 10): 1, ("q-learning", 5): 1, ("doormax", 5): 1, ("doormax", 10): 1}
NONE = {(learner, size): 0 for learner in LEARNERS for size in (5, 10)}


def test_published_results_are_of_registered_learners_or_of_people() -> None:
    assert {row.name for row in PUBLISHED} - set(LEARNERS) == {"people", "people who play games"}


def test_a_row_shows_the_published_and_the_measured_steps() -> None:
    experiment = LearningExperiment(LearningSettings(learner="bayes", repetitions=2))
    steps = [repetition.steps for repetition in experiment.repetitions()]
    lines = markdown({5: {"bayes": experiment.result()}}, ["bayes in 2 of 2"], "![a](b)").splitlines()
    (bayes,) = (line for line in lines if line.startswith("| **bayes**"))
    assert f"| – | {sum(steps) / 2:.0f} ± " in bayes
    assert bayes.endswith("| 2/2 |")
    assert "| **doormax** | 529 (ICML 2008) | – | – | 13.88 | – | – |" in lines
    assert any("bayes in 2 of 2" in line for line in lines)


def test_reproduce_runs_every_learner_and_writes_tables_and_pictures(tmp_path: Path) -> None:
    calls: list[tuple[int, int]] = []
    repetitions = TaxiRepetitions(default=2, fewer=NONE | FEW)
    text = reproduce(tmp_path / "images", lambda done, total: calls.append((done, total)), repetitions)
    assert calls[-1] == (6, 6)
    for name in ("taxi-steps.svg", "taxi-curves-5.svg", "taxi-curves-10.svg"):
        assert f"(images/{name})" in text
        assert (tmp_path / "images" / name).read_text().startswith("<?xml")
    assert "bayes in 2 of 2, doormax in 1 of 1" in text
    (counts,) = (line for line in text.splitlines() if "nk + k + 1" in line)
    answers = re.findall(r"(\d+) by (\S+) on (\S+) \((\d+)\)", counts)
    assert [(learner, size) for _, learner, size, _ in answers] == [("doormax", "5×5"), ("doormax", "10×10")]
    assert all(0 < int(most) <= int(bound) == 17 for most, _, _, bound in answers)
    write_section(tmp_path / "results.md", "taxi", text)
    assert "`wherry reproduce taxi` wrote this section." in (tmp_path / "results.md").read_text()


def test_a_picture_is_written_beside_the_results(tmp_path: Path) -> None:
    assert write_picture(tmp_path / "images", "a.svg", b"<svg/>", "What it shows") == "![What it shows](images/a.svg)"
    assert (tmp_path / "images" / "a.svg").read_bytes() == b"<svg/>"


def test_every_learner_has_a_hundred_repetitions_on_both_grids() -> None:
    assert {TaxiRepetitions().of(learner, size) for learner in LEARNERS for size in (5, 10)} == {100}
