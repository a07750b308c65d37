"""Learning and playing on grids: the published learning experiment, and games played by a person."""
