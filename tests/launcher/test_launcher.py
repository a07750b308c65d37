"""The launcher in a temporary clone, with fake installers on its PATH.

Virtual environments are real, created by the running Python without pip. Fake pip and uv record their calls and write
the files of an editable installation, without a network.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

LAUNCHER = Path(__file__).parents[2] / "wherry"
UTILITIES = ("cat", "cksum", "cp", "cut", "dirname", "readlink", "rm", "tee")
SITE_PACKAGES = f"lib/python{sys.version_info.major}.{sys.version_info.minor}/site-packages"

INSTALLER = f"""
import os, sys, time
from pathlib import Path

assert sys.prefix != sys.base_prefix, "would install into the system's Python"
with open(os.environ["CALLS"], "a") as calls:
    calls.write("install " + sys.argv[-1] + chr(10))
time.sleep(float(os.environ.get("INSTALL_SECONDS", "0")))
if "INSTALL_FAILS" in os.environ:
    sys.exit("no network")
print("Collecting numpy>=2.0 (from wherry==0.1.0)")
site_packages = Path(sys.prefix, "{SITE_PACKAGES}")
(site_packages / "wherry.pth").write_text(str(Path.cwd() / "src"))
if sys.argv[-1] == ".[dev]":
    for module in ("pytest", "sphinx", "fuzz"):
        program = f"import os, sys; print({{module!r}}, sys.argv[1:], 'in', os.getcwd()); sys.stdout.flush()"
        program += "; sys.exit(int(os.environ.get('REALTIME_STATUS' if sys.argv[-1] == 'realtime' else 'STATUS', '0')))"
        (site_packages / f"{{module}}.py").write_text(program)
cli = Path(sys.prefix, "bin", "wherry")
cli.write_text('#!/bin/sh' + chr(10) + 'printf "<%s>" "$@"; exit "${{CLI_STATUS-0}}"')
cli.chmod(0o755)
"""

PYTHON = f"""#!/bin/sh
if [ "$1 $2" = "-m venv" ]; then
    echo "venv" >>"$CALLS"
    "{sys.executable}" -m venv --without-pip "$3" && exec cp -R "$INSTALLER" "$3/{SITE_PACKAGES}/pip"
fi
exec "{sys.executable}" "$@"
"""

PYTHON_WITHOUT_VENV = f"""#!/bin/sh
case $* in *ensurepip*) exit 1 ;; esac
exec "{sys.executable}" "$@"
"""

UV = f"""#!/bin/sh
case "$1 $2" in
    "venv "*)
        echo "uv venv" >>"$CALLS"
        while [ $# -gt 1 ]; do shift; done
        exec "{sys.executable}" -m venv --without-pip "$1" ;;
    "pip install")
        shift 3
        echo "uv" >>"$CALLS"
        python=$1; shift
        exec "$python" "$INSTALLER/__main__.py" "$@" ;;
