"""Options of ``wherry ros1`` and ``wherry ros2``."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from wherry.cli import app


@pytest.mark.parametrize("option", ["--mapping", "--localization"])
def test_unknown_provider_is_an_error_before_waiting_for_the_robot(option: str) -> None:
    result = CliRunner().invoke(app, ["ros2", "deliver", "--warehouse", "1,0", option, "theirs"])
    assert str(result.exception) == f"{option}: theirs: is neither own nor ros"
    assert "Waiting for the robot" not in result.output
