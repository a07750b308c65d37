"""Tests of a package import nothing from the layers above it, neither themselves nor through shared helpers."""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
PROJECT = tomllib.loads((TESTS.parent / "pyproject.toml").read_text(encoding="utf-8"))
HELPERS = "wherry_testing"


def _layers() -> dict[str, int]:
    """Height of every package's layer, 0 for the lowest."""
    contracts = PROJECT["tool"]["importlinter"]["contracts"]
    layers = next(contract["layers"] for contract in contracts if contract["type"] == "layers")
    return {name.strip(): height for height, layer in enumerate(reversed(layers)) for name in layer.split("|")}


LAYERS = _layers()


def _package(path: Path) -> str | None:
    """The package that a test file tests, by its folder, or by its name where it lies in no folder."""
    folder = path.relative_to(TESTS).parts[0]
    name = folder if (TESTS / folder).is_dir() else path.stem.removeprefix("test_")
    if name == "commands":
        return "cli"  # commands are tested as people call them
    return name if name in LAYERS else None


TEST_FILES = [path for path in sorted(TESTS.rglob("*.py")) if _package(path)]


def _imported(tree: ast.AST) -> Iterator[str]:
    """Every module that a file imports, wherever the import stands."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@cache
def _packages_used(path: Path) -> frozenset[str]:
    """The packages of wherry that a file imports, itself or through the helpers that it imports."""
    used: set[str] = set()
    for module in _imported(ast.parse(path.read_text(encoding="utf-8"))):
        first, *rest = module.split(".")
        if first == "wherry" and rest and rest[0] in LAYERS:
            used.add(rest[0])
        elif first == HELPERS and rest:
            used |= _packages_used(TESTS / HELPERS / f"{rest[0]}.py")
    return frozenset(used)


def _from_above(package: str, used: frozenset[str]) -> set[str]:
    """The packages that a test of a package must not use: those in higher layers."""
    return {other for other in used if LAYERS[other] > LAYERS[package]}


@pytest.mark.parametrize("path", TEST_FILES, ids=lambda path: path.relative_to(TESTS).as_posix())
def test_tests_import_nothing_from_above(path: Path) -> None:
    package = _package(path)
    assert package is not None
    assert _from_above(package, _packages_used(path)) == set()


def test_an_import_from_a_higher_layer_would_be_found() -> None:
    assert _from_above("mapping", frozenset({"mapping", "localization", "space", "commands"})) == {"commands"}
