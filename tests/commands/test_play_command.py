"""wherry play on a pipe and on a terminal."""

from __future__ import annotations

import io
import json
import os
import pty
import select
import subprocess
import sys
import time

import pytest

from wherry.commands import play as command
from wherry.pipelines.grids.game_setups import GAME_SETUPS, PLAY_LEARNERS
from wherry_testing.command_line import CommandResult, RunCommand


@pytest.fixture
def play(run_command: RunCommand, monkeypatch: pytest.MonkeyPatch) -> RunCommand:
    """A function that runs ``wherry play`` with text on standard input."""

    def played(typed: str, *arguments: object) -> CommandResult:
        monkeypatch.setattr(sys, "stdin", io.StringIO(typed))
        return run_command("play", *arguments)

    return played


def test_a_pipe_is_read_line_by_line(play: RunCommand) -> None:
    status, out, _ = play("N\npickup\nss\nq\nn\n", "taxi", "--seed", 1)
    assert status == 0
    screens = out.split("Taxi 5×5, learner bayes: ")[1:]
    assert [screen.partition(",")[0] for screen in screens] == [f"step {number}" for number in range(5)]
    assert "cond(s) = " in screens[0]
    assert "touch_N(taxi, wall)" in screens[0]
    assert screens[0].count("UNKNOWN") == 6
    assert screens[1].count("UNKNOWN") < 6
    assert "\x1b" not in out


def test_the_learner_completes_an_episode_when_asked(play: RunCommand) -> None:
    status, out, err = play("l" * 200, "delivery", "--boxes", 1, "--json")
    assert status == 0
    result = json.loads(out)
    assert result["episodes"] == 1
    assert result["rules"] >= 6
    assert "robot.x += 1" in err
    assert "This episode is over" in err


def test_unknown_keys_are_reported_and_take_no_step(play: RunCommand) -> None:
    _, out, _ = play("north\nr\nx\n", "taxi")
    assert "'north' is not a key" in out
    assert "'x' is not a key" in out
    assert "step 1" not in out


def test_keys_act_at_once_on_a_terminal() -> None:
    terminal, child_side = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "wherry", "play", "taxi"],
        stdin=child_side,
        stdout=child_side,
        stderr=child_side,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "100"},
    )
    os.close(child_side)
    try:
        shown = read_until(terminal, "step 0")
        os.write(terminal, b"\x1b[A")
        shown += read_until(terminal, "step 1")
        os.write(terminal, b"p")
        shown += read_until(terminal, "step 2")
        os.write(terminal, b"q")
        shown += read_until(terminal, None)
        assert process.wait(timeout=30) == 0
    finally:
        process.kill()
        process.wait()
        os.close(terminal)
    assert "PICKUP: nothing changes" in shown


def read_until(terminal: int, words: str | None) -> str:
    """The output of a terminal until it contains some words, or until the terminal is closed."""
    output, deadline = "", time.monotonic() + 60
    while words is None or words not in output:
        assert time.monotonic() < deadline, output
        if select.select([terminal], [], [], 1.0)[0]:
            try:
                output += os.read(terminal, 65536).decode("utf-8", errors="replace")
            except OSError:  # the other side is closed
                break
    return output


@pytest.mark.parametrize("arguments", [["chess"], ["taxi", "--learner", "oracle"], ["delivery", "--boxes", "900"]])
def test_invalid_input_is_rejected_in_one_line(run_command: RunCommand, arguments: list[str]) -> None:
    status, out, err = run_command("play", *arguments)
    assert (status, out) == (2, "")
    assert err.count("\n") == 1


def test_the_command_offers_all_domains_and_learners_of_games() -> None:
    assert (set(command.DOMAINS), set(command.LEARNERS)) == (set(GAME_SETUPS), set(PLAY_LEARNERS))
