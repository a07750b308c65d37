"""YAML and JSON documents checked against pydantic models; every fault becomes one `InputError`.

A document is described by a subclass of `Document`. Where plain numbers have bounds, annotate them with
`pydantic.Field` (``Annotated[float, Field(gt=0, le=10)]``); the error then names file, field, value and bound.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from wherry.errors import InputError
from wherry.files import read_text

MAX_YAML_BYTES = 64_000  # of a file that people write by hand
MAX_VALUE_CHARACTERS = 40  # of a faulty value that an error quotes
MAX_REASON_CHARACTERS = 200  # of an error's reason, so that the line stays below 300

_Model = TypeVar("_Model", bound=BaseModel)


class Document(BaseModel):
    """A document, or a part of one: no unknown fields, no conversions between types, no infinities."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False, populate_by_name=True)


def load_yaml(path: str | Path, model: type[_Model], *, max_bytes: int = MAX_YAML_BYTES) -> _Model:
    """Read a YAML file into a model; an empty file is an empty mapping.

    Args:
        path: The file.
        model: What it has to contain.
        max_bytes: Size above which the file is refused.

    Raises:
        InputError: The file cannot be read, is not a YAML mapping, or does not fit the model.
    """
    return validate(model, read_yaml(path, max_bytes=max_bytes), path)


def read_yaml(path: str | Path, *, max_bytes: int = MAX_YAML_BYTES) -> dict[Any, Any]:
    """Read a YAML file as a mapping, without checking its fields; an empty file is an empty mapping.

    Raises:
        InputError: The file cannot be read, or is not a YAML mapping.
    """
    return parse_yaml(read_text(path, max_bytes=max_bytes), path)


def parse_yaml(text: str, source: str | Path) -> dict[Any, Any]:
    """Parse YAML text as a mapping, without checking its fields; an empty text is an empty mapping.

    Args:
        text: The document.
        source: File or option that errors name.

    Raises:
        InputError: The text is not a YAML mapping.
    """
    try:
        document = yaml.load(text, _Loader)  # noqa: S506 - a subclass of SafeLoader
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or "it cannot be parsed"
        raise InputError(source, f"line {mark.line + 1}" if mark else "", f"is not YAML: {problem}") from error
    except RecursionError as error:
        raise InputError(source, "", "is nested too deeply") from error
    if document is None:
        return {}
    if not isinstance(document, dict):
        raise InputError(source, "", "is not a mapping of fields to values")
    return document


def load_json(path: str | Path, model: type[_Model], *, max_bytes: int) -> _Model:
    """Read a JSON file into a model.

    Args:
        path: The file.
        model: What it has to contain.
        max_bytes: Size above which the file is refused.

    Raises:
        InputError: The file cannot be read, is not JSON, or does not fit the model.
    """
    text = read_text(path, max_bytes=max_bytes)
    try:
        return model.model_validate_json(text)
    except ValidationError as error:
        raise _input_error(error, path) from error


def validate(model: type[_Model], document: Mapping[Any, Any], source: str | Path) -> _Model:
    """Check a mapping against a model.

    Args:
        model: What the mapping has to contain.
        document: The mapping.
        source: File or option that errors name.

    Raises:
        InputError: The mapping does not fit the model; the error names the first field that does not.
    """
    try:
        return model.model_validate(document)
    except ValidationError as error:
        raise _input_error(error, source) from error


def _input_error(error: ValidationError, source: str | Path) -> InputError:
    """Turn the first fault of a validation into the one line that people see."""
    first = error.errors(include_url=False)[0]
    field = ".".join(str(part) for part in first["loc"])
    return InputError(source, field, _reason(first)[:MAX_REASON_CHARACTERS])


def _reason(fault: ErrorDetails) -> str:
    if fault["type"] == "missing":
        return "is missing"
    if fault["type"] == "extra_forbidden":
        return "is not a known field"
    if fault["type"] == "value_error":  # raised by a model's own validator, in words that need no prefix
        return fault["msg"].removeprefix("Value error, ")
    message = fault["msg"][0].lower() + fault["msg"][1:]
    if fault["type"].startswith("json") or fault["type"] == "recursion_loop":
        return message
    return f"{_quoted(fault['input'])} is refused: {message}"


def _quoted(value: object) -> str:
    text = repr(value)
    return text if len(text) <= MAX_VALUE_CHARACTERS else f"{text[: MAX_VALUE_CHARACTERS - 1]}…"


class _Loader(yaml.SafeLoader):
    """A safe loader that reads 1e-3 as a number, as YAML 1.2 and ROS do and YAML 1.1 does not."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"^[-+]?[0-9]+[eE][-+]?[0-9]+$"), list("-+0123456789")
)
