"""The command line: registers the commands, and reports errors.

Exit status: 0 success, 1 the run ended without reaching its goal, 2 invalid input or usage, 130 stopped by Ctrl-C.
"""

from __future__ import annotations

import sys
from typing import Annotated

import typer
from typer.exceptions import TyperException

from wherry import __version__
from wherry.commands.bench import bench
from wherry.commands.common import help_without_command
from wherry.commands.deliver import deliver
from wherry.commands.doctor import doctor
from wherry.commands.export import export_app
from wherry.commands.learn import learn
from wherry.commands.localize import localize
from wherry.commands.map import map_log
from wherry.commands.play import play
from wherry.commands.replay import replay
from wherry.commands.reproduce import reproduce
from wherry.commands.ros import ros_app
from wherry.commands.rviz import rviz
from wherry.commands.view import view
from wherry.commands.worlds import worlds
from wherry.errors import InputError
from wherry.interrupts import resend_dropped_interrupts

INVALID_INPUT = 2  # exit status for invalid input or usage
STOPPED = 130  # exit status for Ctrl-C: 128 + SIGINT

app = typer.Typer(
    name="wherry",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # importing rich would more than double the time of --help
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command()(deliver)
app.command("map")(map_log)
app.command()(localize)
app.command()(learn)
app.command()(play)
app.command()(bench)
app.command()(doctor)
app.command()(replay)
app.command()(reproduce)
app.command()(rviz)
app.command()(view)
app.add_typer(worlds, name="worlds")
app.add_typer(export_app, name="export")
app.add_typer(ros_app(1), name="ros1")
app.add_typer(ros_app(2), name="ros2")


def main() -> None:
    """Run a command; report invalid input or usage in one line and exit with status 2."""
    stopped = "stopped"
    try:
        with resend_dropped_interrupts():
            status = app(prog_name="wherry", standalone_mode=False) or 0
    except (InputError, TyperException) as error:
        _print_error(str(error) if isinstance(error, InputError) else format_usage_error(error))
        status = INVALID_INPUT
    except (KeyboardInterrupt, typer.Abort) as error:
        status = STOPPED
        stopped = str(error) or stopped
    if status == STOPPED:
        _print_error(stopped)
    sys.exit(status)


def format_usage_error(error: TyperException) -> str:
    """A usage error as one line that begins with the option or argument."""
    parameter = getattr(error, "param", None)
    if parameter is None:
        name = getattr(error, "option_name", "")
        reason = error.format_message()
    else:
        longest = max(parameter.opts, key=len)
        name = longest if longest.startswith("-") else longest.upper()
        reason = error.message.replace("Input should be", "must be").partition(", unable")[0] or "is missing"
    reason = " ".join(reason.split()).removesuffix(".").replace(f": {name}", "")
    return f"{name}: {reason[:1].lower()}{reason[1:]}" if name else f"{reason[:1].lower()}{reason[1:]}"


def _print_error(line: str) -> None:
    print(f"wherry: {line}", file=sys.stderr)  # noqa: T201 - errors are printed here only


def _show_version(is_requested: bool) -> None:
    if is_requested:
        typer.echo(f"wherry {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def main_options(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Robots that learn a model of their world, map it, localize, and deliver."""
    help_without_command(context)
