"""States as Gymnasium observations: a dictionary of objects, each a dictionary of its attributes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from wherry.oomdp.attributes import EXISTS, Attribute, AttributeKind, Value
from wherry.oomdp.objects import Object, State

Observation = dict[str, dict[str, Any]]
"""Encoded values by object name and attribute name: an integer, or an array [1] for a real attribute."""


class ObservationEncoder:
    """Encodes states as elements of one space, whether or not objects have been removed.

    Static objects, such as walls, are not encoded; terms such as ``touch_N(taxi, wall)`` reflect them.

    Args:
        state: A state with all objects that an episode can have.

    Raises:
        ValueError: An attribute has no bounds, so that no space contains all of its values.

    Attributes:
        objects: All objects that an episode can have, by name.
        space: The observation space.
    """

    def __init__(self, state: State) -> None:
        self.objects: Mapping[str, Object] = {item.name: item for item in state.objects}
        self.space: spaces.Space[Any] = spaces.Dict(
            {
                name: spaces.Dict({attribute.name: _space(attribute) for attribute in item.object_class.changeable})
                for name, item in self.objects.items()
            }
        )

    def encode(self, state: State) -> Observation:
        """The observation of a state; a removed object has ``exists`` 0 and the lowest values of its attributes."""
        present = {item.name: item for item in state.objects}
        return {
            name: {attribute.name: _encoded(attribute, present.get(name)) for attribute in item.object_class.changeable}
            for name, item in self.objects.items()
        }


def _space(attribute: Attribute) -> spaces.Space[Any]:
    """The space of an attribute's values."""
    match attribute.kind:
        case AttributeKind.BOOLEAN:
            return spaces.Discrete(2)
        case AttributeKind.ENUMERATION:
            return spaces.Discrete(len(attribute.choices))
    if not (math.isfinite(attribute.minimum) and math.isfinite(attribute.maximum)):
        raise ValueError(f"attribute {attribute.name} needs bounds to be observed")
    if attribute.kind is AttributeKind.INTEGER:
        lowest, highest = int(attribute.minimum), int(attribute.maximum)
        return spaces.Discrete(highest - lowest + 1, start=lowest)
    return spaces.Box(attribute.minimum, attribute.maximum, (1,), np.float64)


def _encoded(attribute: Attribute, item: Object | None) -> Any:
    """An attribute's value as an element of its space."""
    if attribute.name == EXISTS:
        return np.int64(item is not None)
    value: Value | None = None if item is None else getattr(item, attribute.name)
    match attribute.kind:
        case AttributeKind.BOOLEAN:
            return np.int64(value is True)
        case AttributeKind.ENUMERATION:
            return np.int64(0 if value is None else attribute.choices.index(str(value)))
        case AttributeKind.INTEGER:
            return np.int64(attribute.minimum if value is None else value)
        case AttributeKind.REAL:
            return np.array([attribute.minimum if value is None else value], np.float64)
