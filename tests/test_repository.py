"""What the repository promises: documents that lead somewhere, commands that exist, a quick --help, one version."""

from __future__ import annotations

import ast
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml
from typer.core import TyperGroup
from typer.main import get_command

import wherry
from wherry.cli import app

ROOT = Path(__file__).parents[1]
HEAVY = {"gymnasium", "mujoco", "numba", "numpy", "pydantic", "scipy"}
FENCE = re.compile(r"^```[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"^(?: {4}|\t)(.*)$", re.MULTILINE)
LINK = re.compile(r"""\]\(<?([^)>\s]+)>?[^)]*\)|(?:src|href|srcset)="([^"]+)\"""")
HEADING = re.compile(r"^#+ +(.*?) *$", re.MULTILINE)
NAMED_FILE = re.compile(r"`([\w./-]+(?:/|\.(?:py|md|toml|html|urdf|world|json|yaml)))`")


def _tracked() -> list[Path]:
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return [ROOT / name for name in listing.split("\0") if name and (ROOT / name).is_file()]


DOCUMENTS = [path for path in _tracked() if path.suffix == ".md"]
MODULES = sorted((ROOT / "src").rglob("*.py"))


def _name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def _command_lines(text: str) -> list[list[str]]:
    """The wherry commands of a document's code blocks, as words."""
    blocks = FENCE.findall(text) + INDENTED.findall(FENCE.sub("", text))
    lines = (line.strip().removeprefix("$ ") for block in blocks for line in block.splitlines())
    commands = (shlex.split(line, comments=True) for line in lines if re.match(r"(\./)?wherry\s", line))
    return [
        words for words in commands if words[:2] != ["./wherry", "test"]
    ]  # the launcher's own; it hands others over


def _check_command(words: list[str]) -> None:
    command = get_command(app)
    arguments = words[1:]
    while isinstance(command, TyperGroup) and arguments and not arguments[0].startswith("-"):
        assert arguments[0] in command.commands, f"{shlex.join(words)}: wherry has no command {arguments[0]}"
        command = command.commands[arguments.pop(0)]
    options = {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
    for word in arguments:
        if word.startswith("-"):
            assert word.partition("=")[0] in options | {"--help", "-h"}, f"{shlex.join(words)}: no option {word}"


def _anchors(document: Path) -> set[str]:
    headings = HEADING.findall(FENCE.sub("", document.read_text(encoding="utf-8")))
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_the_readme_shows_commands_that_exist() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert "./wherry deliver" in text
    assert "./wherry test" in text
    commands = _command_lines(text)
    assert commands
    for words in commands:
        _check_command(words)


def test_a_command_that_does_not_exist_would_be_noticed() -> None:
    text = "```sh\n$ ./wherry fly  # up\n./wherry test -k x\n```\n\n    wherry deliver --wings 2\n"
    fly, wings = _command_lines(text)
    assert (fly, wings) == (["./wherry", "fly"], ["wherry", "deliver", "--wings", "2"])
    with pytest.raises(AssertionError, match="no command fly"):
        _check_command(fly)
    with pytest.raises(AssertionError, match="no option --wings"):
        _check_command(wings)


@pytest.mark.parametrize("document", DOCUMENTS, ids=_name)
def test_relative_links_lead_somewhere(document: Path) -> None:
    for groups in LINK.findall(FENCE.sub("", document.read_text(encoding="utf-8"))):
        target = "".join(groups)
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        path = (document.parent / name).resolve() if name else document
        assert path.is_relative_to(ROOT), f"{target} leads out of the repository"
        assert path.exists(), f"{target} does not exist"
        if anchor and path.suffix == ".md":
            assert anchor in _anchors(path), f"{target}: no such heading"


def test_the_paper_is_mapped_to_files_and_folders_that_exist() -> None:
    named = NAMED_FILE.findall((ROOT / "docs/paper.md").read_text(encoding="utf-8"))
    assert named
    for name in named:
        assert any((ROOT / folder / name).exists() for folder in ("", "src/wherry", "docs")), f"{name} does not exist"


def test_help_imports_nothing_heavy() -> None:
    program = "import sys; from wherry.cli import main; sys.argv = ['wherry', '--help']; main()"
    result = subprocess.run(
        [sys.executable, "-X", "importtime", "-c", program], check=True, capture_output=True, text=True
    )
    assert "deliver" in result.stdout
    imported = {line.rpartition("|")[2].strip() for line in result.stderr.splitlines()}
    assert "wherry.cli" in imported
    assert not {name.partition(".")[0] for name in imported} & HEAVY


@pytest.mark.parametrize("module", MODULES, ids=_name)
def test_every_module_says_what_it_is(module: Path) -> None:
    assert ast.get_docstring(ast.parse(module.read_text(encoding="utf-8")))


def test_names_no_machine_paths() -> None:
    machine_path = re.compile(rb"(?<![\w.~-])/(?:work|root|home)/")
    tracked = _tracked()
    assert ROOT / "pyproject.toml" in tracked
    assert [_name(path) for path in tracked if machine_path.search(path.read_bytes())] == []


def test_has_one_version() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert wherry.__version__ == project["version"] == citation["version"]
    assert f"## [{wherry.__version__}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
