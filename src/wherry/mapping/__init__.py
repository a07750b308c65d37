"""Making maps from scans and odometry: scan matching, pose graphs, particles (paper, section 5)."""
