"""Experiments on localization, which write its section of docs/results.md."""
