"""YAML and JSON documents, validated with pydantic models; an invalid one raises `InputError`.

A subclass of `Document` describes a document. Bounds of numbers are annotated with `pydantic.Field`, as in
``Annotated[Number, Field(gt=0, le=10)]``; the error then names file, field, value and bound. Fields of YAML files are
`Number`, `Integer` and `Flag`, which accept what ROS accepts.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

import yaml
from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from wherry.errors import InputError
from wherry.files import read_text
from wherry.yaml_parser import DocumentError, Yaml12Loader, number_of

MAX_YAML_BYTES = 64_000  # size of a file that is written by hand
MAX_VALUE_CHARACTERS = 40  # length of an invalid value as quoted in an error
MAX_REASON_CHARACTERS = 200  # length of an error's reason; with file and field the line stays below 300

# First line of OpenCV's files, which is not YAML
OPENCV_DIRECTIVE = re.compile(r"\A\ufeff?%YAML:1\.[0-9][ \t]*(?=\r?\n)")
FLAGS = {  # words that yaml-cpp and ROS 2's parser of parameters read as booleans
    **dict.fromkeys(("true", "yes", "on", "y", "1"), True),
    **dict.fromkeys(("false", "no", "off", "n", "0"), False),
}

_Model = TypeVar("_Model", bound=BaseModel)


def _read_number(value: object) -> object:
    """A quoted number as a number; any other value as it is."""
    if not isinstance(value, str):
        return value
    try:
        number = number_of(value.strip())
    except ValueError:
        return value
    return value if number is None else number


def _read_integer(value: object) -> object:
    """A quoted number, or a whole number written as 1e3 or 1.0, as an integer; any other value as it is."""
    number = _read_number(value)
    return int(number) if isinstance(number, float) and number.is_integer() else number


def _read_flag(value: object) -> object:
    """A boolean from its words in ROS, or from 0 or 1; any other value as it is."""
    if isinstance(value, bool) or not isinstance(value, str | int):
        return value
    return FLAGS.get(str(value).strip().lower(), value)


# Types of fields in YAML files. As in ROS, numbers and booleans may be quoted; a word is never a number.
Number = Annotated[float, BeforeValidator(_read_number)]
Integer = Annotated[int, BeforeValidator(_read_integer)]
Flag = Annotated[bool, BeforeValidator(_read_flag)]


class Document(BaseModel):
    """Base of the models: unknown fields, values of other types, infinities and NaN are errors."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False, populate_by_name=True)


def load_yaml(path: str | Path, model: type[_Model], *, max_bytes: int = MAX_YAML_BYTES) -> _Model:
    """Read a YAML file into a model; an empty file is an empty mapping.

    Args:
        path: The file.
        model: Model that the content has to fit.
        max_bytes: Largest permitted size of the file, bytes.

    Raises:
        InputError: The file cannot be read, is not a YAML mapping, or does not fit the model.
    """
    return validate(model, read_yaml(path, max_bytes=max_bytes), path)


def read_yaml(path: str | Path, *, max_bytes: int = MAX_YAML_BYTES) -> dict[Any, Any]:
    """Read a YAML file as a mapping without validation; an empty file is an empty mapping.

    Args:
        path: The file.
        max_bytes: Largest permitted size of the file, bytes.

    Raises:
        InputError: The file cannot be read, or is not a YAML mapping.
    """
    return parse_yaml(read_text(path, max_bytes=max_bytes), path)


def parse_yaml(text: str, source: str | Path) -> dict[Any, Any]:
    """Parse YAML text as a mapping without validation; an empty text is an empty mapping.

    Args:
        text: The document.
        source: File or option that errors name.

    Raises:
        InputError: The text is not a YAML mapping.
    """
    try:
        text = OPENCV_DIRECTIVE.sub("", text, count=1)
        document = yaml.load(text, Yaml12Loader)  # noqa: S506 - a subclass of SafeLoader
    except yaml.YAMLError as error:
        raise _yaml_error(error, source) from error
    except RecursionError as error:
        raise InputError(source, "", "is nested too deeply") from error
    if document is None:
        return {}
    if not isinstance(document, dict):
        raise InputError(source, "", "is not a mapping of fields to values")
    return document


def _yaml_error(error: yaml.YAMLError, source: str | Path) -> InputError:
    """Convert the error of a text that is not YAML, or beyond the limits, into a one-line `InputError`."""
    mark = getattr(error, "problem_mark", None)
    problem = (getattr(error, "problem", None) or "it cannot be parsed")[:MAX_REASON_CHARACTERS]
    if isinstance(error, yaml.reader.ReaderError):
        problem = f"the character {error.character!r} is not permitted"
    reason = problem if isinstance(error, DocumentError) else f"is not YAML: {problem}"
    return InputError(source, f"line {mark.line + 1}" if mark else "", reason)


def load_json(path: str | Path, model: type[_Model], *, max_bytes: int) -> _Model:
    """Read a JSON file into a model.

    Args:
        path: The file.
        model: Model that the content has to fit.
        max_bytes: Largest permitted size of the file, bytes.

    Raises:
        InputError: The file cannot be read, is not JSON, or does not fit the model.
    """
    text = read_text(path, max_bytes=max_bytes)
    try:
        return model.model_validate_json(text)
    except ValidationError as error:
        raise _input_error(error, path) from error


def validate(model: type[_Model], document: Mapping[Any, Any], source: str | Path) -> _Model:
    """Validate a mapping with a model.

    Args:
        model: Model that the mapping has to fit.
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
    """Convert the first validation error into a one-line `InputError`."""
    first = error.errors(include_url=False)[0]
    field = ".".join(str(part) for part in first["loc"])
    return InputError(source, field, _reason(first)[:MAX_REASON_CHARACTERS])


def _reason(details: ErrorDetails) -> str:
    """The reason of an `InputError`, as a predicate that follows the field."""
    if details["type"] == "missing":
        return "is missing"
    if details["type"] == "extra_forbidden":
        return "is not a known field"
    if details["type"] == "value_error":  # from a model's own validator, whose message is complete
        return details["msg"].removeprefix("Value error, ")
    message = details["msg"][0].lower() + details["msg"][1:]
    if details["type"].startswith("json") or details["type"] == "recursion_loop":
        return message
    return f"{_quoted(details['input'])} is invalid: {message}"


def _quoted(value: object) -> str:
    """The value as Python writes it, shortened to `MAX_VALUE_CHARACTERS`."""
    text = repr(value)
    return text if len(text) <= MAX_VALUE_CHARACTERS else f"{text[: MAX_VALUE_CHARACTERS - 1]}…"
