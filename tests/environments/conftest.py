"""Tests with Stable-Baselines3 run where it is installed: it brings PyTorch along, which nothing else needs."""

from __future__ import annotations

import importlib.util

collect_ignore = [] if importlib.util.find_spec("stable_baselines3") else ["test_stable_baselines3.py"]
