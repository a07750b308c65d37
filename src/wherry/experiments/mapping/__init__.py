"""Errors, speed and cost of maps, for docs/results.md."""