esac
"""


class Clone:
    """A clone of the project, and the programs that its launcher finds."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "a clone"
        self.tools = folder / "tools"
        self.calls_file = folder / "calls"
        self.calls_file.touch()
        (self.root / "src/wherry").mkdir(parents=True)
        (self.root / "src/wherry/__init__.py").touch()
        (self.root / "pyproject.toml").write_text('name = "wherry"\n')
        shutil.copy(LAUNCHER, self.root / "wherry")
        self.tools.mkdir()
        for name in UTILITIES:
            path = shutil.which(name)
            assert path is not None
            (self.tools / name).symlink_to(path)
        installer = folder / "pip"
        installer.mkdir()
        (installer / "__init__.py").touch()
        (installer / "__main__.py").write_text(INSTALLER)
        self.environment = {
            "PATH": str(self.tools),
            "CALLS": str(self.calls_file),
            "INSTALLER": str(installer),
            "PIP_REQUIRE_VIRTUALENV": "1",
        }

    def provide(self, name: str, script: str) -> None:
        """Put a command on the PATH."""
        path = self.tools / name
        path.write_text(script)
        path.chmod(0o755)

    def start(
        self, *arguments: str, launcher: str | None = None, cwd: Path | None = None, **variables: str
    ) -> subprocess.Popen[str]:
        """Start the launcher, with additional environment variables."""
        return subprocess.Popen(
            [launcher or self.root / "wherry", *arguments],
            env=self.environment | variables,
            cwd=cwd or "/",
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def run(
        self, *arguments: str, launcher: str | None = None, cwd: Path | None = None, **variables: str
    ) -> tuple[int, str, str]:
        """Run the launcher; returns exit status, standard output and standard error."""
        process = self.start(*arguments, launcher=launcher, cwd=cwd, **variables)
        output, errors = process.communicate(timeout=60)
        return process.returncode, output, errors

    def calls(self) -> list[str]:
        """The recorded calls of installers since the previous call of this method."""
        calls = self.calls_file.read_text().splitlines()
        self.calls_file.write_text("")
        return calls


@pytest.fixture
def clone_without_python(tmp_path: Path) -> Clone:
    return Clone(tmp_path)


@pytest.fixture
def clone(clone_without_python: Clone) -> Clone:
    clone_without_python.provide("python3", PYTHON)
    return clone_without_python


def test_the_first_call_sets_up_the_environment_and_runs_the_command(clone: Clone) -> None:
    status, output, errors = clone.run("deliver", "--world", "my world", "")
    assert (status, output) == (0, "<deliver><--world><my world><>")
    assert clone.calls() == ["venv", "install ."]
    assert [line.split()[:2] for line in errors.splitlines()] == [
        ["wherry:", "making"],
        ["wherry:", "installing"],
        ["wherry:", "numpy>=2.0"],
    ]


def test_the_second_call_installs_nothing(clone: Clone) -> None:
    clone.run()
    clone.calls()
    assert clone.run("deliver") == (0, "<deliver>", "")
    assert clone.calls() == []


def test_the_exit_status_is_that_of_the_command(clone: Clone) -> None:
    assert clone.run("deliver", CLI_STATUS="2")[0] == 2


def test_changed_metadata_is_installed_again(clone: Clone) -> None:
    clone.run()
    clone.calls()
    (clone.root / "pyproject.toml").write_text('name = "wherry"\nversion = "2"\n')
    assert clone.run("deliver")[:2] == (0, "<deliver>")
    assert clone.calls() == ["install ."]


@pytest.mark.parametrize("original_stays", [True, False], ids=["copied", "moved"])
def test_a_copied_or_moved_clone_gets_its_own_environment(clone: Clone, original_stays: bool) -> None:
    clone.run()
    clone.calls()
    elsewhere = clone.root.with_name("elsewhere")
    if original_stays:
        shutil.copytree(clone.root, elsewhere, symlinks=True)
    else:
        clone.root.rename(elsewhere)
    clone.root = elsewhere
    assert clone.run("deliver")[:2] == (0, "<deliver>")
    assert clone.calls() == ["venv", "install ."]
    assert (clone.root / f".venv/{SITE_PACKAGES}/wherry.pth").read_text() == str(clone.root / "src")


def test_a_failed_installation_is_reported_and_repeated(clone: Clone) -> None:
    status, output, errors = clone.run("deliver", INSTALL_FAILS="1")
    assert (status, output) == (1, "")
    assert "no network" in errors
    assert "did not succeed" in errors.splitlines()[-1]
    assert clone.run("deliver")[:2] == (0, "<deliver>")
    assert clone.calls() == ["venv", "install .", "install ."]


def test_an_interrupted_installation_is_repeated(clone: Clone) -> None:
    process = clone.start("deliver", INSTALL_SECONDS="60")
    while "install ." not in clone.calls_file.read_text():
        assert process.poll() is None
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    assert process.communicate()[0] == ""
    clone.calls()
    assert clone.run("deliver")[:2] == (0, "<deliver>")
    assert clone.calls() == ["install ."]


def test_simultaneous_calls_install_once(clone: Clone) -> None:
    processes = [clone.start(name, INSTALL_SECONDS="0.5") for name in ("first", "second")]
    results = [process.communicate(timeout=60) for process in processes]
    assert [process.returncode for process in processes] == [0, 0]
    assert [output for output, _ in results] == ["<first>", "<second>"]
    assert clone.calls() == ["venv", "install ."]
    assert sum("waiting for another" in errors for _, errors in results) == 1


def test_the_launcher_runs_through_symbolic_links(clone: Clone, tmp_path: Path) -> None:
    folder = tmp_path / "some bin"
    folder.mkdir()
    (folder / "wherry").symlink_to("../a clone/wherry")
    (tmp_path / "link").symlink_to(folder / "wherry")
    assert clone.run("deliver", launcher="./link", cwd=tmp_path)[:2] == (0, "<deliver>")
    assert (clone.root / ".venv").is_dir()


def _break_link(venv: Path) -> None:
    (venv / "bin/python").unlink()
    (venv / "bin/python").symlink_to("/nonexistent/python3")


def _remove_pip(venv: Path) -> None:
    shutil.rmtree(venv / SITE_PACKAGES)


def _remove_settings(venv: Path) -> None:
    (venv / "pyvenv.cfg").unlink()


@pytest.mark.parametrize("damage", [_break_link, _remove_pip, _remove_settings])
def test_a_broken_environment_is_replaced(clone: Clone, damage: Callable[[Path], None]) -> None:
    clone.run()
    clone.calls()
    damage(clone.root / ".venv")
    assert clone.run("deliver")[:2] == (0, "<deliver>")
    assert clone.calls() == ["venv", "install ."]


def test_an_existing_environment_is_used(clone: Clone) -> None:
    subprocess.run([clone.tools / "python3", "-m", "venv", clone.root / ".venv"], env=clone.environment, check=True)
    clone.calls()
    assert clone.run("deliver")[:2] == (0, "<deliver>")
    assert clone.calls() == ["install ."]


def test_the_first_test_run_installs_development_dependencies(clone: Clone) -> None:
    clone.run("deliver")
    assert clone.calls() == ["venv", "install ."]
    for expected in (["install .[dev]"], []):
        status, output, _ = clone.run("test", "-k", "two words")
        assert (status, output) == (0, f"pytest ['-k', 'two words'] in {clone.root}\n")
        assert clone.calls() == expected
    assert clone.run("deliver") == (0, "<deliver>", "")


ALL_CORES = ["--numprocesses", "auto", "--maxprocesses", "8", "-m", "not realtime"]


def test_tests_run_on_all_cores_and_real_time_ones_alone_afterwards(clone: Clone) -> None:
    status, output, _ = clone.run("test")
    assert output == f"pytest {ALL_CORES} in {clone.root}\npytest ['-m', 'realtime'] in {clone.root}\n"
    assert status == 0


@pytest.mark.parametrize(("first", "second"), [(1, 0), (0, 1), (1, 1)])
def test_a_failure_in_either_group_of_tests_is_reported(clone: Clone, first: int, second: int) -> None:
    status, output, _ = clone.run("test", STATUS=str(first), REALTIME_STATUS=str(second))
    assert (status, output.count("pytest [")) == (1, 2)


def test_interrupting_the_first_group_skips_the_second(clone: Clone) -> None:
    status, output, _ = clone.run("test", STATUS="2")
    assert (status, output.count("pytest [")) == (2, 1)


def test_docs_builds_the_site(clone: Clone) -> None:
    status, output, _ = clone.run("docs", "--quiet")
    arguments = ["--fail-on-warning", "--keep-going", "--quiet", "docs", "site"]
    assert (status, output) == (0, f"sphinx {arguments} in {clone.root}\n")


def test_fuzz_loads_damaged_files(clone: Clone) -> None:
    status, output, _ = clone.run("fuzz", "--files", "10")
    assert (status, output) == (0, f"fuzz ['--files', '10'] in {clone.root}\n")


def test_uv_is_preferred_to_pip(clone: Clone) -> None:
    clone.provide("uv", UV)
    assert clone.run("deliver")[:2] == (0, "<deliver>")
    assert clone.calls() == ["uv venv", "uv", "install ."]
    assert clone.run("test")[0] == 0
    assert clone.calls() == ["uv", "install .[dev]"]


def test_uv_needs_no_venv_module(clone_without_python: Clone) -> None:
    clone_without_python.provide("python3", PYTHON_WITHOUT_VENV)
    clone_without_python.provide("uv", UV)
    assert clone_without_python.run("deliver")[:2] == (0, "<deliver>")


def test_pythons_that_do_not_work_are_skipped(clone: Clone) -> None:
    clone.provide("python3.13", "#!/bin/sh\necho 'python3.13: command not found' >&2\nexit 127\n")
    clone.provide("python3.12", PYTHON_WITHOUT_VENV)
    status, output, errors = clone.run("deliver")
    assert (status, output) == (0, "<deliver>")
    assert "not found" not in errors


@pytest.mark.parametrize("python", [None, "#!/bin/sh\nexit 1\n"], ids=["none", "too old"])
def test_a_missing_python_is_reported_with_install_commands(clone_without_python: Clone, python: str | None) -> None:
    if python is not None:
        clone_without_python.provide("python3", python)
    status, output, errors = clone_without_python.run("deliver")
    assert (status, output) == (2, "")
    assert len(errors.splitlines()) == 2
    for words in ("Python 3.11 or newer", "apt install", "dnf install", "brew install"):
        assert words in errors
    assert not (clone_without_python.root / ".venv").exists()


def test_a_missing_venv_module_is_reported_with_install_commands(clone_without_python: Clone) -> None:
    clone_without_python.provide("python3", PYTHON_WITHOUT_VENV)
    status, output, errors = clone_without_python.run("deliver")
    assert (status, output) == (2, "")
    assert len(errors.splitlines()) == 2
    assert "venv module" in errors
    assert "apt install python3-venv" in errors
    assert not (clone_without_python.root / ".venv").exists()
