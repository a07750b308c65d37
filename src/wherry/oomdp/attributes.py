"""Attributes of object classes: names with a kind and bounds (paper, section 3)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

Value = bool | int | float | str

EXISTS = "exists"
"""Name of the attribute that removable objects have in addition to those of their class; removal sets it to false."""


class AttributeKind(Enum):
    """The kind of values that an attribute takes."""

    INTEGER = "integer"
    BOOLEAN = "boolean"
    ENUMERATION = "enumeration"
    REAL = "real"

    __hash__ = object.__hash__  # members are unique, and learners look kinds up in inner loops


@dataclass(frozen=True, slots=True)
class Attribute:
    """An attribute of a class; made by `integer`, `boolean`, `enumeration` and `real`.

    Attributes:
        name: Its name.
        kind: The kind of its values.
        minimum: Smallest value of a number.
        maximum: Largest value of a number.
        choices: The values of an enumeration.
    """

    name: str
    kind: AttributeKind
    minimum: float = -math.inf
    maximum: float = math.inf
    choices: tuple[str, ...] = ()

    def admits(self, value: object) -> bool:
        """Whether a value is of the attribute's kind and within its bounds."""
        match self.kind:
            case AttributeKind.BOOLEAN:
                return isinstance(value, bool)
            case AttributeKind.ENUMERATION:
                return isinstance(value, str) and value in self.choices
            case AttributeKind.INTEGER:
                return isinstance(value, int) and not isinstance(value, bool) and self._is_within_bounds(value)
            case AttributeKind.REAL:
                return isinstance(value, int | float) and not isinstance(value, bool) and self._is_within_bounds(value)

    def _is_within_bounds(self, value: float) -> bool:
        return self.minimum <= value <= self.maximum


def integer(name: str, minimum: float = -math.inf, maximum: float = math.inf) -> Attribute:
    """An attribute whose values are integers within bounds, both inclusive."""
    return Attribute(name, AttributeKind.INTEGER, minimum, maximum)


def real(name: str, minimum: float = -math.inf, maximum: float = math.inf) -> Attribute:
    """An attribute whose values are real numbers within bounds, both inclusive."""
    return Attribute(name, AttributeKind.REAL, minimum, maximum)


def boolean(name: str) -> Attribute:
    """An attribute that is true or false."""
    return Attribute(name, AttributeKind.BOOLEAN)


def enumeration(name: str, *choices: str) -> Attribute:
    """An attribute whose value is one of some strings."""
    return Attribute(name, AttributeKind.ENUMERATION, choices=choices)


EXISTENCE = boolean(EXISTS)
"""The attribute named `EXISTS`."""
