"""Read objects and states from plain data, as `State.to_json` writes them."""

from __future__ import annotations

from collections.abc import Mapping

from wherry.errors import InputError
from wherry.oomdp.objects import Object, ObjectClass, Scene, State


def object_from_json(data: object, classes: Mapping[str, ObjectClass], source: str, field: str) -> Object:
    """Read an object from plain data.

    Args:
        data: The data.
        classes: The domain's classes by name.
        source: Name of the data in error messages.
        field: Path of the object in the data in error messages, such as ``objects[0]``.

    Raises:
        InputError: The data is not an object of one of the classes.
    """
    if not isinstance(data, dict):
        raise InputError(source, field, "is not an object with fields")
    values = dict(data)
    class_name, name = values.pop("class", None), values.pop("name", None)
    object_class = classes.get(class_name) if isinstance(class_name, str) else None
    if object_class is None:
        raise InputError(source, f"{field}.class", f"is not one of {', '.join(classes)}")
    if not isinstance(name, str):
        raise InputError(source, f"{field}.name", "is not a string")
    try:
        return object_class(name, **values)
    except (TypeError, ValueError) as error:
        raise InputError(source, field, str(error)) from error


def state_from_json(
    data: object, classes: Mapping[str, ObjectClass], source: str = "state", scene: Scene | None = None
) -> State:
    """Read a state from plain data, as `State.to_json` writes it.

    Args:
        data: The data.
        classes: The domain's classes by name.
        source: Name of the data in error messages.
        scene: The scene to share; None to read it from the data too.

    Raises:
        InputError: The data is not a state.
    """

    def read(part: str) -> tuple[Object, ...]:
        items = data.get(part) if isinstance(data, dict) else None
        if not isinstance(items, list):
            raise InputError(source, part, "is not a list of objects")
        return tuple(object_from_json(item, classes, source, f"{part}[{index}]") for index, item in enumerate(items))

    try:
        return State(read("objects"), Scene(read("scene")) if scene is None else scene)
    except ValueError as error:
        raise InputError(source, "objects", str(error)) from error
