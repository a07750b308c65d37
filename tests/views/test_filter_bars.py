"""Bar charts of filters."""

from __future__ import annotations

from wherry.views.filter_bars import filter_bars


def test_filter_bars_are_labelled_with_their_values() -> None:
    figure = filter_bars(["first", "second"], {"rmse, m": [0.0153, 0.4], "scans/s": [6336.2, 20.0]})
    assert [text.get_text() for axes in figure.axes for text in axes.texts] == ["0.0153", "0.4", "6,336", "20"]
