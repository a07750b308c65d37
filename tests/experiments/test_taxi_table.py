"""The Taxi tables: published figures stand beside ours, and pictures beside the results file."""

from __future__ import annotations

import re
from pathlib import Path

from wherry.experiments.learning.taxi_table import PUBLISHED, TaxiRepetitions, markdown, reproduce
from wherry.experiments.results import write_picture, write_section
from wherry.pipelines.grids.learners import LEARNERS
from wherry.pipelines.grids.learning import LearningExperiment, LearningSettings

QUICK = {(learner, size): 0 for learner in LEARNERS for size in (5, 10)} | {
    ("bayes", 5): 2, ("bayes", 10): 1, ("q-learning", 5): 1, ("doormax", 5): 1, ("doormax", 10): 1,
}  # fmt: skip


def test_published_learners_are_ours_or_people() -> None:
    assert {row.name for row in PUBLISHED} - set(LEARNERS) == {"people", "people who play games"}


def test_a_row_has_what_was_published_and_what_was_measured() -> None:
    experiment = LearningExperiment(LearningSettings(learner="bayes", repetitions=2))
    steps = [repetition.steps for repetition in experiment.repetitions()]
    lines = markdown({5: {"bayes": experiment.result()}}, ["bayes in 2 of 2"], "![a](b)").splitlines()
    (bayes,) = (line for line in lines if line.startswith("| **bayes**"))
    assert f"| – | {sum(steps) / 2:.0f} ± " in bayes
    assert bayes.endswith("| 2/2 |")
    assert "| **doormax** | 529 (ICML 2008) | – | – | 13.88 | – | – |" in lines
    assert any("bayes in 2 of 2" in line for line in lines)


def test_everything_is_run_written_and_shown(tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    extent = TaxiRepetitions(default=2, fewer=QUICK)
    text = reproduce(tmp_path / "images", lambda done, total: told.append((done, total)), extent)
    assert told[-1] == (6, 6)
    for name in ("taxi-steps.svg", "taxi-curves-5.svg", "taxi-curves-10.svg"):
        assert f"(images/{name})" in text
        assert (tmp_path / "images" / name).read_text().startswith("<?xml")
    assert "bayes in 2 of 2, doormax in 1 of 1" in text
    (counted,) = (line for line in text.splitlines() if "nk + k + 1" in line)
    answers = re.findall(r"(\d+) by (\S+) on (\S+) \((\d+)\)", counted)
    assert [(learner, size) for _, learner, size, _ in answers] == [("doormax", "5×5"), ("doormax", "10×10")]
    assert all(0 < int(most) <= int(bound) == 17 for most, _, _, bound in answers)
    write_section(tmp_path / "results.md", "taxi", text)
    assert "`wherry reproduce taxi` wrote this section." in (tmp_path / "results.md").read_text()


def test_a_picture_lands_beside_the_results(tmp_path: Path) -> None:
    assert write_picture(tmp_path / "images", "a.svg", b"<svg/>", "What it shows") == "![What it shows](images/a.svg)"
    assert (tmp_path / "images" / "a.svg").read_bytes() == b"<svg/>"


def test_every_learner_is_repeated_a_hundred_times_on_both_grids() -> None:
    assert {TaxiRepetitions().of(learner, size) for learner in LEARNERS for size in (5, 10)} == {100}
