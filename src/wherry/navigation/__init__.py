"""Getting about on a map: shortest paths, path following, exploration (paper, section 7)."""
