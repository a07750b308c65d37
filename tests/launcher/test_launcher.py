"""The launcher in a temporary clone, with a PATH on which only stand-ins for Python's installers are found.

Environments are real, made by the running Python without pip; what would come over the network, pip and uv, only notes
how it was called and leaves behind what an editable installation leaves.
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

assert sys.prefix != sys.base_prefix, "would install into the machine's own Python"
with open(os.environ["CALLS"], "a") as calls:
    calls.write("install " + sys.argv[-1] + chr(10))
time.sleep(float(os.environ.get("INSTALL_SECONDS", "0")))
if "INSTALL_FAILS" in os.environ:
    sys.exit("no network")
print("Collecting numpy>=2.0 (from wherry==0.1.0)")
site_packages = Path(sys.prefix, "{SITE_PACKAGES}")
(site_packages / "wherry.pth").write_text(str(Path.cwd() / "src"))
if sys.argv[-1] == ".[dev]":
    for module in ("pytest", "sphinx"):
        said = f"import os, sys; print({{module!r}}, sys.argv[1:], 'in', os.getcwd()); sys.stdout.flush()"
        said += "; sys.exit(int(os.environ.get('REALTIME_STATUS' if sys.argv[-1] == 'realtime' else 'STATUS', '0')))"
        (site_packages / f"{{module}}.py").write_text(said)
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
    """A clone of the project, and all that its launcher finds of the machine."""

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
        """Start the launcher with further environment variables."""
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
        """Run the launcher to its end: exit status, standard output, standard error."""
        process = self.start(*arguments, launcher=launcher, cwd=cwd, **variables)
        output, errors = process.communicate(timeout=60)
        return process.returncode, output, errors

    def calls(self) -> list[str]:
        """What was made and installed since the last time that this was asked."""
        calls = self.calls_file.read_text().splitlines()
        self.calls_file.write_text("")
        return calls


@pytest.fixture
def bare(tmp_path: Path) -> Clone:
    return Clone(tmp_path)


@pytest.fixture
def clone(bare: Clone) -> Clone:
    bare.provide("python3", PYTHON)
    return bare


def test_sets_itself_up_and_hands_over(clone: Clone) -> None:
    status, output, errors = clone.run("deliver", "--world", "my world", "")
    assert (status, output) == (0, "<deliver><--world><my world><>")
    assert clone.calls() == ["venv", "install ."]
    assert [line.split()[:2] for line in errors.splitlines()] == [
        ["wherry:", "making"],
        ["wherry:", "installing"],
        ["wherry:", "numpy>=2.0"],
    ]


def test_installs_once(clone: Clone) -> None:
    clone.run()
    clone.calls()
    assert clone.run("deliver") == (0, "<deliver>", "")
    assert clone.calls() == []


def test_passes_the_exit_status_on(clone: Clone) -> None:
    assert clone.run("deliver", CLI_STATUS="2")[0] == 2


def test_installs_again_when_the_metadata_changed(clone: Clone) -> None:
    clone.run()
    clone.calls()
    (clone.root / "pyproject.toml").write_text('name = "wherry"\nversion = "2"\n')
    assert clone.run("deliver")[:2] == (0, "<deliver>")
    assert clone.calls() == ["install ."]


@pytest.mark.parametrize("original_stays", [True, False], ids=["copied", "moved"])
def test_a_clone_from_elsewhere_gets_its_own_environment(clone: Clone, original_stays: bool) -> None:
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


def test_a_failed_installation_is_said_and_tried_again(clone: Clone) -> None:
    status, output, errors = clone.run("deliver", INSTALL_FAILS="1")
    assert (status, output) == (1, "")
    assert "no network" in errors
    assert "did not succeed" in errors.splitlines()[-1]
    assert clone.run("deliver")[:2] == (0, "<deliver>")
    assert clone.calls() == ["venv", "install .", "install ."]


def test_an_interrupted_installation_is_done_again(clone: Clone) -> None:
    process = clone.start("deliver", INSTALL_SECONDS="60")
    while "install ." not in clone.calls_file.read_text():
        assert process.poll() is None
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    assert process.communicate()[0] == ""
    clone.calls()
    assert clone.run("deliver")[:2] == (0, "<deliver>")
    assert clone.calls() == ["install ."]


def test_two_launches_at_once_install_once(clone: Clone) -> None:
    processes = [clone.start(name, INSTALL_SECONDS="0.5") for name in ("first", "second")]
    results = [process.communicate(timeout=60) for process in processes]
    assert [process.returncode for process in processes] == [0, 0]
    assert [output for output, _ in results] == ["<first>", "<second>"]
    assert clone.calls() == ["venv", "install ."]
    assert sum("waiting for another" in errors for _, errors in results) == 1


def test_runs_through_symbolic_links_from_anywhere(clone: Clone, tmp_path: Path) -> None:
    folder = tmp_path / "some bin"
    folder.mkdir()
    (folder / "wherry").symlink_to("../a clone/wherry")
    (tmp_path / "link").symlink_to(folder / "wherry")
    assert clone.run("deliver", launcher="./link", cwd=tmp_path)[:2] == (0, "<deliver>")
    assert (clone.root / ".venv").is_dir()


def _dangling(venv: Path) -> None:
    (venv / "bin/python").unlink()
    (venv / "bin/python").symlink_to("/nonexistent/python3")


def _without_pip(venv: Path) -> None:
    shutil.rmtree(venv / SITE_PACKAGES)


def _without_settings(venv: Path) -> None:
    (venv / "pyvenv.cfg").unlink()


@pytest.mark.parametrize("damage", [_dangling, _without_pip, _without_settings])
def test_makes_a_broken_environment_anew(clone: Clone, damage: Callable[[Path], None]) -> None:
    clone.run()
    clone.calls()
    damage(clone.root / ".venv")
    assert clone.run("deliver")[:2] == (0, "<deliver>")
    assert clone.calls() == ["venv", "install ."]


def test_uses_an_environment_that_is_there(clone: Clone) -> None:
    subprocess.run([clone.tools / "python3", "-m", "venv", clone.root / ".venv"], env=clone.environment, check=True)
    clone.calls()
    assert clone.run("deliver")[:2] == (0, "<deliver>")
    assert clone.calls() == ["install ."]


def test_tests_have_their_own_installation(clone: Clone) -> None:
    clone.run("deliver")
    assert clone.calls() == ["venv", "install ."]
    for expected in (["install .[dev]"], []):
        status, output, _ = clone.run("test", "-k", "two words")
        assert (status, output) == (0, f"pytest ['-k', 'two words'] in {clone.root}\n")
        assert clone.calls() == expected
    assert clone.run("deliver") == (0, "<deliver>", "")


ALL_CORES = ["--numprocesses", "auto", "--maxprocesses", "8", "-m", "not realtime"]


def test_all_tests_run_on_all_cores_and_real_time_ones_alone_at_the_end(clone: Clone) -> None:
    status, output, _ = clone.run("test")
    assert output == f"pytest {ALL_CORES} in {clone.root}\npytest ['-m', 'realtime'] in {clone.root}\n"
    assert status == 0


@pytest.mark.parametrize(("first", "second"), [(1, 0), (0, 1), (1, 1)])
def test_a_failure_in_either_group_of_tests_is_reported(clone: Clone, first: int, second: int) -> None:
    status, output, _ = clone.run("test", STATUS=str(first), REALTIME_STATUS=str(second))
    assert (status, output.count("pytest [")) == (1, 2)


def test_an_interrupted_first_group_ends_the_tests(clone: Clone) -> None:
    status, output, _ = clone.run("test", STATUS="2")
    assert (status, output.count("pytest [")) == (2, 1)


def test_builds_the_site(clone: Clone) -> None:
    status, output, _ = clone.run("docs", "--quiet")
    arguments = ["--fail-on-warning", "--keep-going", "--quiet", "docs", "site"]
    assert (status, output) == (0, f"sphinx {arguments} in {clone.root}\n")


def test_prefers_uv(clone: Clone) -> None:
    clone.provide("uv", UV)
    assert clone.run("deliver")[:2] == (0, "<deliver>")
    assert clone.calls() == ["uv venv", "uv", "install ."]
    assert clone.run("test")[0] == 0
    assert clone.calls() == ["uv", "install .[dev]"]


def test_uv_needs_no_venv_module(bare: Clone) -> None:
    bare.provide("python3", PYTHON_WITHOUT_VENV)
    bare.provide("uv", UV)
    assert bare.run("deliver")[:2] == (0, "<deliver>")


def test_takes_a_python_that_works(clone: Clone) -> None:
    clone.provide("python3.13", "#!/bin/sh\necho 'python3.13: command not found' >&2\nexit 127\n")
    clone.provide("python3.12", PYTHON_WITHOUT_VENV)
    status, output, errors = clone.run("deliver")
    assert (status, output) == (0, "<deliver>")
    assert "not found" not in errors


@pytest.mark.parametrize("python", [None, "#!/bin/sh\nexit 1\n"], ids=["none", "too old"])
def test_says_what_to_install_without_python(bare: Clone, python: str | None) -> None:
    if python is not None:
        bare.provide("python3", python)
    status, output, errors = bare.run("deliver")
    assert (status, output) == (2, "")
    assert len(errors.splitlines()) == 2
    for words in ("Python 3.11 or newer", "apt install", "dnf install", "brew install"):
        assert words in errors
    assert not (bare.root / ".venv").exists()


def test_says_what_to_install_without_venv(bare: Clone) -> None:
    bare.provide("python3", PYTHON_WITHOUT_VENV)
    status, output, errors = bare.run("deliver")
    assert (status, output) == (2, "")
    assert len(errors.splitlines()) == 2
    assert "venv module" in errors
    assert "apt install python3-venv" in errors
    assert not (bare.root / ".venv").exists()
