"""The picture page of a delivery: one HTML file that opens from disk, without a server or a network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources

import jinja2

from wherry.trace.records import Narration


@dataclass(frozen=True, slots=True)
class Picture:
    """A drawing and what it shows.

    Attributes:
        svg: An SVG element, made by `drawing.draw`.
        caption: Plain text.
    """

    svg: str
    caption: str


@dataclass(frozen=True, slots=True)
class Report:
    """Everything that the page shows.

    Attributes:
        title: The page's heading.
        verdict: Two or three words.
        good: Whether the verdict is a good one.
        lead: A sentence below the heading.
        pictures: The first is shown large; at least one.
        figures: What was measured, name to value.
        rules: The learnt rules in words.
        log: What the robot said.
    """

    title: str
    verdict: str
    good: bool
    lead: str
    pictures: Sequence[Picture]
    figures: Mapping[str, str]
    rules: Sequence[str]
    log: Sequence[Narration]


def render(report: Report) -> str:
    """The page as HTML; every text in it is escaped."""
    template = resources.files("wherry.views").joinpath("templates/report.html.j2").read_text("utf-8")
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=False)
    return environment.from_string(template).render(
        title=report.title,
        verdict=report.verdict,
        good=report.good,
        lead=report.lead,
        pictures=report.pictures,
        figures=report.figures,
        rules=report.rules,
        log=report.log,
    )
