"""wherry learn: its JSON, learning curves, and rejected input."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PIL import Image

from wherry.commands import learn as command
from wherry.pipelines.grids.arenas import ARENAS
from wherry.pipelines.grids.learners import LEARNERS
from wherry_testing.command_line import RunCommand

DOCUMENTED_KEYS = {"steps_mean", "steps_sd", "steps_p95", "converged", "repetitions", "ms_per_step"}


def test_the_last_line_is_json_and_the_curve_is_an_image(run_command: RunCommand, tmp_path: Path) -> None:
    files = ("--out", tmp_path / "curve.png", "--rules-out", tmp_path / "rules.json")
    status, out, err = run_command("learn", "taxi", "--inference", "near-miss", "--repetitions", 2, "--json", *files)
    assert status == 0
    result = json.loads(out)
    assert set(result) >= DOCUMENTED_KEYS
    assert (result["converged"], result["repetitions"], result["learner"]) == (2, 2, "doormax-near-miss")
    assert "N: if not touch_N(taxi, wall): taxi.y += 1" in err
    with Image.open(tmp_path / "curve.png") as picture:
        assert min(picture.size) > 500
        assert picture.convert("RGB").getpixel((3, 3)) == (255, 255, 255)
    assert json.loads((tmp_path / "rules.json").read_text())["domain"]["name"] == "taxi"


def test_near_misses_need_fewer_steps_than_memorised_failures(run_command: RunCommand) -> None:
    def steps(inference: str) -> float:
        _, out, _ = run_command("learn", "taxi", "--inference", inference, "--repetitions", 3, "--json", "--quiet")
        mean: float = json.loads(out)["steps_mean"]
        return mean

    assert steps("near-miss") < steps("memorise")


def test_the_delivery_domain_can_be_learnt(run_command: RunCommand) -> None:
    status, out, err = run_command("learn", "delivery", "--learner", "bayes", "--repetitions", 1, "--quiet", "--json")
    assert (status, err) == (0, "")
    assert json.loads(out)["domain"] == "delivery"


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["chess"], "wherry: DOMAIN: chess: is none of taxi, delivery, gymnasium-taxi\n"),
        (["taxi", "--inference", "guess"], "wherry: --inference: guess: is none of memorise, near-miss\n"),
        (
            ["taxi", "--learner", "bayes", "--inference", "near-miss"],
            "wherry: --inference: near-miss: is an option of doormax, not of bayes\n",
        ),
        (["taxi", "--out", "curve.jpg"], "wherry: --out: curve.jpg: must end in .png or .svg\n"),
        (
            ["taxi", "--learner", "rmax", "--rules-out", "rules.json"],
            "wherry: --rules-out: rules.json: rmax learns no rules that could be saved\n",
        ),
        (["taxi", "--learner", "oracle", "--rules-out", "rules.json"], "wherry: --learner: oracle: is none of bayes, "),
        (["taxi", "--size", "7"], "wherry: --size: 7: is none of 5, 10\n"),
        (["delivery", "--world", "nowhere"], "wherry: nowhere: is neither a file nor one of the worlds"),
    ],
)
def test_invalid_input_is_rejected_in_one_line(run_command: RunCommand, arguments: list[str], line: str) -> None:
    status, out, err = run_command("learn", *arguments)
    assert (status, out) == (2, "")
    assert err.startswith(line)
    assert err.count("\n") == 1


def test_the_command_offers_all_domains_and_learners() -> None:
    assert tuple(ARENAS) == command.DOMAINS
    assert {*command.LEARNER_CHOICES, *command.INFERENCES.values()} == set(LEARNERS)
