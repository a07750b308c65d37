"""How long the page is served after its run."""

from __future__ import annotations

import webbrowser

import pytest
from rich.console import Console

from wherry.commands import watching
from wherry.trace.records import Narration, Phase


@pytest.mark.parametrize(("has_browser", "constant"), [(True, "BROWSER_OPEN_TIMEOUT"), (False, "MANUAL_OPEN_TIMEOUT")])
def test_an_unopened_page_is_served_for_the_announced_timeout(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], has_browser: bool, constant: str
) -> None:
    opened_urls: list[str] = []

    def open_url(url: str) -> bool:
        opened_urls.append(url)
        return has_browser

    monkeypatch.setenv("BROWSER", "a browser that never loads the page")
    monkeypatch.setattr(webbrowser, "open", open_url)
    monkeypatch.setattr(watching, constant, 0.4)
    with watching.trace_sink("A run", None, Console(width=120), watching.PageOptions(view=True, port=0)) as sink:
        sink(Narration(0.0, Phase.EXPLORE, "I begin."))
    printed = capsys.readouterr().out.splitlines()
    (url,) = opened_urls
    assert printed == [
        f"Page: {url}",
        f"The run is over. Close the page, or press Ctrl-C: {url}",
        "The page was not opened yet; waiting for 0.4 s.",
        "The page was not opened; stopping.",
    ]
