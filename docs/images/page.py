"""Capture a screenshot of a run's page, as docs/images/page.png.

    ./wherry deliver --seed 0
    .venv/bin/python docs/images/page.py runs/rooms-seed0 docs/images/page.png --at 533

Requires the packages of the extra "dev", and Debian's chromium.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

from wherry.trace.recordings import find_trace, load_frames
from wherry.views.web.page import player_page

SIZE = {"width": 1280, "height": 800}  # px
FADE_TIME = 2_000  # ms until the highlighting of new rules has faded


def main() -> None:
    """Open the page of a run, go to a time, and take a screenshot."""
    parser = argparse.ArgumentParser(description="Capture the page of a run.")
    parser.add_argument("run", type=Path, help="folder of the run")
    parser.add_argument("picture", type=Path, help="PNG file to write")
    parser.add_argument("--at", type=float, default=533.0, help="time on the robot's clock, s")
    parser.add_argument("--theme", choices=("light", "dark"), default="light")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        page_file = Path(folder) / "page.html"
        frames = load_frames(find_trace(arguments.run))
        page_file.write_text(player_page("wherry", {"source": "file"}, frames), encoding="utf-8")
        browser = driver.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        page = browser.new_page(viewport=SIZE)
        page.goto(f"{page_file.as_uri()}?theme={arguments.theme}")
        while not page.evaluate("trace.over"):
            page.wait_for_timeout(50)
        page.evaluate("time => { player.playing = false; player.seek(time) }", arguments.at)
        page.wait_for_timeout(FADE_TIME)
        page.screenshot(path=arguments.picture)
        browser.close()


if __name__ == "__main__":
    main()
