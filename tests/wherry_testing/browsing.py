"""Helpers for tests of pages in Chromium."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright import sync_api as playwright

SCREENSHOTS = Path("build/screenshots")
DESK, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}


def until(page: playwright.Page, expression: str, *, seconds: float = 10.0) -> None:
    """Wait until an expression is true on the page; polls, since the page's policy forbids wait_for_function."""
    deadline = time.monotonic() + seconds
    while not page.evaluate(expression):
        assert time.monotonic() < deadline, f"still false: {expression}"
        page.wait_for_timeout(20)


FAINT_TEXTS = """() => {
    const parts = (colour) => {
        const numbers = colour.match(/[\\d.]+/g).map(Number);
        const [r, g, b, alpha = 1] = numbers;
        return colour.startsWith("color(") ? [255 * r, 255 * g, 255 * b, alpha] : [r, g, b, alpha];
    };
    const over = ([r, g, b, alpha], below) => [r, g, b].map((part, at) => part * alpha + below[at] * (1 - alpha));
    const linear = (part) => (part <= 0.03928 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4);
    const luminance = (colour) => {
        const [r, g, b] = colour.map((part) => linear(part / 255));
        return 0.2126 * r + 0.7152 * g + 0.0722 * b;
    };
    const faint = [];
    const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (texts.nextNode()) {
        const holder = texts.currentNode.parentElement;
        if (!texts.currentNode.textContent.trim() || !holder.checkVisibility()) continue;
        if (holder.closest("script, style, option, :disabled")) continue;
        const above = [];
        for (let node = holder; node; node = node.parentElement) above.push(getComputedStyle(node));
        const opacity = above.reduce((product, style) => product * Number(style.opacity), 1);
        const grounds = above.reverse().map((style) => parts(style.backgroundColor));
        const ground = grounds.reduce((below, colour) => over(colour, below), [255, 255, 255]);
        const [r, g, b, alpha] = parts(getComputedStyle(holder).color);
        const ink = over([r, g, b, alpha * opacity], ground);
        const [light, dark] = [luminance(ink), luminance(ground)].sort((one, other) => other - one);
        const contrast = (light + 0.05) / (dark + 0.05);
        if (contrast < 4.5) faint.push(`${texts.currentNode.textContent.trim()}: ${contrast.toFixed(2)}`);
    }
    return faint;
}"""


def faint_texts(page: playwright.Page) -> list[str]:
    """Text with a contrast below 4.5 (WCAG 2.2, section 1.4.3), without disabled controls."""
    faint: list[str] = page.evaluate(FAINT_TEXTS)
    return faint
