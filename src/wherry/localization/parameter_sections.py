"""The parameters of one ROS node in a parameter file of ROS 1 or ROS 2.

A file has sections for several nodes, below any number of namespaces, as nested keys (``robot1: amcl:``) or as one key
(``/robot1/amcl:``). In ROS 2 a section's parameters are below ``ros__parameters``, and ``*`` and ``**`` in its name
stand for one name and for any number of names. As in rclcpp, all sections that match the node are merged, and of a
parameter that is set repeatedly the last value in the file is used.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wherry.errors import InputError

ROS2_KEY = "ros__parameters"  # key of a section's parameters in ROS 2
MAX_DEPTH = 32  # nested namespaces
MAX_LISTED = 6  # names of nodes in a message


@dataclass(frozen=True, slots=True)
class Section:
    """The parameters of a section of the file.

    Attributes:
        name: Name of the node with its namespaces, such as "/robot1/amcl"; "/" at the top level of the file.
        parameters: Values by the parameters' names; the names of nested parameters are joined by dots in ROS 2.
        is_ros2: Whether the parameters are below ``ros__parameters``.
    """

    name: str
    parameters: Mapping[str, Any]
    is_ros2: bool

    @property
    def is_pattern(self) -> bool:
        """Whether the section's name has wildcards."""
        return "*" in self.name


@dataclass(frozen=True, slots=True)
class NodeParameters:
    """The merged parameters of a node.

    Attributes:
        name: Name of the node with its namespaces; "/" if the file does not name it.
        parameters: Values by the parameters' names.
        shared: Names of parameters that were set only for several nodes at once, with wildcards.
        is_ros2: Whether the file is of ROS 2.
        notes: What was decided in merging, as sentences for the user.
    """

    name: str
    parameters: Mapping[str, Any]
    shared: frozenset[str]
    is_ros2: bool
    notes: tuple[str, ...]


def node_parameters(content: Mapping[Any, Any], node: str, source: str | Path) -> NodeParameters:
    """Collect the parameters of a node.

    Args:
        content: The file's content.
        node: Name of the node without namespaces, such as "amcl".
        source: Path of the file, for errors.

    Raises:
        InputError: The file has parameters of other nodes only, or different ones of several nodes of this name.
    """
    try:
        sections = list(_sections(content, "", 0))
    except RecursionError as error:
        raise InputError(source, "", "is nested too deeply") from error
    named = [section for section in sections if not section.is_pattern and _basename(section.name) == node]
    names = list(dict.fromkeys(section.name for section in named))
    merged = [_merge([section for section in sections if _matches(section.name, name)], name, source) for name in names]
    if any(other.parameters != merged[0].parameters for other in merged[1:]):
        reason = f"has the parameters of several nodes, of which only one can be meant: {_list(names)}"
        raise InputError(source, "", reason)
    if merged:
        return merged[0]
    patterns = [section for section in sections if section.is_pattern and _could_match(section.name, node)]
    if patterns:
        return _merge(patterns, patterns[-1].name, source)
    top = [section for section in sections if section.name == "/"]
    if top:
        return _merge(top, "/", source)
    others = _list(list(dict.fromkeys(section.name for section in sections)))
    raise InputError(source, "", f"has no parameters of {node}" + (f", only of {others}" if others else ""))


def _sections(content: Mapping[Any, Any], path: str, depth: int) -> Iterator[Section]:
    """All sections of a part of the file, in the file's order."""
    if depth > MAX_DEPTH:
        raise RecursionError
    parameters = content.get(ROS2_KEY)
    if isinstance(parameters, Mapping):
        yield Section(path or "/", dict(_flat(parameters, "", 0)), is_ros2=True)
    plain = {str(key): value for key, value in content.items() if not isinstance(value, Mapping)}
    inline = {key: value for key, value in content.items() if _is_inline(key, value)}
    if (plain or inline) and not isinstance(parameters, Mapping):
        yield Section(path or "/", {**plain, **inline}, is_ros2=False)
    for key, value in content.items():
        if isinstance(value, Mapping) and key != ROS2_KEY and key not in inline:
            yield from _sections(value, f"{path}/{str(key).strip('/')}", depth + 1)


def _is_inline(key: object, value: object) -> bool:
    """Whether a mapping is the value of a parameter rather than a section of the file."""
    return key == "initial_pose" and isinstance(value, Mapping)


def _flat(parameters: Mapping[Any, Any], prefix: str, depth: int) -> Iterator[tuple[str, Any]]:
    """Parameters of ROS 2 by their names, in which the keys of nested mappings are joined by dots."""
    for key, value in parameters.items():
        name = f"{prefix}{key}"
        if depth > MAX_DEPTH:
            raise RecursionError
        if isinstance(value, Mapping):
            yield from _flat(value, f"{name}.", depth + 1)
        else:
            yield name, value


def _merge(matching: list[Section], name: str, source: str | Path) -> NodeParameters:
    """The parameters of the node with a name from all sections that match it, of which the last one wins."""
    if len({section.is_ros2 for section in matching}) > 1:
        raise InputError(source, name, f"has parameters both with and without {ROS2_KEY}")
    values: dict[str, Any] = {}
    origin: dict[str, Section] = {}
    overridden: list[str] = []
    for section in matching:
        for key, value in section.parameters.items():
            is_general = section.is_pattern and key in origin and not origin[key].is_pattern
            if is_general and values[key] != value:
                overridden.append(key)
            values[key], origin[key] = value, section
    notes = tuple(
        f"{source}: {key} of {name} is that of {origin[key].name}, which comes later in the file, as in ROS 2."
        for key in overridden
    )
    shared = frozenset(key for key, section in origin.items() if section.is_pattern and name != section.name)
    return NodeParameters(name, values, shared, any(section.is_ros2 for section in matching), notes)


def _basename(name: str) -> str:
    """The last part of a name."""
    return name.rsplit("/", 1)[-1]


def _could_match(pattern: str, node: str) -> bool:
    """Whether a name with wildcards matches the node in some namespace."""
    return _basename(pattern) in ("*", "**", node)


def _matches(section: str, name: str) -> bool:
    """Whether a section's name, which may have wildcards as in rclcpp, matches a node's name with its namespaces."""
    wildcards = {"**": r"(/\w+)*", "*": r"/\w+"}
    expression = "".join(wildcards.get(part, re.escape(f"/{part}")) for part in section.split("/")[1:])
    return section == name or re.fullmatch(expression, name) is not None


def _list(names: list[str]) -> str:
    """Some names, and how many more there are."""
    more = f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else ""
    return ", ".join(names[:MAX_LISTED]) + more
