"""The baselines compiled for numbered states: the same steps as the plain ones, thousands of times as fast."""
