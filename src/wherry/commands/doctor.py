"""``wherry doctor``: what is installed, what works, and what to do about the rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from wherry.commands.common import JsonOption, QuietOption, console_for, print_json

if TYPE_CHECKING:
    from wherry.pipelines.installation import Finding


def doctor(as_json: JsonOption = False, quiet: QuietOption = False) -> None:
    """Say what is installed and works here, and what to do about what is not.

    Exit status 1 where something is broken that wherry cannot do without.
    """
    from wherry.pipelines.installation import CHECKS, failed

    console = console_for(as_json=as_json, quiet=quiet)
    findings = []
    with console.status("looking") as status:
        for name, check in CHECKS.items():
            status.update(f"looking at {name}")
            try:
                findings.append(check())
            except Exception as error:  # noqa: BLE001, RUF100 - a broken installation may raise anything
                findings.append(failed(name, error))
    console.print(_table(findings), highlight=False)
    broken = [finding.name for finding in findings if finding.required and not finding.works]
    if broken:
        console.print(f"Broken: {', '.join(broken)}", style="bold red")
    if as_json:
        print_json({finding.name: {"works": finding.works, "detail": finding.detail, "advice": finding.advice,
                                   "required": finding.required} for finding in findings})  # fmt: skip
    raise typer.Exit(1 if broken else 0)


def _table(findings: list[Finding]) -> object:
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False)
    for heading in ("", "what", "found", "what to do"):
        table.add_column(heading, overflow="fold")
    for finding in findings:
        sign, style = ("✓", "green") if finding.works else ("✗", "bold red") if finding.required else ("–", "dim")
        advice = "" if finding.works else finding.advice
        table.add_row(sign, *map(Text, (finding.name, finding.detail, advice)), style=style)
    return table
