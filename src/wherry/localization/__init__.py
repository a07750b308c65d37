"""Where the robot is on a map: Monte Carlo localization and the filters it is compared with (paper, section 5)."""
