"""Recorded scans and odometry."""
