"""wherry play on a pipe and on a terminal: its screens and its keys."""

from __future__ import annotations

import io
import json
import os
import pty
import select
import subprocess
import sys
import time
from collections.abc import Callable

import pytest

from wherry.commands import play as command
from wherry.pipelines.grids.game_setups import GAME_SETUPS, PLAY_LEARNERS

Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def play(call: Call, monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[int, str, str]]:
    """Play with some typed lines."""

    def played(typed: str, *arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "stdin", io.StringIO(typed))
        return call("play", *arguments)

    return played


def test_a_pipe_is_read_line_by_line(play: Call) -> None:
    status, out, _ = play("N\npickup\nss\nq\nn\n", "taxi", "--seed", 1)
    assert status == 0
    screens = out.split("Taxi 5×5, learner bayes: ")[1:]
    assert [screen.partition(",")[0] for screen in screens] == [f"step {number}" for number in range(5)]
    assert "cond(s) = " in screens[0]
    assert "touch_N(taxi, wall)" in screens[0]
    assert screens[0].count("UNKNOWN") == 6
    assert screens[1].count("UNKNOWN") < 6
    assert "\x1b" not in out


def test_the_learner_completes_an_episode_when_asked(play: Call) -> None:
    status, out, err = play("l" * 200, "delivery", "--boxes", 1, "--json")
    assert status == 0
    result = json.loads(out)
    assert result["episodes"] == 1
    assert result["rules"] >= 6
    assert "robot.x += 1" in err
    assert "This episode is over" in err


def test_unknown_keys_are_reported_and_do_nothing(play: Call) -> None:
    _, out, _ = play("north\nr\nx\n", "taxi")
    assert "'north' is not a key" in out
    assert "'x' is not a key" in out
    assert "step 1" not in out


def test_keys_act_at_once_on_a_terminal() -> None:
    master, slave = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "wherry", "play", "taxi"],
        stdin=slave,
        stdout=slave,
        stderr=slave,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "100"},
    )
    os.close(slave)
    try:
        output = read_until(master, "step 0")
        os.write(master, b"\x1b[A")
        output += read_until(master, "step 1")
        os.write(master, b"p")
        output += read_until(master, "step 2")
        os.write(master, b"q")
        output += read_until(master, None)
        assert process.wait(timeout=30) == 0
    finally:
        process.kill()
        process.wait()
        os.close(master)
    assert "PICKUP: nothing changes" in output


def read_until(terminal: int, expected: str | None) -> str:
    """Return a terminal's output up to an expected text; None to read until the program closes the terminal."""
    output, deadline = "", time.monotonic() + 60
    while expected is None or expected not in output:
        assert time.monotonic() < deadline, output
        if select.select([terminal], [], [], 1.0)[0]:
            try:
                output += os.read(terminal, 65536).decode("utf-8", errors="replace")
            except OSError:  # the program has closed the terminal
                break
    return output


@pytest.mark.parametrize("arguments", [["chess"], ["taxi", "--learner", "oracle"], ["delivery", "--boxes", "900"]])
def test_invalid_input_is_refused_in_one_line(call: Call, arguments: list[str]) -> None:
    status, out, err = call("play", *arguments)
    assert (status, out) == (2, "")
    assert err.count("\n") == 1


def test_the_command_offers_all_domains_and_learners_of_games() -> None:
    assert (set(command.DOMAINS), set(command.LEARNERS)) == (set(GAME_SETUPS), set(PLAY_LEARNERS))
