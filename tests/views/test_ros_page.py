"""The agent on a ROS 2 robot, on the page: simulator, agent and browser share nothing but DDS and HTTP."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright import sync_api as playwright

from wherry_testing.browsing import DESK, PHONE, SCREENSHOTS, until

pytestmark = [pytest.mark.slow, pytest.mark.realtime]

DOMAIN = 1 + os.getpid() % 101  # a ROS_DOMAIN_ID of its own
PATIENCE = 120.0  # s
BLUE = (31, 111, 235)


@contextlib.contextmanager
def wherry(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A command in a process of its own, in this test's domain."""
    environment = {**os.environ, "ROS_DOMAIN_ID": str(DOMAIN), "COLUMNS": "200"}
    command = [sys.executable, "-u", "-m", "wherry", "ros2", *arguments]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def test_a_delivery_over_ros_is_shown_on_the_page(page: playwright.Page, tmp_path: Path) -> None:
    place = ("--warehouse", "3.0,0.0", "--out", str(tmp_path))
    with wherry("simulate", "small"), wherry("deliver", *place, "--view", "--port", "0") as agent:
        assert agent.stdout is not None
        address = next(found for line in agent.stdout if (found := re.search(r"http://\S+", line)))
        page.goto(f"{address.group()}?theme=light")
        until(page, "trace.records.RobotSnapshot.length > 20 && trace.records.MapUpdate.length > 1", seconds=PATIENCE)
        page.get_by_role("button", name="Live").click()
        SCREENSHOTS.mkdir(parents=True, exist_ok=True)
        for size, name in ((DESK, "desk"), (PHONE, "phone")):
            page.set_viewport_size(size)  # type: ignore[arg-type]
            page.wait_for_timeout(200)
            page.screenshot(path=SCREENSHOTS / f"ros2-{name}.png")
        assert page.evaluate("trace.records.RunStarted[0].task") == "deliver"
        assert page.inner_text("#phase") == "Explores"
        assert page.inner_text("#link") == "live"
        page.evaluate("player.playing = false; scene.hidden.add('path')")
        until(page, "scene.instant.time === player.time")
        ends = page.evaluate(
            """new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => {
                const { snapshot } = scene.instant;
                const colours = [];
                for (let n = 0; n < snapshot.points.length; n += 2) {
                    const at = [0, 1].map((axis) => snapshot.pose[axis] + snapshot.points[n + axis] * POSITION_STEP);
                    const place = scene.project(...at).map((pixels) => Math.floor(pixels * scene.ratio));
                    colours.push([...scene.context.getImageData(...place, 1, 1).data].slice(0, 3));
                }
                done(colours);
            })))"""
        )
        assert len(ends) > 100
        blue = [all(abs(part - wanted) < 40 for part, wanted in zip(colour, BLUE, strict=True)) for colour in ends]
        assert sum(blue) > 0.8 * len(ends)  # the robot and its way lie over the others
        agent.send_signal(signal.SIGINT)
        page.locator("#notice").wait_for(state="visible", timeout=PATIENCE * 1000)
        assert agent.wait(timeout=PATIENCE) == 130
    assert (tmp_path / "trace.wherry").stat().st_size > 1000
