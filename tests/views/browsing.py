"""What tests of pages share."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright import sync_api as playwright

SCREENSHOTS = Path("build/screenshots")
DESK, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}


def until(page: playwright.Page, expression: str, *, seconds: float = 10.0) -> None:
    """Wait until something holds on the page; asked from outside, as the page lets nobody evaluate text."""
    deadline = time.monotonic() + seconds
    while not page.evaluate(expression):
        assert time.monotonic() < deadline, f"never came true: {expression}"
        page.wait_for_timeout(20)
