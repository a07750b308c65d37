"""The documents, the modules and the metadata of the repository agree with each other."""

from __future__ import annotations

import ast
import re
import shlex
import subprocess
import tomllib
from pathlib import Path

import pytest
import yaml
from typer.core import TyperGroup
from typer.main import get_command

import wherry
from wherry.cli import app

ROOT = Path(__file__).parents[1]
FENCE = re.compile(r"^```[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"^(?: {4}|\t)(.*)$", re.MULTILINE)
LINK = re.compile(r"""\]\(<?([^)>\s]+)>?[^)]*\)|(?:src|href|srcset)="([^"]+)\"""")
HEADING = re.compile(r"^#+ +(.*?) *$", re.MULTILINE)
NAMED_FILE = re.compile(r"`([\w./-]+(?:/|\.(?:py|md|toml|html|urdf|world|json|yaml)))[`:]")


def tracked_files() -> list[Path]:
    """The files under version control."""
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return [ROOT / name for name in listing.split("\0") if name and (ROOT / name).is_file()]


DOCUMENTS = [path for path in tracked_files() if path.suffix == ".md"]
MODULES = sorted((ROOT / "src").rglob("*.py"))


def relative_name(path: Path) -> str:
    """A file's path from the root of the repository."""
    return path.relative_to(ROOT).as_posix()


def commands_of(text: str) -> list[list[str]]:
    """The wherry commands of a document's code blocks, as words."""
    blocks = FENCE.findall(text) + INDENTED.findall(FENCE.sub("", text))
    lines = (line.strip().removeprefix("$ ") for block in blocks for line in block.splitlines())
    commands = (shlex.split(line, comments=True) for line in lines if re.match(r"(\./)?wherry\s", line))
    return [words for words in commands if words[:2] != ["./wherry", "test"]]  # which the launcher handles itself


def check_command(words: list[str]) -> None:
    """Check that a command and its options exist."""
    command = get_command(app)
    arguments = words[1:]
    while isinstance(command, TyperGroup) and arguments and not arguments[0].startswith("-"):
        assert arguments[0] in command.commands, f"{shlex.join(words)}: wherry has no command {arguments[0]}"
        command = command.commands[arguments.pop(0)]
    options = {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
    for word in arguments:
        if word.startswith("-"):
            assert word.partition("=")[0] in options | {"--help", "-h"}, f"{shlex.join(words)}: no option {word}"


def anchors_of(document: Path) -> set[str]:
    """The anchors of a document's headings, as GitHub forms them."""
    headings = HEADING.findall(FENCE.sub("", document.read_text(encoding="utf-8")))
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_the_readme_shows_commands_that_exist() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert "./wherry deliver" in text
    assert "./wherry test" in text
    commands = commands_of(text)
    assert commands
    for words in commands:
        check_command(words)


def test_the_check_finds_unknown_commands_and_options() -> None:
    text = "```sh\n$ ./wherry fly  # up\n./wherry test -k x\n```\n\n    wherry deliver --wings 2\n"
    fly, wings = commands_of(text)
    assert (fly, wings) == (["./wherry", "fly"], ["wherry", "deliver", "--wings", "2"])
    with pytest.raises(AssertionError, match="no command fly"):
        check_command(fly)
    with pytest.raises(AssertionError, match="no option --wings"):
        check_command(wings)


@pytest.mark.parametrize("document", DOCUMENTS, ids=relative_name)
def test_relative_links_lead_to_existing_files_and_headings(document: Path) -> None:
    for groups in LINK.findall(FENCE.sub("", document.read_text(encoding="utf-8"))):
        target = "".join(groups)
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        path = (document.parent / name).resolve() if name else document
        assert path.is_relative_to(ROOT), f"{target} leads out of the repository"
        assert path.exists(), f"{target} does not exist"
        if anchor and path.suffix == ".md":
            assert anchor in anchors_of(path), f"{target}: no such heading"


def test_the_paper_is_mapped_to_files_and_folders_that_exist() -> None:
    named = NAMED_FILE.findall((ROOT / "docs/paper.md").read_text(encoding="utf-8"))
    assert named
    for name in named:
        assert any((ROOT / folder / name).exists() for folder in ("", "src/wherry", "docs")), f"{name} does not exist"


@pytest.mark.parametrize("module", MODULES, ids=relative_name)
def test_every_module_has_a_docstring(module: Path) -> None:
    assert ast.get_docstring(ast.parse(module.read_text(encoding="utf-8")))


def test_no_file_contains_a_path_of_a_machine() -> None:
    machine_path = re.compile(rb"(?<![\w.~-])/(?:work|root|home)/")
    tracked = tracked_files()
    assert ROOT / "pyproject.toml" in tracked
    assert [relative_name(path) for path in tracked if machine_path.search(path.read_bytes())] == []


def test_the_version_is_the_same_everywhere() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert wherry.__version__ == project["version"] == citation["version"]
    assert f"## [{wherry.__version__}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
