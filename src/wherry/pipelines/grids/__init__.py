"""Learning and playing on grids."""
