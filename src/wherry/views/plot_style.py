"""Colours that all charts share."""

from __future__ import annotations

MEASURED_COLOUR = "#0072b2"
TEXT_COLOUR = "#222222"
GRID_COLOUR = "#d9d9d9"
