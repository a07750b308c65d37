"""``wherry doctor``: check the installation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from wherry.commands.common import JsonOption, QuietOption, console_for, print_json

if TYPE_CHECKING:
    from wherry.pipelines.installation import CheckResult


def doctor(as_json: JsonOption = False, quiet: QuietOption = False) -> None:
    """Check which dependencies are installed and work, and print how to install the others.

    Exits with status 1 if a required dependency is broken.
    """
    from wherry.pipelines.installation import CHECKS, failed_check

    console = console_for(as_json=as_json, quiet=quiet)
    results = []
    with console.status("checking") as status:
        for name, check in CHECKS.items():
            status.update(f"checking {name}")
            try:
                results.append(check())
            except Exception as error:  # noqa: BLE001, RUF100 - a broken installation may raise any error
                results.append(failed_check(name, error))
    console.print(_table(results), highlight=False)
    broken = [result.name for result in results if result.is_required and not result.works]
    if broken:
        console.print(f"Broken: {', '.join(broken)}", style="bold red")
    if as_json:
        print_json({result.name: result.as_json() for result in results})
    raise typer.Exit(1 if broken else 0)


def _table(results: list[CheckResult]) -> object:
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False)
    for heading in ("", "dependency", "found", "what to do"):
        table.add_column(heading, overflow="fold")
    for result in results:
        sign, style = ("✓", "green") if result.works else ("✗", "bold red") if result.is_required else ("–", "dim")
        advice = "" if result.works else result.advice
        table.add_row(sign, *map(Text, (result.name, result.detail, advice)), style=style)
    return table
