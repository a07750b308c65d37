"""Experiments: Settings → run() → Result; each makes a figure or a table."""
