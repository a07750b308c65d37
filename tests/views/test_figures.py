"""People get words and units for every figure that JSON has."""

from __future__ import annotations

from dataclasses import asdict, fields
from types import SimpleNamespace
from typing import cast

import pytest
from rich.console import Console

from wherry.mapping import closures
from wherry.pipelines.grids import learning as taxi
from wherry.pipelines.logs import localization
from wherry.pipelines.logs import mapping as slam
from wherry.ros.names import load_names
from wherry.ros.nodes.monitor import Monitor
from wherry.ros.transports.protocol import Transport
from wherry.views.figures import HEARD, LEARNING, LOCALIZATION, MAPPING, REFUSALS, Words, in_words
from wherry.views.terminal import print_figures

MAPPED = slam.Result(0.0504, 0.041, 0.523, 0.61, 9998, None, 0.6947, 23.36, 2.061, 196, 158, 910, 0, "graph", "a.log")


class Deaf:
    """A transport on which nothing is heard."""

    ros_version = 2

    def subscribe(self, *of: object) -> None: ...


def names_of(result: type) -> set[str]:
    return {field.name for field in fields(result)}


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (names_of(slam.Result) - {"log"}, MAPPING),
        (names_of(localization.LocalizationResult), LOCALIZATION),
        (names_of(taxi.Result) - {"settings", "runs"} | {"learner", "seed"}, LEARNING),
        (set(Monitor(cast(Transport, Deaf()), load_names()).figures()), HEARD),
    ],
)
def test_every_figure_has_words(names: set[str], words: Words) -> None:
    assert names == set(words)
    assert not any("_" in text for text, _ in words.values())


def test_figures_come_with_their_units() -> None:
    rows = in_words(asdict(MAPPED), MAPPING)
    assert rows[3:7] == [
        ("true relations to score by", "9,998"),
        ("translational error (mean)", "0.050 m"),
        ("translational error (standard deviation)", "0.041 m"),
        ("rotational error (mean)", "0.52°"),
    ]
    assert rows[-3:] == [
        ("processor time a scan (median)", "0.69 ms"),
        ("processor time a scan (99th percentile)", "23.36 ms"),
        ("processor time in all", "2.1 s"),
    ]


def test_a_place_a_share_and_names_are_told_in_words() -> None:
    figures: dict[str, object] = dict.fromkeys(LOCALIZATION) | {
        "final_pose": (1.24, -0.8441, -2.854),
        "lost_fraction": 0.0125,
        "unknown_parameters": (),
        "particles_mean": 1999.96,
    }
    assert dict(in_words(figures, LOCALIZATION)) == {
        "where it ended": "x 1.24 m, y -0.84 m, heading -164°",
        "scans at which it was probably lost": "1.2 %",
        "unknown parameters": "none",
        "particles (mean)": "2,000.0",
    }


def test_what_was_not_measured_is_said_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    print_figures(Console(width=100), "Map of a.log", asdict(MAPPED), MAPPING)
    printed = capsys.readouterr().out
    assert "│ translational error (mean) " in printed
    assert "Not measured: translational error over more than a minute.\n" in printed


def test_every_gate_that_refuses_loops_has_words() -> None:
    reasons = ("response 0.31 is below 0.45", "ambiguous: another place has response 0.6", "overlap 0.1 is below 0.6")
    tried = [cast(closures.Closure, SimpleNamespace(refused=reason)) for reason in reasons]
    assert set(closures.refusals(tried)) == set(REFUSALS)
