"""The baselines on tables, compiled: the same steps as the plain ones, thousands of times as fast."""
