"""Classes, attributes, objects and states (paper, section 3).

A state is the union of its objects' states; an object has a value for each of its class's attributes. Static objects,
such as walls, are kept in a `Scene` that all states of a world share, so they cost nothing per step, and relations to
them are looked up in an index that is built once.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from wherry.oomdp.attributes import EXISTENCE, EXISTS, Attribute, Value

ObjectKey = Callable[["Object"], Hashable]
"""Maps an object to a key by which it can be indexed, such as the cell that it is in."""


@dataclass(frozen=True)
class ObjectClass:
    """A class C of objects; calling it makes one: ``ROBOT("robot", x=1, y=2)``.

    Attributes:
        name: Name of the class.
        attributes: Att(C), in the order in which they are printed.
        static: Whether its objects never change; they then belong to the scene.
        removable: Whether its objects can be removed from the world, which is an effect on the attribute ``exists``.
        attribute_indexes: Index of each attribute in ``attributes``, by name.
    """

    name: str
    attributes: tuple[Attribute, ...]
    static: bool = False
    removable: bool = False
    attribute_indexes: Mapping[str, int] = field(init=False, repr=False, compare=False, hash=False)

    def __post_init__(self) -> None:
        attribute_indexes = {attribute.name: index for index, attribute in enumerate(self.attributes)}
        if len(attribute_indexes) < len(self.attributes) or EXISTS in attribute_indexes:
            raise ValueError(f"class {self.name}: attribute names must differ from each other and from {EXISTS!r}")
        object.__setattr__(self, "attribute_indexes", attribute_indexes)

    def __call__(self, name: str, **values: Value) -> Object:
        """Make an object of this class.

        Raises:
            ValueError: A value is missing, belongs to no attribute, or is not admitted by its attribute.
        """
        if values.keys() != self.attribute_indexes.keys():
            needed = ", ".join(self.attribute_indexes)
            raise ValueError(f"{self.name} {name!r} needs values for {needed}; got {sorted(values)}")
        return Object(self, name, tuple(values[attribute.name] for attribute in self.attributes))

    def attribute(self, name: str) -> Attribute:
        """The attribute of that name."""
        return EXISTENCE if name == EXISTS else self.attributes[self.attribute_indexes[name]]

    @cached_property
    def changeable(self) -> tuple[Attribute, ...]:
        """The attributes that an action can change: the class's own and, if objects can be removed, their existence."""
        return (*self.attributes, EXISTENCE) if self.removable else self.attributes


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Object:
    """An object; its attributes are read by name: ``robot.x``.

    Attributes:
        object_class: Its class.
        name: Its name, unique in its world.
        values: The values of the class's attributes, in the class's order.
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
            return self.values[self.object_class.attribute_indexes[attribute]]
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
        """A copy with other values for some attributes."""
        current = dict(zip(self.object_class.attribute_indexes, self.values, strict=True))
        if unknown := values.keys() - current.keys():
            raise ValueError(f"{self.object_class.name} has no attribute {', '.join(sorted(unknown))}")
        return self.object_class(self.name, **{**current, **values})

    def with_value(self, attribute: str, value: Value) -> Object:
        """A copy with another value of one attribute; the value is not checked."""
        index = self.object_class.attribute_indexes[attribute]
        copy = object.__new__(Object)
        object.__setattr__(copy, "object_class", self.object_class)
        object.__setattr__(copy, "name", self.name)
        object.__setattr__(copy, "values", (*self.values[:index], value, *self.values[index + 1 :]))
        return copy

    def to_json(self) -> dict[str, Value]:
        """The object as plain data: its class, name and attributes."""
        return {"class": self.object_class.name, "name": self.name} | dict(
            zip(self.object_class.attribute_indexes, self.values, strict=True)
        )


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Scene:
    """The static objects of a world, indexed for relations to them.

    Attributes:
        objects: The static objects.
    """

    objects: tuple[Object, ...] = ()
    _hash: int = field(init=False)
    _indexes: dict[tuple[str, ObjectKey], dict[Hashable, tuple[Object, ...]]] = field(default_factory=dict, init=False)

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

    def index(self, class_name: str, key: ObjectKey) -> Mapping[Hashable, tuple[Object, ...]]:
        """The static objects of a class by a key; the index is built on first use and cached."""
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
        scene: The static objects.
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
            raise ValueError("the names of a state's objects must differ from each other")
        self._fill(objects, self.scene)

    def _fill(self, objects: tuple[Object, ...], scene: Scene) -> None:
        """Set all fields; the objects must be in order and have unique names."""
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
        cached = self._classes
        if cached is None:
            cached = tuple(item.object_class.name for item in self.objects)
            object.__setattr__(self, "_classes", cached)
        return cached

    def get(self, name: str) -> Object | None:
        """The object of that name; None where the state has no such object."""
        return next((item for item in self.objects if item.name == name), None)

    def of_class(self, name: str) -> tuple[Object, ...]:
        """The objects of a class that can change, ordered by name."""
        cached = self._by_class.get(name)
        if cached is None:
            cached = self._by_class[name] = tuple(item for item in self.objects if item.object_class.name == name)
        return cached

    def replace(self, name: str, **values: Value) -> State:
        """A copy with other attribute values of one object: ``state.replace("robot", x=3)``.

        Raises:
            KeyError: There is no such object.
            ValueError: It has no such attribute, or the attribute does not admit the value.
        """
        replaced = self[name].replace(**values)
        return self.with_ordered_objects(replaced if item.name == name else item for item in self.objects)

    def without(self, name: str) -> State:
        """A copy without one object."""
        return self.with_ordered_objects(item for item in self.objects if item.name != name)

    def with_objects(self, objects: Iterable[Object]) -> State:
        """A state of the same scene with other objects."""
        return State(tuple(objects), self.scene)

    def with_ordered_objects(self, objects: Iterable[Object]) -> State:
        """As `with_objects`, without sorting and checks; the objects must be in order and have unique names."""
        copy = object.__new__(State)
        copy._fill(tuple(objects), self.scene)
        return copy

    def cached_conditions(self, arguments: tuple[str, ...], compute: Callable[[], tuple[int, ...]]) -> tuple[int, ...]:
        """The state's conditions for an action's arguments, computed on first use."""
        cached = self._conditions.get(arguments)
        if cached is None:
            cached = self._conditions[arguments] = compute()
        return cached

    def share_conditions(self, equal: State) -> None:
        """Share the cache of conditions with an equal state."""
        object.__setattr__(self, "_conditions", equal._conditions)

    def to_json(self) -> dict[str, Any]:
        """The state and its scene as plain data; `wherry.oomdp.state_json` reads it."""
        return {
            "objects": [item.to_json() for item in self.objects],
            "scene": [item.to_json() for item in self.scene.objects],
        }
