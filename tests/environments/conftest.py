"""Skip the tests with Stable-Baselines3 where it is not installed; it needs PyTorch, which nothing else does."""

from __future__ import annotations

import importlib.util

collect_ignore = [] if importlib.util.find_spec("stable_baselines3") else ["test_stable_baselines3.py"]
