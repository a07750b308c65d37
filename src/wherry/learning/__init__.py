"""Learners: they turn experience into a model, one file each (paper, sections 4 and 6)."""
