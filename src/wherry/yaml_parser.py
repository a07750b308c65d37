"""YAML 1.2 as ROS's parser yaml-cpp reads it, for files that are written by hand.

PyYAML follows YAML 1.1, for which 5e-2 is a word, yes is true, 010 is 8 and 1:30 is 90; it refuses a tab after a colon,
and of a repeated key it keeps the last value. ruamel.yaml follows YAML 1.2 but refuses the tab too and takes .05E1 for
a word. `Yaml12Loader` corrects these points in PyYAML's safe loader.
"""

from __future__ import annotations

import math
import re
from typing import Any, cast

import yaml
from yaml.constructor import ConstructorError
from yaml.scanner import ScannerError

MAX_DEPTH = 50  # nested mappings and sequences in a document
MAX_VALUES = 50_000  # values of a document, those that aliases repeat included

LINE_BREAKS = "\r\n\x85\u2028\u2029"
NULL = re.compile(r"~|null|Null|NULL|")
BOOLEAN = re.compile(r"true|True|TRUE|false|False|FALSE")
INTEGER = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")

_TAG = "tag:yaml.org,2002:"


def number_of(text: str) -> float | int | None:
    """The number that a scalar of YAML 1.2 is, or None for any other text.

    Raises:
        ValueError: The number has more digits than Python converts.
    """
    if INTEGER.fullmatch(text):
        return int(text, {"0o": 8, "0x": 16}.get(text[:2], 10))
    if FLOAT.fullmatch(text):
        return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
    return None


class DocumentError(yaml.MarkedYAMLError):
    """YAML that is ambiguous or beyond a limit; the problem is a predicate that follows the line."""


def _document_error(problem: str, place: yaml.Event | yaml.Node) -> DocumentError:
    """An error that names the line of an event or node."""
    return DocumentError(problem=problem, problem_mark=cast("yaml.Mark", place.start_mark))


class Yaml12Loader(yaml.SafeLoader):
    """Loads YAML 1.2 with the types of its core schema; documents are limited in depth and number of values."""

    def __init__(self, stream: str) -> None:
        super().__init__(stream)
        self._depth = 0
        self._sizes: dict[int, int] = {}  # values in each composed node, by the node's id

    def scan_to_next_token(self) -> None:
        """Skip spaces, comments and line breaks, and tabs wherever they do not indent."""
        if self.index == 0 and self.peek() == "\ufeff":
            self.forward()
        while True:
            self._skip_blanks()
            if self.peek() == "#":
                while self.peek() not in "\0" + LINE_BREAKS:
                    self.forward()
            if not self.scan_line_break():  # type: ignore[no-untyped-call]
                return
            if not self.flow_level:
                self.allow_simple_key = True

    def _skip_blanks(self) -> None:
        """Skip spaces and tabs; a tab may begin a line only if nothing but a comment follows."""
        length = 0
        while self.peek(length) in (" ", "\t"):
            length += 1
        starts_line = self.column == 0 and not self.flow_level
        if starts_line and "\t" in self.prefix(length) and self.peek(length) not in "#\0" + LINE_BREAKS:
            raise ScannerError(None, None, "a tab indents the line; use spaces", self.get_mark())
        self.forward(length)

    def get_single_node(self) -> yaml.Node | None:
        """Compose the only document that is not empty."""
        self.get_event()  # type: ignore[no-untyped-call]
        found: yaml.Node | None = None
        while not self.check_event(yaml.StreamEndEvent):
            node = self.compose_document()
            if node is None or node.tag == f"{_TAG}null":
                continue
            if found is not None:
                raise _document_error("begins a second document; a file may have only one", node)
            found = node
        self.get_event()  # type: ignore[no-untyped-call]
        return found

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Compose a node; refuse depth and repetition beyond the limits before the values are constructed."""
        event: yaml.Event = self.peek_event()  # type: ignore[no-untyped-call]
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise _document_error(f"is nested too deeply: more than {MAX_DEPTH} levels", event)
        node = super().compose_node(parent, index)
        self._depth -= 1
        if node is None:
            return None
        if isinstance(event, yaml.AliasEvent):
            if id(node) not in self._sizes:
                raise _document_error(
                    f"is nested too deeply: the alias {event.anchor!r} is inside its own anchor", event
                )
        else:
            self._sizes[id(node)] = 1 + sum(self._sizes[id(child)] for child in _children(node))
        if self._sizes[id(node)] > MAX_VALUES or len(self._sizes) > MAX_VALUES:
            raise _document_error(f"has more than {MAX_VALUES:,} values", event)
        return node

    def compose_mapping_node(self, anchor: dict[Any, yaml.Node]) -> yaml.MappingNode:
        """Compose a mapping; refuse a repeated key."""
        node = super().compose_mapping_node(anchor)
        seen = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue
            if (key.tag, key.value) in seen:
                raise _document_error(f"repeats the key {key.value[:40]!r}", key)
            seen.add((key.tag, key.value))
        return node

    def construct_number(self, node: yaml.ScalarNode) -> float | int:
        """Construct the value of a node that is tagged or resolved as a number."""
        text = self.construct_scalar(node)
        try:
            value = number_of(text)
        except ValueError:
            value = None
        if value is None or (node.tag == f"{_TAG}int" and isinstance(value, float)):
            raise ConstructorError(None, None, f"{text[:20]!r} is not a number that can be read", node.start_mark)
        try:
            return value if node.tag == f"{_TAG}int" else float(value)
        except OverflowError:
            return math.inf if value > 0 else -math.inf

    def construct_flag(self, node: yaml.ScalarNode) -> bool:
        """Construct the value of a node that is tagged or resolved as a boolean."""
        text = self.construct_scalar(node)
        if not BOOLEAN.fullmatch(text):
            raise ConstructorError(None, None, f"{text[:20]!r} is neither true nor false", node.start_mark)
        return text.lower() == "true"


def _children(node: yaml.Node) -> list[yaml.Node]:
    """The nodes in a collection, keys included."""
    if isinstance(node, yaml.MappingNode):
        return [child for pair in node.value for child in pair]
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []


Yaml12Loader.yaml_implicit_resolvers = {}
Yaml12Loader.yaml_constructors = {
    tag: constructor
    for tag, constructor in yaml.SafeLoader.yaml_constructors.items()
    if tag in {f"{_TAG}{name}" for name in ("null", "str", "seq", "map")} or tag is None
}
for _name in ("int", "float"):
    Yaml12Loader.add_constructor(f"{_TAG}{_name}", Yaml12Loader.construct_number)
Yaml12Loader.add_constructor(f"{_TAG}bool", Yaml12Loader.construct_flag)
for _name, _pattern, _first in (
    ("null", NULL, ["~", "n", "N", ""]),
    ("bool", BOOLEAN, list("tTfF")),
    ("int", INTEGER, list("-+0123456789")),
    ("float", FLOAT, list("-+.0123456789")),
    ("merge", re.compile("<<"), ["<"]),
):
    Yaml12Loader.add_implicit_resolver(f"{_TAG}{_name}", re.compile(rf"(?:{_pattern.pattern})\Z"), _first)
