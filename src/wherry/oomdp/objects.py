"""Classes, attributes, objects and states (paper, section 3).

A state is the union of its objects' states, and an object gives a value to each of its class's attributes. Objects
that never change in a world, such as walls, are kept once in a `Scene` that all of the world's states share: they cost
nothing per step, and relations to them are looked up in an index that is built once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import Any

from wherry.errors import InputError

Value = bool | int | float | str
Key = Callable[["Object"], Hashable]

EXISTS = "exists"  # the attribute that every removable object has besides its own: an object that leaves loses it


class Kind(Enum):
    """What values an attribute takes."""

    INTEGER = "integer"
    BOOLEAN = "boolean"
    ENUMERATION = "enumeration"
    REAL = "real"

    __hash__ = object.__hash__  # of equal members there is only one, and learners look kinds up all the time


@dataclass(frozen=True, slots=True)
class Attribute:
    """One attribute of a class; made by `integer`, `boolean`, `enumeration` and `real`.

    Attributes:
        name: What it is called.
        kind: What values it takes.
        minimum: The smallest number that it may be.
        maximum: The largest number that it may be.
        choices: The names that an enumeration consists of.
    """

    name: str
    kind: Kind
    minimum: float = -math.inf
    maximum: float = math.inf
    choices: tuple[str, ...] = ()

    def admits(self, value: object) -> bool:
        """Whether the attribute may have this value."""
        match self.kind:
            case Kind.BOOLEAN:
                return isinstance(value, bool)
            case Kind.ENUMERATION:
                return isinstance(value, str) and value in self.choices
            case Kind.INTEGER:
                return isinstance(value, int) and not isinstance(value, bool) and self._in_range(value)
            case Kind.REAL:
                return isinstance(value, int | float) and not isinstance(value, bool) and self._in_range(value)

    def _in_range(self, value: float) -> bool:
        return self.minimum <= value <= self.maximum


def integer(name: str, minimum: float = -math.inf, maximum: float = math.inf) -> Attribute:
    """An attribute that is a whole number within bounds, both included."""
    return Attribute(name, Kind.INTEGER, minimum, maximum)


def real(name: str, minimum: float = -math.inf, maximum: float = math.inf) -> Attribute:
    """An attribute that is a number within bounds, both included."""
    return Attribute(name, Kind.REAL, minimum, maximum)


def boolean(name: str) -> Attribute:
    """An attribute that is true or false."""
    return Attribute(name, Kind.BOOLEAN)


def enumeration(name: str, *choices: str) -> Attribute:
    """An attribute that is one of a few names."""
    return Attribute(name, Kind.ENUMERATION, choices=choices)


@dataclass(frozen=True)
class ObjectClass:
    """A class C of objects; calling it makes one: ``ROBOT("robot", x=1, y=2)``.

    Attributes:
        name: What it is called.
        attributes: Att(C), in the order in which they are printed.
        static: Whether its objects never change, and so belong to the scene.
        removable: Whether its objects can leave the world; to have left is then an effect like any other.
    """

    name: str
    attributes: tuple[Attribute, ...]
    static: bool = False
    removable: bool = False
    positions: Mapping[str, int] = field(init=False, repr=False, compare=False, hash=False)

    def __post_init__(self) -> None:
        positions = {attribute.name: index for index, attribute in enumerate(self.attributes)}
        if len(positions) < len(self.attributes) or EXISTS in positions:
            raise ValueError(f"class {self.name}: attribute names must differ from each other and from {EXISTS!r}")
        object.__setattr__(self, "positions", positions)

    def __call__(self, name: str, **values: Value) -> Object:
        """Make an object of this class.

        Raises:
            ValueError: An attribute has no value, an unknown name, or a value that it may not have.
        """
        if values.keys() != self.positions.keys():
            raise ValueError(f"{self.name} {name!r} needs values for {', '.join(self.positions)}; got {sorted(values)}")
        return Object(self, name, tuple(values[attribute.name] for attribute in self.attributes))

    def attribute(self, name: str) -> Attribute:
        """The attribute of that name."""
        return EXISTENCE if name == EXISTS else self.attributes[self.positions[name]]

    @cached_property
    def changeable(self) -> tuple[Attribute, ...]:
        """The attributes that an action can change: the class's own, and existence where objects can leave."""
        return (*self.attributes, EXISTENCE) if self.removable else self.attributes


