"""Groups of command-line options, as dataclasses whose fields become options.

Typer takes every option as a parameter of its own; `with_option_groups` lets a command take a few groups instead.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterator
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from typing import Any, get_type_hints

from wherry.commands.common import JsonOption, QuietOption
from wherry.commands.watching import LOOPBACK, PORT, HostOption, PortOption, ViewOption


@dataclass(frozen=True, slots=True)
class PageOptions:
    """Options of the page that shows a run.

    Attributes:
        view: Whether to show the run.
        host: Address to serve the page on.
        port: Port to serve the page on.
    """

    view: ViewOption = False
    host: HostOption = LOOPBACK
    port: PortOption = PORT


@dataclass(frozen=True, slots=True)
class OutputOptions:
    """Options of what a command prints.

    Attributes:
        as_json: Whether to print the result as JSON.
        quiet: Whether to print nothing else.
    """

    as_json: JsonOption = False
    quiet: QuietOption = False


def with_option_groups(command: Callable[..., None]) -> Callable[..., None]:
    """A command in whose signature each dataclass is replaced by its fields, in their order."""
    hints = get_type_hints(command, include_extras=True)
    parameters = inspect.signature(command).parameters
    groups = {name: hints[name] for name in parameters if is_dataclass(hints[name])}

    @functools.wraps(command)
    def grouped(**values: Any) -> None:
        for name, group in groups.items():
            values[name] = group(**{field.name: values.pop(field.name) for field in fields(group)})
        command(**values)

    flat: list[inspect.Parameter] = []
    for name, parameter in parameters.items():
        if name in groups:
            flat.extend(_field_parameters(groups[name]))
        else:
            flat.append(parameter.replace(annotation=hints[name], kind=inspect.Parameter.KEYWORD_ONLY))
    grouped.__signature__ = inspect.Signature(flat)  # type: ignore[attr-defined]
    grouped.__annotations__ = {parameter.name: parameter.annotation for parameter in flat}
    return grouped


def _field_parameters(group: type) -> Iterator[inspect.Parameter]:
    """The fields of a dataclass as parameters."""
    hints = get_type_hints(group, include_extras=True)
    for field in fields(group):
        yield inspect.Parameter(
            field.name, inspect.Parameter.KEYWORD_ONLY, default=_default(field), annotation=hints[field.name]
        )


def _default(field: Field[Any]) -> Any:
    """The default of a field as that of a parameter."""
    return inspect.Parameter.empty if field.default is MISSING else field.default
