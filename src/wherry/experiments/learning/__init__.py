"""The published learning experiment: our table beside published results, and efficient_rl's time for a step."""
