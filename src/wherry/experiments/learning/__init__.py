"""The published learning experiment: measured results beside published ones, and efficient_rl's time per step."""
