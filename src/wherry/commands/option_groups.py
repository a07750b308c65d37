"""Groups of command-line options: dataclasses whose fields become options.

Typer takes each option as a parameter; with `with_option_groups` a command takes a few groups instead.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterator
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Any, get_type_hints


def with_option_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Replace each dataclass in the signature of a command by its fields.

    Fields are annotated as typer's parameters are. Options keep the order of parameters and fields. Required
    options may follow optional ones.
    """
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
    grouped.__signature__ = inspect.Signature(flat)  # type: ignore[attr-defined]  # read by typer
    grouped.__annotations__ = {parameter.name: parameter.annotation for parameter in flat}
    return grouped


def _field_parameters(group: type) -> Iterator[inspect.Parameter]:
    """The fields of a dataclass as keyword-only parameters."""
    hints = get_type_hints(group, include_extras=True)
    for field in fields(group):
        yield inspect.Parameter(
            field.name, inspect.Parameter.KEYWORD_ONLY, default=_default(field), annotation=hints[field.name]
        )


def _default(field: Field[Any]) -> Any:
    """The default value of a field; Parameter.empty if it has none."""
    return inspect.Parameter.empty if field.default is MISSING else field.default