EXISTENCE = boolean(EXISTS)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Object:
    """An object: its attributes are read by name, ``robot.x``.

    Attributes:
        object_class: Its class.
        name: Tells it from all other objects of its world.
        values: The values of the class's attributes, in their order.
    """

    object_class: ObjectClass
    name: str
    values: tuple[Value, ...]

    def __post_init__(self) -> None:
        for attribute, value in zip(self.object_class.attributes, self.values, strict=True):
            if not attribute.admits(value):
                raise ValueError(f"{self.object_class.name} {self.name!r}: {attribute.name} cannot be {value!r}")

    def __getattr__(self, attribute: str) -> Any:
        try:
            return self.values[self.object_class.positions[attribute]]
        except KeyError:
            raise AttributeError(f"{self.object_class.name} has no attribute {attribute!r}") from None

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Object):
            return NotImplemented
        return (
            self.values == other.values
            and self.name == other.name
            and self.object_class.name == other.object_class.name
        )

    def __hash__(self) -> int:
        return hash((self.name, self.values))

    def __repr__(self) -> str:
        values = ", ".join(
            f"{attribute.name}={value!r}"
            for attribute, value in zip(self.object_class.attributes, self.values, strict=True)
        )
        return f"{self.object_class.name} {self.name}({values})"

    def replace(self, **values: Value) -> Object:
        """The same object with other values for some attributes."""
        current = dict(zip(self.object_class.positions, self.values, strict=True))
        if unknown := values.keys() - current.keys():
            raise ValueError(f"{self.object_class.name} has no attribute {', '.join(sorted(unknown))}")
        return self.object_class(self.name, **{**current, **values})

    def changed(self, attribute: str, value: Value) -> Object:
        """The same object with another value of one attribute, which has to be one that the attribute admits."""
        position = self.object_class.positions[attribute]
        again = object.__new__(Object)
        object.__setattr__(again, "object_class", self.object_class)
        object.__setattr__(again, "name", self.name)
        object.__setattr__(again, "values", (*self.values[:position], value, *self.values[position + 1 :]))
        return again

    def to_json(self) -> dict[str, Value]:
        """The object as plain data: its class, its name, and its attributes."""
        return {"class": self.object_class.name, "name": self.name} | dict(
            zip(self.object_class.positions, self.values, strict=True)
        )


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Scene:
    """What never changes in a world: its static objects, and the indexes that answer relations to them.

    Attributes:
        objects: The static objects.
    """

    objects: tuple[Object, ...] = ()
    _hash: int = field(init=False)
    _indexes: dict[tuple[str, Key], dict[Hashable, tuple[Object, ...]]] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_hash", hash(frozenset(self.objects)))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Scene):
            return NotImplemented
        return self is other or (self._hash == other._hash and set(self.objects) == set(other.objects))

    def __hash__(self) -> int:
        return self._hash

    def __repr__(self) -> str:
        return f"Scene({len(self.objects)} objects)"

    def of_class(self, name: str) -> tuple[Object, ...]:
        """The static objects of a class."""
        return tuple(item for item in self.objects if item.object_class.name == name)

    def index(self, class_name: str, key: Key) -> Mapping[Hashable, tuple[Object, ...]]:
        """The static objects of a class by a key; built when first asked for, and kept."""
        index = self._indexes.get((class_name, key))
        if index is None:
            groups: dict[Hashable, list[Object]] = {}
            for item in self.of_class(class_name):
                groups.setdefault(key(item), []).append(item)
            index = {value: tuple(items) for value, items in groups.items()}
            self._indexes[class_name, key] = index
        return index


