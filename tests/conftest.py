"""Fixed examples for property tests, and real-time tests last."""

from __future__ import annotations

import pytest
from hypothesis import settings

settings.register_profile("fixed", derandomize=True, database=None, deadline=None)
settings.register_profile("explore", max_examples=1000, deadline=None)
settings.load_profile("fixed")  # `--hypothesis-profile explore` searches for new counterexamples instead


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put real-time tests at the end, where no earlier test's processes compete with them."""
    items.sort(key=lambda item: item.get_closest_marker("realtime") is not None)
