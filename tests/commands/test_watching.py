"""How long a run that is over stays on its page."""

from __future__ import annotations

import webbrowser

import pytest
from rich.console import Console

from wherry.commands import watching
from wherry.trace.records import Narration, Phase


@pytest.mark.parametrize(("opened", "constant"), [(True, "OPENED_VISITOR"), (False, "FIRST_VISITOR")])
def test_a_page_that_never_comes_is_waited_for_as_long_as_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], opened: bool, constant: str
) -> None:
    asked: list[str] = []

    def open_page(url: str) -> bool:
        asked.append(url)
        return opened

    monkeypatch.setenv("BROWSER", "one that starts, and never gets there")
    monkeypatch.setattr(webbrowser, "open", open_page)
    monkeypatch.setattr(watching, constant, 0.4)
    with watching.watched("A run", None, Console(width=120), view=True, port=0) as sink:
        sink(Narration(0.0, Phase.EXPLORE, "I begin."))
    printed = capsys.readouterr().out.splitlines()
    (url,) = asked
    assert printed == [
        f"Page: {url}",
        f"The run is over. Close the page, or press Ctrl-C: {url}",
        "Nobody has opened it yet: it waits for 0.4 s.",
        "Nobody has opened the page, so that it ends here.",
    ]
