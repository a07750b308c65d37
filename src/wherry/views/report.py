"""The report of a delivery: one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

from wherry.trace.records import Narration
from wherry.views.templates import render_template


@dataclass(frozen=True, slots=True)
class ReportPicture:
    """A drawing with its caption.

    Attributes:
        svg: An SVG element from `snapshot_svg.draw_snapshot`.
        caption: Plain text.
    """

    svg: str
    caption: str


@dataclass(frozen=True, slots=True)
class DeliveryReport:
    """Content of the report.

    Attributes:
        title: Heading of the page.
        verdict: Result of the delivery in two or three words.
        is_success: Whether the verdict has the colour of a success.
        summary: Sentence below the heading.
        pictures: At least one picture; the first is shown large.
        metrics: Formatted values of the metrics, by label.
        rules: The learnt rules, one sentence each.
        log: The narrations, in order of time.
    """

    title: str
    verdict: str
    is_success: bool
    summary: str
    pictures: Sequence[ReportPicture]
    metrics: Mapping[str, str]
    rules: Sequence[str]
    log: Sequence[Narration]


def render_report(report: DeliveryReport) -> str:
    """The report as HTML; all text in it is escaped."""
    return render_template("report.html.j2", **{field.name: getattr(report, field.name) for field in fields(report)})
