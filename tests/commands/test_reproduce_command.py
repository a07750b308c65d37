"""wherry reproduce: output files and errors."""

from __future__ import annotations

from pathlib import Path

import pytest

from wherry.commands import reproduce as command
from wherry.commands.reproduce import Progress
from wherry_testing.command_line import RunCommand


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Replace the experiments by a fake one; returns the image folders that it is called with."""
    folders = []

    def run(data: Path, images: Path, progress: Progress) -> str:
        folders.append(images)
        progress(1, 1)
        return "## Quick\n"

    monkeypatch.setattr(command, "REPRODUCTIONS", {"taxi": run})
    return folders


def test_in_a_checkout_results_are_written_to_docs_results_md(
    run_command: RunCommand, quick: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "results.md").write_text("# Results\n")
    (tmp_path / "pyproject.toml").touch()
    assert run_command("reproduce", "taxi")[0] == 0
    assert "## Quick" in (tmp_path / "docs" / "results.md").read_text()
    assert quick == [Path("docs/images")]


def test_outside_a_checkout_results_are_written_to_the_current_folder(
    run_command: RunCommand, quick: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_command("reproduce", "taxi", "--quiet")[1:] == ("", "")
    assert "`wherry reproduce taxi` wrote this section." in (tmp_path / "results.md").read_text()
    assert quick == [Path("images")]


def test_pictures_are_written_beside_the_chosen_file(
    run_command: RunCommand, quick: list[Path], tmp_path: Path
) -> None:
    run_command("reproduce", "all", "--out", tmp_path / "mine.md")
    assert (tmp_path / "mine.md").exists()
    assert quick == [tmp_path / "images"]


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["chess"], "wherry: NAME: chess: is none of taxi, slam, sites, localization, maps, delivery, figures, all\n"),
        (["taxi", "--out", "gone/results.md"], "wherry: --out: gone/results.md: is in a folder that does not exist\n"),
    ],
)
def test_unknown_names_and_folders_are_rejected(run_command: RunCommand, arguments: list[str], line: str) -> None:
    status, out, err = run_command("reproduce", *arguments)
    assert (status, out, err) == (2, "", line)


@pytest.mark.parametrize(("name", "others"), [("slam", 5), ("localization", 7)])
def test_missing_logs_are_reported_before_anything_is_computed(
    run_command: RunCommand, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, others: int
) -> None:
    monkeypatch.setenv("WHERRY_DATA", str(tmp_path / "nowhere"))
    status, out, err = run_command("reproduce", name, "--out", tmp_path / "results.md", "--quiet")
    log = tmp_path / "nowhere" / "intel" / "intel_910_rawodom.clf.gz"
    assert (status, out) == (2, "")
    assert err.startswith(f"wherry: {log}: is missing (and {others} more); set WHERRY_DATA or --data to the folder ")
    assert err.count("\n") == 1
    assert not (tmp_path / "results.md").exists()