EMPTY_SCENE = Scene()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class State:
    """A state s: immutable, equal by content, usable as a dictionary key.

    Attributes:
        objects: The objects that can change, ordered by class and name.
        scene: The objects that cannot.
    """

    objects: tuple[Object, ...]
    scene: Scene = EMPTY_SCENE
    _hash: int = field(init=False)
    _conditions: dict[tuple[str, ...], tuple[int, ...]] = field(init=False)
    _classes: tuple[str, ...] | None = field(init=False)
    _by_class: dict[str, tuple[Object, ...]] = field(init=False)

    def __post_init__(self) -> None:
        objects = tuple(sorted(self.objects, key=lambda item: (item.object_class.name, item.name)))
        names = {item.name for item in objects}
        if len(names) < len(objects):
            raise ValueError("every object of a state needs a name of its own")
        self._fill(objects, self.scene)

    def _fill(self, objects: tuple[Object, ...], scene: Scene) -> None:
        """Set all fields; the objects are in order, and each has a name of its own."""
        object.__setattr__(self, "objects", objects)
        object.__setattr__(self, "scene", scene)
        object.__setattr__(self, "_hash", hash((objects, scene)))
        object.__setattr__(self, "_conditions", {})
        object.__setattr__(self, "_classes", None)
        object.__setattr__(self, "_by_class", {})

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, State):
            return NotImplemented
        if self is other:
            return True
        return self._hash == other._hash and self.objects == other.objects and self.scene == other.scene

    def __hash__(self) -> int:
        return self._hash

    def __repr__(self) -> str:
        return f"State({', '.join(map(repr, self.objects))})"

    def __getitem__(self, name: str) -> Object:
        """The object of that name.

        Raises:
            KeyError: There is none.
        """
        for item in self.objects:
            if item.name == name:
                return item
        raise KeyError(name)

    @property
    def classes(self) -> tuple[str, ...]:
        """The names of the objects' classes, in the objects' order."""
        found = self._classes
        if found is None:
            found = tuple(item.object_class.name for item in self.objects)
            object.__setattr__(self, "_classes", found)
        return found

    def get(self, name: str) -> Object | None:
        """The object of that name, or None where it is not in the world (any more)."""
        return next((item for item in self.objects if item.name == name), None)

    def of_class(self, name: str) -> tuple[Object, ...]:
        """The objects of a class that can change, by name."""
        found = self._by_class.get(name)
        if found is None:
            found = self._by_class[name] = tuple(item for item in self.objects if item.object_class.name == name)
        return found

    def replace(self, name: str, **values: Value) -> State:
        """The state in which one object has other values: ``state.replace("robot", x=3)``.

        Raises:
            KeyError: There is no such object.
            ValueError: It has no such attribute, or the attribute may not have that value.
        """
        replaced = self[name].replace(**values)
        return self.changed(replaced if item.name == name else item for item in self.objects)

    def without(self, name: str) -> State:
        """The state that an object has left."""
        return self.changed(item for item in self.objects if item.name != name)

    def changed(self, objects: Iterable[Object]) -> State:
        """The state in which these are left of the present objects, in their order, with whatever values."""
        again = object.__new__(State)
        again._fill(tuple(objects), self.scene)
        return again

    def with_objects(self, objects: Iterable[Object]) -> State:
        """A state of the same scene with other objects."""
        return State(tuple(objects), self.scene)

    def remember(self, arguments: tuple[str, ...], work_out: Callable[[], tuple[int, ...]]) -> tuple[int, ...]:
        """The state's conditions for an action's arguments: worked out when first asked for, then kept."""
        kept = self._conditions.get(arguments)
        if kept is None:
            kept = self._conditions[arguments] = work_out()
        return kept

    def share_conditions(self, equal: State) -> None:
        """Keep conditions together with an equal state, so that what was worked out for one serves both."""
        object.__setattr__(self, "_conditions", equal._conditions)

    def to_json(self) -> dict[str, Any]:
        """The state as plain data, its scene included; `state_from_json` is the way back."""
        return {
            "objects": [item.to_json() for item in self.objects],
            "scene": [item.to_json() for item in self.scene.objects],
        }


def object_from_json(data: object, classes: Mapping[str, ObjectClass], source: str, where: str) -> Object:
    """Read an object from plain data.

    Raises:
        InputError: The data is not an object of one of the classes.
    """
    if not isinstance(data, dict):
        raise InputError(source, where, "is not an object with fields")
    values = dict(data)
    class_name, name = values.pop("class", None), values.pop("name", None)
    object_class = classes.get(class_name) if isinstance(class_name, str) else None
    if object_class is None:
        raise InputError(source, f"{where}.class", f"is not one of {', '.join(classes)}")
    if not isinstance(name, str):
        raise InputError(source, f"{where}.name", "is not a text")
    try:
        return object_class(name, **values)
    except (TypeError, ValueError) as error:
        raise InputError(source, where, str(error)) from error


def state_from_json(
    data: object, classes: Mapping[str, ObjectClass], source: str = "state", scene: Scene | None = None
) -> State:
    """Read a state from plain data, as `State.to_json` writes it.

    Args:
        data: The data.
        classes: The domain's classes by name.
        source: What to call the data in errors.
        scene: The scene to share, if it is already known; else it is read from the data too.

    Raises:
        InputError: The data is not a state.
    """

    def read(part: str) -> tuple[Object, ...]:
        items = data.get(part) if isinstance(data, dict) else None
        if not isinstance(items, list):
            raise InputError(source, part, "is not a list of objects")
        return tuple(object_from_json(item, classes, source, f"{part}[{at}]") for at, item in enumerate(items))

    try:
        return State(read("objects"), Scene(read("scene")) if scene is None else scene)
    except ValueError as error:
        raise InputError(source, "objects", str(error)) from error
