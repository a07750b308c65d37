"""The README and the pages of docs/ agree with the code and the example files."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

from wherry.floorplan.world_files import load_world
from wherry.pipelines.delivery.simulated import DeliverySettings, prepare_delivery
from wherry.trace.records import null_sink

ROOT = Path(__file__).parents[2]
MIN_QUOTED_WORDS = 3  # words that are not the code's by chance


def blocks_of(page: str, language: str) -> list[str]:
    """The fenced code blocks of a language, without their last newline."""
    return re.findall(rf"^```{language}\n(.*?)\n```$", (ROOT / page).read_text("utf-8"), re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize(
    ("page", "language", "example"),
    [
        ("docs/tutorial.md", "text", "docs/examples/home.txt"),
        ("docs/tutorial.md", "python", "docs/examples/lights.py"),
        ("docs/how-to/ros.md", "yaml", "src/wherry/ros/body.yaml"),
    ],
)
def test_examples_in_the_docs_equal_their_files(page: str, language: str, example: str) -> None:
    text = (ROOT / example).read_text("utf-8")
    blocks = [block for block in blocks_of(page, language) if block in text]
    assert re.sub(r"\s+", "", "".join(blocks)) == re.sub(r"\s+", "", text)


def test_the_python_example_of_the_readme_runs() -> None:
    example = "\n".join(blocks_of("README.md", "python"))
    command = [sys.executable, "-c", example]
    printed = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout
    assert "E: if not touch_E(janitor, wall): janitor.x += 1" in printed


@pytest.mark.parametrize("seed", [0, 1])
def test_the_world_of_the_readme_is_delivered(tmp_path: Path, seed: int) -> None:
    """One of its boxes stands in a niche and is visible from few cells only."""
    readme = (ROOT / "README.md").read_text("utf-8")
    drawing = re.search(r"^    wherry-world: 1\n(?:(?:    .*)?\n)+", readme, re.MULTILINE)
    assert drawing is not None
    world = tmp_path / "tiny.txt"
    world.write_text(re.sub("^    ", "", drawing[0].rstrip() + "\n", flags=re.MULTILINE))
    assert len(load_world(world).boxes) == 2
    result = prepare_delivery(DeliverySettings(world=str(world), seed=seed, out=tmp_path / "out"))(null_sink)
    assert (result.delivered, result.collisions, result.exit_status) == (2, 0, 0)


def test_the_world_of_the_tutorial_is_delivered(tmp_path: Path) -> None:
    world = str(ROOT / "docs/examples/home.txt")
    result = prepare_delivery(DeliverySettings(world=world, seed=3, out=tmp_path))(null_sink)
    assert (result.delivered, result.boxes, result.collisions) == (3, 3, 0)


def sections_with_pictures(page: str) -> list[str]:
    """The sections of a page that show a picture, by their text."""
    sections = re.split(r"^## ", (ROOT / page).read_text("utf-8"), flags=re.MULTILINE)
    return [section for section in sections if re.search(r"\]\((docs/|\.\./)?images/", section)]


PAGES = ["README.md", *sorted(str(path.relative_to(ROOT)) for path in (ROOT / "docs").glob("**/*.md"))]
PAGES_WITH_PICTURES = [page for page in PAGES if sections_with_pictures(page)]


def test_readme_and_results_show_pictures() -> None:
    assert {"README.md", "docs/results.md"} <= set(PAGES_WITH_PICTURES)


@pytest.mark.parametrize("page", PAGES_WITH_PICTURES)
def test_every_section_with_a_picture_names_the_command_that_made_it(page: str) -> None:
    for section in sections_with_pictures(page):
        assert re.search(r"`(\./)?wherry [^`]+`", section), f"{page}: {section.partition(chr(10))[0]}"


def test_the_lines_quoted_in_the_table_of_situations_are_those_of_the_code() -> None:
    """A part of each, between numbers and names that are inserted, stands in the code as it does on the page."""
    sources = [path.read_text("utf-8") for path in (ROOT / "src/wherry").rglob("*.py")]
    texts = [text.lower() for source in sources for text in strings_of(source)]
    quotes = re.findall("“(.+?)”", (ROOT / "docs/how-to/logs.md").read_text("utf-8"))
    assert len(quotes) > 20
    for quote in quotes:
        fragments = re.split(r"\b[nmxy]\b|\d[\d.]*|'\w+'|/\w+|[\"():;°%]", quote.lower())
        parts = [
            fragment.strip() for fragment in fragments if len(re.findall(r"[^\W\d_]+", fragment)) >= MIN_QUOTED_WORDS
        ]
        assert not parts or any(part in text for part in parts for text in texts), quote


def strings_of(source: str) -> list[str]:
    """The strings of a module; each inserted value is a mark."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.JoinedStr):
            parts = (part.value if isinstance(part, ast.Constant) else "\0" for part in node.values)
            found.append("".join(map(str, parts)))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.append(node.value)
    return found


def test_the_modules_named_in_the_architecture_exist() -> None:
    text = (ROOT / "docs/architecture.md").read_text("utf-8")
    named = set(re.findall(r"`((?:[a-z_0-9]+/)+[a-z_0-9]+\.py|(?:[a-z_0-9]+/)+)`", text))
    assert len(named) > 30
    for path in named:
        roots = (ROOT / "src/wherry", ROOT / "tests")
        assert any(any(root.rglob(path)) for root in roots) or (ROOT / path).exists(), path
    for test in re.findall(r"`(test_\w+)`", text):
        assert any(f"def {test}(" in path.read_text("utf-8") for path in (ROOT / "tests").rglob("test_*.py")), test
