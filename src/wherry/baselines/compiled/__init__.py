"""The baselines compiled for numbered states: the same steps as the reference implementations, but much faster."""
