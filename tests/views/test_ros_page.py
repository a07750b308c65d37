"""The page of an agent on a ROS 2 robot; simulator, agent and browser are separate processes."""

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

DOMAIN = 1 + os.getpid() % 101  # ROS_DOMAIN_ID of this test
TIMEOUT = 120.0  # s
BLUE = (31, 111, 235)


@contextlib.contextmanager
def wherry(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Run a command in a process of its own, in the DDS domain of this test."""
    environment = {**os.environ, "ROS_DOMAIN_ID": str(DOMAIN), "COLUMNS": "200"}
    command = [sys.executable, "-u", "-m", "wherry", "ros2", *arguments]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def test_a_delivery_over_ros_is_shown_on_the_page(page: playwright.Page, tmp_path: Path) -> None:
    options = ("--warehouse", "3.0,0.0", "--out", str(tmp_path))
    with wherry("simulate", "small"), wherry("deliver", *options, "--view", "--port", "0") as agent:
        assert agent.stdout is not None
        address = next(found for line in agent.stdout if (found := re.search(r"http://\S+", line)))
        page.goto(f"{address.group()}?theme=light")
        until(page, "trace.records.RobotSnapshot.length > 20 && trace.records.MapUpdate.length > 1", seconds=TIMEOUT)
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
        colours_at_end_points = page.evaluate(
            """new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => {
                const { snapshot } = scene.instant;
                const colours = [];
                for (let n = 0; n < snapshot.points.length; n += 2) {
                    const point = [0, 1].map((axis) => snapshot.pose[axis] + snapshot.points[n + axis] * POSITION_STEP);
                    const pixel = scene.project(...point).map((pixels) => Math.floor(pixels * scene.ratio));
                    colours.push([...scene.context.getImageData(...pixel, 1, 1).data].slice(0, 3));
                }
                done(colours);
            })))"""
        )
        assert len(colours_at_end_points) > 100
        is_blue = [
            all(abs(part - expected) < 40 for part, expected in zip(colour, BLUE, strict=True))
            for colour in colours_at_end_points
        ]
        assert sum(is_blue) > 0.8 * len(is_blue)  # the robot and its trail cover the others
        agent.send_signal(signal.SIGINT)
        page.locator("#notice").wait_for(state="visible", timeout=TIMEOUT * 1000)
        assert agent.wait(timeout=TIMEOUT) == 130
    assert (tmp_path / "trace.wherry").stat().st_size > 1000
