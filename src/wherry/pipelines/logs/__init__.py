"""Recorded logs: mapping, localization, and both of a bag."""
