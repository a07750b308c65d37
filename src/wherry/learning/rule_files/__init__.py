"""Learnt rules as JSON."""
